//! How sharp a view shows the hair, told by the hair's own texture.

use strandflow_core::{Mask, Plane, RgbImage};
use strandflow_image::{colour::luma_of, filter::gaussian, morph::eroded};

/// Sharpness below which the hair counts as blurred. Higher, and lenses of middling quality are blamed: a blur of 0.7 px must
/// pass; lower, and views whose finest texture is gone pass for sharp: one of 2 px must not (both in `tests/bad_footage.rs`).
pub const SHARP: f32 = 0.22;
/// Fewest hair pixels away from the mask's border that can be judged: with fewer the ratio scatters by a fifth.
const LEAST_PIXELS: usize = 500;
/// Fewest pixels of background the sensor's noise is read from.
const LEAST_BACKGROUND: usize = 500;
/// Pixels from the mask's border that are not judged: the border itself is texture there.
const BORDER_PX: usize = 4;
/// The long wavelength over the short one: a blur that takes the one leaves the other.
const COARSER: f32 = 2.1;
/// Sigmas of the band of a wavelength: those of the two Gaussians whose difference it is, per pixel of wavelength.
const BAND: [f32; 2] = [0.159, 0.255];

/// Energy of the hair's texture at a short wavelength \[px\] without what the sensor's noise adds, over that at one twice as
/// long: about 1 where hair is sharp, 0 where nothing fine is left. `detail`: luma without shading, 0 outside the hair.
/// `None` where there is too little hair to tell.
pub fn sharpness(detail: &Plane<f32>, inside: &Plane<bool>, noise: f32, short: f32) -> Option<f32> {
    let judged = eroded(inside, BORDER_PX);
    let pixels = judged.data.iter().filter(|&&judged| judged).count();
    if pixels < LEAST_PIXELS {
        return None;
    }
    let energy = |wavelength: f32| {
        let [narrow, wide] = BAND.map(|share| gaussian(detail, share * wavelength));
        let squares = narrow.data.iter().zip(&wide.data).zip(&judged.data).filter(|(_, judged)| **judged);
        squares.map(|((a, b), _)| f64::from(a - b).powi(2)).sum::<f64>() / pixels as f64
    };
    let fine = (energy(short) - f64::from(noise * noise * gain(short))).max(0.0);
    let coarse = energy(COARSER * short);
    Some(if coarse > 0.0 { (fine / coarse) as f32 } else { 0.0 })
}

/// What the band of a wavelength leaves of the variance of white noise.
fn gain(wavelength: f32) -> f32 {
    let [a, b] = BAND.map(|share| (share * wavelength).powi(2));
    (0.25 / a + 0.25 / b - 1.0 / (a + b)) / std::f32::consts::PI
}

/// Standard deviation of the sensor's noise in luma, from the background \[code values\]; 0 where there is too little.
///
/// Every second row: half of the background knows it as well.
///
/// Reference: Immerkær 1996; the lower quartile instead of the mean, so that half of the background may have texture.
pub fn noise_of(image: &RgbImage, subject: &Mask) -> f32 {
    let (width, height) = (image.width, image.height);
    let luma = image.map(|&colour| luma_of(colour));
    let mut found = Vec::new();
    for y in (1..height.saturating_sub(1)).step_by(2) {
        let [above, here, below] = [y - 1, y, y + 1].map(|row| luma.row(row));
        for x in (1..width.saturating_sub(1)).filter(|&x| subject[(x, y)] < 16) {
            let sum = |row: &[f32], [a, b, c]: [f32; 3]| a * row[x - 1] + b * row[x] + c * row[x + 1];
            let outer = sum(above, [1.0, -2.0, 1.0]) + sum(below, [1.0, -2.0, 1.0]);
            found.push((outer + sum(here, [-2.0, 4.0, -2.0])).abs());
        }
    }
    if 2 * found.len() < LEAST_BACKGROUND {
        return 0.0;
    }
    let quarter = found.len() / 4;
    // A quarter of a normal distribution lies within 0.3186 sigma; the operator has gain 6.
    *found.select_nth_unstable_by(quarter, f32::total_cmp).1 / (0.3186 * 6.0)
}
