//! Colour conversions of 8-bit images to floating-point planes.

use strandflow_core::{Plane, RgbImage};

/// Rec. 601 luma of a colour, 0 to 255.
#[inline]
pub fn luma_of([r, g, b]: [u8; 3]) -> f32 {
    0.299 * f32::from(r) + 0.587 * f32::from(g) + 0.114 * f32::from(b)
}

/// Luma plane, 0 to 255.
pub fn luma(image: &RgbImage) -> Plane<f32> {
    image.map(|&colour| luma_of(colour))
}

/// One colour channel (0 red, 1 green, 2 blue), 0 to 255.
pub fn channel(image: &RgbImage, index: usize) -> Plane<f32> {
    image.map(|colour| f32::from(colour[index]))
}

/// Luma and the two opponent chroma differences (red − green, blue − (red + green)/2), all in code values.
#[inline]
pub fn opponent([r, g, b]: [f32; 3]) -> [f32; 3] {
    [0.299 * r + 0.587 * g + 0.114 * b, r - g, b - 0.5 * (r + g)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grey_has_no_chroma() {
        let [l, a, b] = opponent([90.0; 3]);
        assert!((l - 90.0).abs() < 1e-4 && a == 0.0 && b == 0.0);
        assert!((luma_of([90; 3]) - l).abs() < 1e-4);
    }
}
