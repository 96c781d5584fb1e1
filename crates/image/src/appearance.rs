//! Two-class appearance: colour histograms of what is inside and outside a mask, as log likelihood ratios.

use strandflow_core::{Plane, RgbImage};

use crate::{colour::opponent, filter::gaussian};

const BINS: usize = 24;

/// Smoothed colour histograms of two classes in opponent space.
#[derive(Clone, Debug)]
pub struct Appearance {
    ratio: Vec<f32>,
}

/// Colours of an image after a small blur (noise must not fill the histogram), as three opponent planes.
pub fn features(image: &RgbImage, sigma: f32) -> [Plane<f32>; 3] {
    let rgb = [0, 1, 2].map(|c| gaussian(&crate::colour::channel(image, c), sigma));
    let at = |i: usize| opponent([rgb[0].data[i], rgb[1].data[i], rgb[2].data[i]]);
    let plane = |k: usize| Plane { data: (0..rgb[0].data.len()).map(|i| at(i)[k]).collect(), ..rgb[0] };
    [plane(0), plane(1), plane(2)]
}

impl Appearance {
    /// Learns from pixels with a weight for either class (0 where unknown). `None` where a class is empty.
    pub fn learn(features: &[Plane<f32>; 3], weights: impl Fn(usize) -> (f32, f32)) -> Option<Self> {
        let mut counts = [vec![0.0f32; BINS * BINS * BINS], vec![0.0f32; BINS * BINS * BINS]];
        let mut totals = [0.0f32; 2];
        for i in 0..features[0].data.len() {
            let (inside, outside) = weights(i);
            if inside <= 0.0 && outside <= 0.0 {
                continue;
            }
            let bin = bin(features, i);
            counts[0][bin] += inside;
            counts[1][bin] += outside;
            totals[0] += inside;
            totals[1] += outside;
        }
        if totals[0] < 50.0 || totals[1] < 50.0 {
            return None;
        }
        let [a, b] = counts.map(|c| smoothed(&c));
        // A hundredth of a uniform share each: colours never seen say nothing.
        let floor = 1e-6;
        let ratio = a.iter().zip(&b).map(|(a, b)| ((a / totals[0] + floor) / (b / totals[1] + floor)).ln()).collect();
        Some(Self { ratio })
    }

    /// Log likelihood ratio (inside over outside) of every pixel.
    pub fn log_ratio(&self, features: &[Plane<f32>; 3]) -> Plane<f32> {
        Plane { data: (0..features[0].data.len()).map(|i| self.ratio[bin(features, i)]).collect(), ..features[0] }
    }
}

fn bin(features: &[Plane<f32>; 3], i: usize) -> usize {
    let quantise =
        |value: f32, low: f32, step: f32| (((value - low) / step) as isize).clamp(0, BINS as isize - 1) as usize;
    let l = quantise(features[0].data[i], 0.0, 256.0 / BINS as f32);
    let a = quantise(features[1].data[i], -72.0, 6.0);
    let b = quantise(features[2].data[i], -96.0, 6.0);
    (l * BINS + a) * BINS + b
}

/// Binomial smoothing (1 2 1)/4 along the three axes.
fn smoothed(counts: &[f32]) -> Vec<f32> {
    let mut now = counts.to_vec();
    for stride in [1, BINS, BINS * BINS] {
        let before = now.clone();
        for (i, out) in now.iter_mut().enumerate() {
            let place = i / stride % BINS;
            let low = if place > 0 { before[i - stride] } else { before[i] };
            let high = if place + 1 < BINS { before[i + stride] } else { before[i] };
            *out = 0.25 * (low + 2.0 * before[i] + high);
        }
    }
    now
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skin_and_hair_are_told_apart() {
        let image = Plane::from_fn(40, 40, |x, y| {
            let jitter = ((x * 7 + y * 13) % 9) as u8;
            if x < 20 { [120 + jitter, 95 + jitter, 70 + jitter] } else { [215 + jitter, 185 + jitter, 160 + jitter] }
        });
        let f = features(&image, 1.0);
        let model = Appearance::learn(&f, |i| if i % 40 < 20 { (1.0, 0.0) } else { (0.0, 1.0) }).unwrap();
        let ratio = model.log_ratio(&f);
        assert!(ratio[(5, 20)] > 2.0 && ratio[(35, 20)] < -2.0);
        assert!(Appearance::learn(&f, |_| (1.0, 0.0)).is_none());
    }
}
