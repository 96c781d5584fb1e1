//! Mattes by difference from a clean plate.

use strandflow_core::{Mask, Plane, RgbImage};

use crate::{
    filter::{gaussian, gaussian_where},
    morph::{dilated, eroded, without_holes, without_specks},
    region::Region,
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
    let mut matte = Plane::filled(image.width, image.height, 0u8);
    let Some(bounds) = Region::bounding(&sure, |&m| m) else { return matte };
    let region = bounds.grown(2 * options.band, image.width, image.height);
    let crop = |planes: &[Plane<f32>; 3]| [0, 1, 2].map(|c| region.crop(&planes[c], |&v| v));
    region.paste(&coverage(&crop(&i), &crop(&p), &noise, &region.crop(&sure, |&m| m), options.band), &mut matte);
    matte
}

/// Soft coverage within `band` outside and twice `band` inside the border of `sure`.
fn coverage(
    image: &[Plane<f32>; 3],
    plate: &[Plane<f32>; 3],
    noise: &[f32; 3],
    sure: &Plane<bool>,
    band: usize,
) -> Mask {
    // Subject colours come from inside; where there is no inside, from the sure pixels themselves.
    let (core, inner, outer) = (eroded(sure, band), eroded(sure, 2), dilated(sure, band));
    let weigh = |at: usize| match (core.data[at], inner.data[at], sure.data[at]) {
        (true, ..) => 1.0,
        (_, true, _) => 0.05,
        (_, _, true) => 1e-3,
        _ => 0.0,
    };
    let weight = Plane { width: sure.width, height: sure.height, data: (0..sure.data.len()).map(weigh).collect() };
    let subject = [0, 1, 2].map(|c| gaussian_where(&image[c], &weight, band as f32));
    let of = |at: usize| {
        if core.data[at] || !outer.data[at] {
            return if core.data[at] { 255 } else { 0 };
        }
        let (mut top, mut bottom, mut all) = (0.0, 0.0, 0.0);
        for c in 0..3 {
            let p = plate[c].data[at];
            // Light mixes linearly, code values do not: at half coverage of dark hair they would say 0.4.
            let from_plate = |value: f32| light(value) - light(p);
            let (away, seen) = (from_plate(subject[c].data[at]), from_plate(image[c].data[at]));
            let slope = 2.2 / 255.0 * (p.max(20.0) / 255.0).powf(1.2);
            let w = 1.0 / (noise[c] * slope).powi(2);
            top += w * away * seen;
            bottom += w * away * away;
            all += w * seen * seen;
        }
        let share = top / bottom.max(1e-6);
        // A pixel that is no mixture of plate and nearby subject colour is another part of the subject; where subject
        // and plate look alike the projection says nothing. Both keep the decision of the difference.
        let off_line = (all - share * top).max(0.0).sqrt();
        if bottom < 36.0 || off_line > 4.0 + 0.35 * bottom.sqrt() {
            return if sure.data[at] { 255 } else { 0 };
        }
        if share < 0.1 { 0 } else { (255.0 * share.min(1.0)).round() as u8 }
    };
    Plane { width: sure.width, height: sure.height, data: (0..sure.data.len()).map(of).collect() }
}

/// Linear light of a code value, 0 to 1 (gamma 2.2).
fn light(code: f32) -> f32 {
    (code.max(0.0) / 255.0).powf(2.2)
}

/// Median difference image − plate over the pixels that look like plate, and the standard deviation of one pixel.
fn offset_and_noise(image: &Plane<f32>, plate: &Plane<f32>) -> (f32, f32) {
    let mut d: Vec<f32> =
        image.data.iter().zip(&plate.data).step_by(3).map(|(a, b)| a - b).filter(|d| d.abs() < 40.0).collect();
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
    let difference = |c: usize| {
        let data = i[c].data.iter().zip(&p[c].data).map(|(a, b)| a - b).collect();
        gaussian(&Plane { data, ..i[c] }, 1.0)
    };
    let d = [0, 1, 2].map(difference);
    // White noise through a Gaussian of sigma 1: standard deviation 1/(2√π).
    let weights = noise.map(|s| 1.0 / (s * 0.2821).powi(2));
    let of = |at: usize| {
        let (mut dp, mut pp) = (0.0, 0.0);
        for c in 0..3 {
            dp += weights[c] * d[c].data[at] * p[c].data[at];
            pp += weights[c] * p[c].data[at] * p[c].data[at];
        }
        let shade = (dp / pp.max(1e-6)).clamp(-shadow, 0.0);
        let d2 = |c: usize| weights[c] * (d[c].data[at] - shade * p[c].data[at]).powi(2);
        (d2(0) + d2(1) + d2(2)).sqrt()
    };
    Plane { width: i[0].width, height: i[0].height, data: (0..i[0].data.len()).map(of).collect() }
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
        let mut shot = |subject: bool, dimmer: f32| {
            Plane::from_fn(100, 80, |x, y| {
                let a = if subject { coverage(x, y) } else { 0.0 };
                [(150.0, 120.0), (170.0, 90.0), (155.0, 60.0)].map(|(b, f)| {
                    let mixed = a * light(f) + (1.0 - a) * light(b - dimmer);
                    (255.0 * mixed.powf(1.0 / 2.2) + noise()).clamp(0.0, 255.0) as u8
                })
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
