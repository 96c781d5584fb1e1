//! How sharp a view shows the hair, told by the hair's own texture.

use strandflow_core::{Mask, Plane, RgbImage};
use strandflow_image::{colour::luma_of, filter::gaussian, morph::eroded};

/// Sharpness below which the hair counts as blurred. In 28 views and frames of two rendered captures it is 0.67 to 1.10;
/// those blurred by 1, 1.5 and 2 px have 0.26–0.38, 0.15–0.20 and 0.10–0.13. Higher, and lenses of middling quality are
/// blamed; lower, and views whose finest texture is gone pass for sharp.
pub const SHARP: f32 = 0.22;
/// Fewest hair pixels away from the mask's border that can be judged: with fewer the ratio scatters by a fifth.
const LEAST_PIXELS: usize = 500;
/// Fewest pixels of background the sensor's noise is read from.
const LEAST_BACKGROUND: usize = 500;
/// Pixels from the mask's border that are not judged: the border itself is texture there.
const BORDER_PX: usize = 4;
/// The wavelength whose texture is left where hair is blurred, per that of sharp hair.
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
/// Reference: Immerkær 1996; the lower quartile instead of the mean, so that half of the background may have texture.
pub fn noise_of(image: &RgbImage, subject: &Mask) -> f32 {
    let (width, height) = (image.width, image.height);
    let mut found = Vec::new();
    for y in 1..height.saturating_sub(1) {
        for x in 1..width.saturating_sub(1) {
            if subject[(x, y)] >= 16 {
                continue;
            }
            let sum = |row: usize, [a, b, c]: [f32; 3]| {
                let at = |x: usize| luma_of(image[(x, row)]);
                a * at(x - 1) + b * at(x) + c * at(x + 1)
            };
            let outer = sum(y - 1, [1.0, -2.0, 1.0]) + sum(y + 1, [1.0, -2.0, 1.0]);
            found.push((outer + sum(y, [-2.0, 4.0, -2.0])).abs());
        }
    }
    if found.len() < LEAST_BACKGROUND {
        return 0.0;
    }
    let quarter = found.len() / 4;
    // A quarter of a normal distribution lies within 0.3186 sigma; the operator has gain 6.
    *found.select_nth_unstable_by(quarter, f32::total_cmp).1 / (0.3186 * 6.0)
}
