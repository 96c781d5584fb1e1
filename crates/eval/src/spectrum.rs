//! How fast positions move to and fro: power over frequency. Hair swings slowly; what is left at high frequencies is jitter.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

/// Power spectral density of positions, one-sided, summed over x, y and z.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spectrum {
    /// Frequencies \[Hz\], rising, without 0.
    pub hz: Vec<f64>,
    /// Power \[mm²/Hz\] at each.
    pub power: Vec<f64>,
}

impl Spectrum {
    /// Variance of the positions by what is at these frequencies \[mm²\].
    pub fn between(&self, low_hz: f64, high_hz: f64) -> f64 {
        let step = self.hz.first().copied().unwrap_or(0.0);
        let inside = self.hz.iter().zip(&self.power).filter(|(hz, _)| (low_hz..=high_hz).contains(*hz));
        inside.map(|(_, power)| power * step).sum()
    }
}

/// Mean spectrum of many series of the same length, added one by one (Welch's method): the linear trend is taken away, a
/// Hann window keeps what does not come round at the ends from looking like jitter.
#[derive(Clone, Debug)]
pub struct MeanSpectrum {
    frame_secs: f64,
    window: Vec<f64>,
    sum: Vec<f64>,
    count: usize,
}

impl MeanSpectrum {
    /// For series of `frames` positions, `frame_secs` \[s\] apart.
    pub fn new(frames: usize, frame_secs: f64) -> Self {
        let hann = |i: usize| 0.5 - 0.5 * (2.0 * PI * (i as f64 + 0.5) / frames as f64).cos();
        Self { frame_secs, window: (0..frames).map(hann).collect(), sum: vec![0.0; frames / 2], count: 0 }
    }

    /// Adds the positions of a point \[mm\]; a series of another length or with a position that is not finite is left out.
    pub fn add(&mut self, series: &[Vec3]) {
        if series.len() != self.window.len() || series.len() < 3 || !series.iter().all(|p| p.is_finite()) {
            return;
        }
        let shaped: Vec<DVec3> = without_trend(series).iter().zip(&self.window).map(|(p, w)| *p * *w).collect();
        let frames = shaped.len();
        let scale = 2.0 * self.frame_secs / self.window.iter().map(|w| w * w).sum::<f64>();
        for (k, sum) in (1..).zip(&mut self.sum) {
            let (mut cosine, mut sine) = (DVec3::ZERO, DVec3::ZERO);
            for (i, p) in shaped.iter().enumerate() {
                let (s, c) = (2.0 * PI * (k * i % frames) as f64 / frames as f64).sin_cos();
                cosine += *p * c;
                sine += *p * s;
            }
            // The highest frequency of an even number of frames has no mirror image.
            let sides = if 2 * k == frames { 0.5 } else { 1.0 };
            *sum += sides * scale * (cosine.length_squared() + sine.length_squared());
        }
        self.count += 1;
    }

    /// Series added.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The mean; `None` where nothing was added.
    pub fn mean(&self) -> Option<Spectrum> {
        let step = 1.0 / (self.window.len() as f64 * self.frame_secs);
        (self.count > 0).then(|| Spectrum {
            hz: (1..=self.sum.len()).map(|k| k as f64 * step).collect(),
            power: self.sum.iter().map(|sum| sum / self.count as f64).collect(),
        })
    }
}

/// The series less its best straight line.
fn without_trend(series: &[Vec3]) -> Vec<DVec3> {
    let middle = 0.5 * (series.len() - 1) as f64;
    let (mut mean, mut slope, mut squares) = (DVec3::ZERO, DVec3::ZERO, 0.0);
    for (i, p) in series.iter().enumerate() {
        mean += p.as_dvec3() / series.len() as f64;
        slope += p.as_dvec3() * (i as f64 - middle);
        squares += (i as f64 - middle).powi(2);
    }
    slope /= squares;
    series.iter().enumerate().map(|(i, p)| p.as_dvec3() - mean - slope * (i as f64 - middle)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_swing_shows_at_its_frequency_with_its_variance() {
        // 2 mm amplitude at 12.5 Hz on a straight way: variance 2 mm².
        let swing = |i: usize| Vec3::new(2.0 * (2.0 * std::f32::consts::PI * i as f32 / 8.0).sin(), i as f32, 7.0);
        let mut mean = MeanSpectrum::new(64, 0.01);
        mean.add(&(0..64).map(swing).collect::<Vec<_>>());
        let spectrum = mean.mean().unwrap();
        let largest = (0..32).max_by(|a, b| spectrum.power[*a].total_cmp(&spectrum.power[*b])).unwrap();
        assert!((spectrum.hz[largest] - 12.5).abs() < 1e-9 && (spectrum.hz[31] - 50.0).abs() < 1e-9);
        assert!((spectrum.between(0.0, 50.0) - 2.0).abs() < 0.1, "{}", spectrum.between(0.0, 50.0));
        assert!(spectrum.between(25.0, 50.0) < 1e-3);
    }

    #[test]
    fn noise_is_flat_at_its_level() {
        // σ = 0.5 mm on each axis at 100 Hz: 3 · 0.25 mm² over 50 Hz.
        let mut state = 7u32;
        let mut gauss = || {
            let mut sum = -6.0;
            for _ in 0..12 {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                sum += (state >> 8) as f32 / (1 << 24) as f32;
            }
            0.5 * sum
        };
        let mut mean = MeanSpectrum::new(32, 0.01);
        for _ in 0..400 {
            mean.add(&(0..32).map(|_| Vec3::new(gauss(), gauss(), gauss())).collect::<Vec<_>>());
        }
        let spectrum = mean.mean().unwrap();
        // The lowest frequencies lose power with the trend, the highest is half one-sided. Standard error of a mean: 3 %.
        for power in &spectrum.power[3..15] {
            assert!((power - 0.015).abs() < 0.0018, "{power}");
        }
    }

    #[test]
    fn gaps_take_no_part() {
        let mut mean = MeanSpectrum::new(8, 0.01);
        mean.add(&[Vec3::NAN; 8]);
        mean.add(&[Vec3::ZERO; 7]);
        assert_eq!((mean.count(), mean.mean()), (0, None));
    }
}
