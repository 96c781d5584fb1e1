//! Mattes by difference from a clean plate.

use strandflow_core::{Mask, Plane, RgbImage};

use crate::{
    filter::{gaussian, gaussian_where},
    morph::{dilated, eroded, without_holes, without_specks},
};

/// How a matte is made.
#[derive(Clone, Debug, PartialEq)]
pub struct MatteOptions {
    /// Differences above this many standard deviations of the (smoothed) noise are the subject.
    pub threshold: f32,
    /// Smallest piece of subject kept \[px\].
    pub speck_area: usize,
    /// Largest hole closed \[px\].
    pub hole_area: usize,
    /// Darkening of the plate that counts as shadow rather than subject, as a fraction.
    pub shadow: f32,
    /// Half width of the band in which coverage is soft \[px\].
    pub band: usize,
}

/// Soft coverage of what stands before the plate.
///
/// Noise and a global offset a channel are taken from the data (median and median absolute deviation of the
/// difference where it is small). Coverage in the band is the projection of a pixel on the line from plate colour to the
/// nearby subject colour.
pub fn from_plate(image: &RgbImage, plate: &RgbImage, options: &MatteOptions) -> Mask {
    let (width, height) = (image.width, image.height);
    let channels = |source: &RgbImage| [0, 1, 2].map(|c| crate::colour::channel(source, c));
    let (i, mut p) = (channels(image), channels(plate));
    let mut noise = [1.0f32; 3];
    for c in 0..3 {
        let (offset, sigma) = offset_and_noise(&i[c], &p[c]);
        p[c].data.iter_mut().for_each(|v| *v += offset);
        noise[c] = sigma;
    }
    let difference = shaded_difference(&i, &p, &noise, options.shadow);
    let sure = without_specks(&difference.map(|&d| d > options.threshold), options.speck_area);
    let sure = without_holes(&sure, options.hole_area);
    let core = eroded(&sure, 2);
    let band = dilated(&sure, options.band);
    let weight = core.map(|&m| if m { 1.0 } else { 1e-3 });
    let subject = [0, 1, 2].map(|c| gaussian_where(&i[c], &weight, 1.5 * options.band as f32));
    Plane::from_fn(width, height, |x, y| {
        let at = y * width + x;
        if core.data[at] {
            return 255;
        }
        if !band.data[at] {
            return 0;
        }
        let (mut top, mut bottom, mut noise2) = (0.0, 0.0, 0.0);
        for c in 0..3 {
            let away = subject[c].data[at] - p[c].data[at];
            let w = 1.0 / (noise[c] * noise[c]);
            top += w * away * (i[c].data[at] - p[c].data[at]);
            bottom += w * away * away;
            noise2 += w * noise[c] * noise[c];
        }
        // Where subject and plate look alike the projection says nothing: keep the decision of the difference.
        if bottom < 9.0 * noise2 {
            return if sure.data[at] { 255 } else { 0 };
        }
        let coverage = (top / bottom).clamp(0.0, 1.0);
        if coverage < 0.1 { 0 } else { (255.0 * coverage).round() as u8 }
    })
}

/// Median difference image − plate over the pixels that look like plate, and the standard deviation of one pixel.
fn offset_and_noise(image: &Plane<f32>, plate: &Plane<f32>) -> (f32, f32) {
    let mut d: Vec<f32> = image.data.iter().zip(&plate.data).map(|(a, b)| a - b).filter(|d| d.abs() < 40.0).collect();
    if d.is_empty() {
        return (0.0, 1.0);
    }
    let middle = d.len() / 2;
    let offset = *d.select_nth_unstable_by(middle, f32::total_cmp).1;
    d.iter_mut().for_each(|v| *v = (*v - offset).abs());
    let mad = *d.select_nth_unstable_by(middle, f32::total_cmp).1;
    (offset, (1.4826 * mad).max(0.5))
}

/// Difference in standard deviations of its own noise after a blur of 1 px, forgiving a darkening of the plate.
fn shaded_difference(i: &[Plane<f32>; 3], p: &[Plane<f32>; 3], noise: &[f32; 3], shadow: f32) -> Plane<f32> {
    let smooth = |planes: &[Plane<f32>; 3]| [0, 1, 2].map(|c| gaussian(&planes[c], 1.0));
    let (i, p) = (smooth(i), smooth(p));
    // White noise through a Gaussian of sigma 1: standard deviation 1/(2√π).
    let weights = noise.map(|s| 1.0 / (s * 0.2821).powi(2));
    Plane {
        width: i[0].width,
        height: i[0].height,
        data: (0..i[0].data.len())
            .map(|at| {
                let (mut ip, mut pp) = (0.0, 0.0);
                for c in 0..3 {
                    ip += weights[c] * i[c].data[at] * p[c].data[at];
                    pp += weights[c] * p[c].data[at] * p[c].data[at];
                }
                let shade = (ip / pp.max(1e-6)).clamp(1.0 - shadow, 1.0);
                let d2 = |c: usize| weights[c] * (i[c].data[at] - shade * p[c].data[at]).powi(2);
                (d2(0) + d2(1) + d2(2)).sqrt()
            })
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disc_before_a_noisy_plate_is_cut_out_with_soft_borders() {
        let mut state = 7u32;
        let mut noise = || {
            let mut sum = 0.0;
            for _ in 0..4 {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                sum += (state >> 16) as f32 / 65536.0 - 0.5;
            }
            7.0 * sum
        };
        let coverage = |x: usize, y: usize| (20.3 - (x as f32 - 50.0).hypot(y as f32 - 40.0)).clamp(0.0, 1.0);
        let mut shot = |subject: bool, light: f32| {
            Plane::from_fn(100, 80, |x, y| {
                let a = if subject { coverage(x, y) } else { 0.0 };
                [(150.0, 120.0), (170.0, 90.0), (155.0, 60.0)]
                    .map(|(b, f)| (a * f + (1.0 - a) * (b - light) + noise()).clamp(0.0, 255.0) as u8)
            })
        };
        let (plate, image) = (shot(false, 0.0), shot(true, 3.0));
        let options = MatteOptions { threshold: 6.0, speck_area: 20, hole_area: 50, shadow: 0.1, band: 4 };
        let matte = from_plate(&image, &plate, &options);
        let (mut both, mut either) = (0, 0);
        for y in 0..80 {
            for x in 0..100 {
                let (truth, found) = (coverage(x, y) >= 0.5, matte[(x, y)] >= 128);
                both += usize::from(truth && found);
                either += usize::from(truth || found);
            }
        }
        assert!(both as f32 > 0.985 * either as f32, "{both}/{either}");
        assert_eq!((matte[(50, 40)], matte[(5, 5)]), (255, 0));
    }
}
