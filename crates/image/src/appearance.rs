//! Two-class appearance: histograms of colour and of fine texture inside and outside a mask, as log likelihood ratios.

use strandflow_core::{Plane, RgbImage};

use crate::{
    colour::{luma_of, opponent},
    filter::gaussian,
};

const BINS: usize = 24;
const TEXTURE_BINS: usize = 24;
/// Either class may come into shadow: brightness factors and how much they count.
const SHADES: [(f32, f32); 4] = [(1.0, 1.0), (0.85, 0.3), (0.7, 0.3), (0.55, 0.2)];

/// Smoothed histograms of two classes: colour in opponent space, and texture.
#[derive(Clone, Debug)]
pub struct Appearance {
    colour: Vec<f32>,
    texture: Vec<f32>,
}

/// What is compared, a plane each.
#[derive(Clone, Debug)]
pub struct Features {
    /// Opponent colour after a small blur (noise must not fill the histogram).
    pub colour: [Plane<f32>; 3],
    /// Logarithm of the local standard deviation of fine luma detail \[ln code values\].
    pub texture: Plane<f32>,
}

/// Features of an image; `sigma` \[px\] blurs the colours, `texture_sigma` averages the texture.
pub fn features(image: &RgbImage, sigma: f32, texture_sigma: f32) -> Features {
    let rgb = [0, 1, 2].map(|c| gaussian(&crate::colour::channel(image, c), sigma));
    let at = |i: usize| opponent([rgb[0].data[i], rgb[1].data[i], rgb[2].data[i]]);
    let plane = |k: usize| Plane { data: (0..rgb[0].data.len()).map(|i| at(i)[k]).collect(), ..rgb[0] };
    let luma = image.map(|&colour| luma_of(colour));
    let (fine, coarse) = (gaussian(&luma, 0.7), gaussian(&luma, 2.0));
    let energy = Plane { data: fine.data.iter().zip(&coarse.data).map(|(a, b)| (a - b).powi(2)).collect(), ..fine };
    let texture = gaussian(&energy, texture_sigma).map(|e| 0.5 * (e + 0.1).ln());
    Features { colour: [plane(0), plane(1), plane(2)], texture }
}

impl Appearance {
    /// Learns from pixels with a weight for either class (0 where unknown). `None` where a class is nearly empty.
    pub fn learn(features: &Features, weights: impl Fn(usize) -> (f32, f32)) -> Option<Self> {
        let mut colour = [(); 2].map(|_| vec![0.0f32; BINS * BINS * BINS]);
        let mut texture = [(); 2].map(|_| vec![0.0f32; TEXTURE_BINS]);
        for i in 0..features.texture.data.len() {
            let (inside, outside) = weights(i);
            if inside > 0.0 || outside > 0.0 {
                let t = texture_bin(&features.texture, i);
                for (class, weight) in [inside, outside].into_iter().enumerate() {
                    texture[class][t] += weight;
                    for (shade, share) in SHADES {
                        colour[class][colour_bin(&features.colour, i, shade)] += share * weight;
                    }
                }
            }
        }
        if texture.iter().any(|t| t.iter().sum::<f32>() < 50.0) {
            return None;
        }
        let smooth_texture = texture.map(|t| smoothed(&t, &[(1, TEXTURE_BINS)]));
        let smooth_colour = colour.map(|c| smoothed(&c, &[(1, BINS), (BINS, BINS), (BINS * BINS, BINS)]));
        // The floors say that what was never seen decides nothing.
        Some(Self { colour: log_ratios(&smooth_colour, 2e-6), texture: log_ratios(&smooth_texture, 2e-3) })
    }

    /// Log likelihood ratio (inside over outside) of every pixel from colour and from texture.
    pub fn log_ratio(&self, features: &Features) -> (Plane<f32>, Plane<f32>) {
        let n = features.texture.data.len();
        let colour = (0..n).map(|i| self.colour[colour_bin(&features.colour, i, 1.0)]).collect();
        let texture = (0..n).map(|i| self.texture[texture_bin(&features.texture, i)]).collect();
        (Plane { data: colour, ..features.texture }, Plane { data: texture, ..features.texture })
    }
}

fn log_ratios([a, b]: &[Vec<f32>; 2], floor: f32) -> Vec<f32> {
    let (total_a, total_b) = (a.iter().sum::<f32>(), b.iter().sum::<f32>());
    a.iter().zip(b).map(|(a, b)| ((a / total_a + floor) / (b / total_b + floor)).ln()).collect()
}

fn texture_bin(texture: &Plane<f32>, i: usize) -> usize {
    (((texture.data[i] + 1.2) * 5.0) as isize).clamp(0, TEXTURE_BINS as isize - 1) as usize
}

fn colour_bin(features: &[Plane<f32>; 3], i: usize, shade: f32) -> usize {
    let quantise =
        |value: f32, low: f32, step: f32| (((value - low) / step) as isize).clamp(0, BINS as isize - 1) as usize;
    let l = quantise(shade * features[0].data[i], 0.0, 256.0 / BINS as f32);
    let a = quantise(shade * features[1].data[i], -72.0, 6.0);
    let b = quantise(shade * features[2].data[i], -96.0, 6.0);
    (l * BINS + a) * BINS + b
}

/// Binomial smoothing (1 2 1)/4 along axes given as (stride, bins).
fn smoothed(counts: &[f32], axes: &[(usize, usize)]) -> Vec<f32> {
    let mut now = counts.to_vec();
    for &(stride, bins) in axes {
        let before = now.clone();
        for (i, out) in now.iter_mut().enumerate() {
            let place = i / stride % bins;
            let low = if place > 0 { before[i - stride] } else { before[i] };
            let high = if place + 1 < bins { before[i + stride] } else { before[i] };
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
        let f = features(&image, 1.0, 2.0);
        let model = Appearance::learn(&f, |i| if i % 40 < 20 { (1.0, 0.0) } else { (0.0, 1.0) }).unwrap();
        let (ratio, _) = model.log_ratio(&f);
        assert!(ratio[(5, 20)] > 2.0 && ratio[(35, 20)] < -2.0);
        assert!(Appearance::learn(&f, |_| (1.0, 0.0)).is_none());
    }
}
