//! Linear pictures with coverage, and what goes behind them.

use glam::Vec3;
use strandflow_core::{Plane, RgbImage};

use crate::{
    chance::Chance,
    colour::{coded, linear_of_srgb, srgb_of_linear},
};

/// A rendered picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Radiance, linear RGB, multiplied by coverage; and coverage 0 to 1.
    pub linear: Plane<[f32; 4]>,
}

/// What is behind the subject.
#[derive(Clone, Debug, PartialEq)]
pub enum Backdrop {
    /// One colour, linear RGB.
    Solid(Vec3),
    /// From the top to the bottom, linear RGB.
    Gradient(Vec3, Vec3),
    /// An image, as large as fits and in the middle, like [`crate::resized`] shows its view; its edges go on.
    Image(RgbImage),
}

impl Backdrop {
    /// A grey paper backdrop, lit from below.
    pub const PAPER: Self = Self::Gradient(Vec3::new(0.050, 0.053, 0.060), Vec3::new(0.21, 0.215, 0.23));

    fn at(&self, x: usize, y: usize, width: usize, height: usize) -> Vec3 {
        match self {
            Self::Solid(colour) => *colour,
            Self::Gradient(top, bottom) => {
                let t = y as f32 / (height.max(2) - 1) as f32;
                top.lerp(*bottom, t * t * (3.0 - 2.0 * t))
            }
            Self::Image(image) => {
                let scale = (width as f32 / image.width as f32).min(height as f32 / image.height as f32);
                let place = |at: usize, n: usize, of: usize| {
                    let p = (at as f32 + 0.5 - 0.5 * n as f32) / scale + 0.5 * of as f32 - 0.5;
                    let p = p.clamp(0.0, of as f32 - 1.0);
                    (p as usize, (p as usize + 1).min(of - 1), p.fract())
                };
                let ((x0, x1, fx), (y0, y1, fy)) = (place(x, width, image.width), place(y, height, image.height));
                let at = |x: usize, y: usize| Vec3::from_array(image[(x, y)].map(linear_of_srgb));
                at(x0, y0).lerp(at(x1, y0), fx).lerp(at(x0, y1).lerp(at(x1, y1), fx), fy)
            }
        }
    }
}

impl Picture {
    /// The picture over a backdrop, as sRGB. Where nothing is rendered, an image of the same size comes back as it was.
    pub fn over(&self, backdrop: &Backdrop) -> RgbImage {
        let (width, height) = (self.linear.width, self.linear.height);
        Plane::from_fn(width, height, |x, y| {
            let [r, g, b, coverage] = self.linear[(x, y)];
            let light = shoulder(Vec3::new(r, g, b), coverage);
            let light = light + backdrop.at(x, y, width, height) * (1.0 - coverage);
            let grain = if matches!(backdrop, Backdrop::Gradient(..)) { grain(x, y) } else { 0.0 };
            light.to_array().map(|v| (coded(v) + grain).round().clamp(0.0, 255.0) as u8)
        })
    }

    /// The picture alone: sRGB and coverage, not premultiplied.
    pub fn cut_out(&self) -> Plane<[u8; 4]> {
        self.linear.map(|&[r, g, b, coverage]| {
            let light = shoulder(Vec3::new(r, g, b), coverage) / coverage.max(1e-6);
            let [r, g, b] = light.to_array().map(srgb_of_linear);
            [r, g, b, (255.0 * coverage.clamp(0.0, 1.0)).round() as u8]
        })
    }
}

/// Less than a level, by chance: a gradient rounded to 8 bits shows steps.
fn grain(x: usize, y: usize) -> f32 {
    let mut chance = Chance::of(x as u64, y as u64);
    chance.share() - 0.5
}

/// Rolls off what is brighter than film takes, in front of any backdrop: highlights stay coloured instead of clipping.
fn shoulder(light: Vec3, coverage: f32) -> Vec3 {
    /// Where the curve leaves the straight line.
    const KNEE: f32 = 0.6;
    if coverage <= 0.0 {
        return Vec3::ZERO;
    }
    let own = light / coverage;
    let rolled =
        own.map(|v| if v > KNEE { KNEE + (1.0 - KNEE) * (1.0 - (-(v - KNEE) / (1.0 - KNEE)).exp()) } else { v });
    rolled * coverage
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_picture_leaves_its_backdrop_as_it_was() {
        let image = RgbImage::from_fn(9, 7, |x, y| [x as u8 * 20, y as u8 * 30, 255]);
        let empty = Picture { linear: Plane::filled(9, 7, [0.0; 4]) };
        assert_eq!(empty.over(&Backdrop::Image(image.clone())), image);
        assert_eq!(empty.cut_out()[(3, 3)], [0; 4]);
        let wide = Picture { linear: Plane::filled(29, 14, [0.0; 4]) };
        let wide = wide.over(&Backdrop::Image(image.clone()));
        assert_eq!(wide[(0, 0)], image[(0, 0)], "edges go on beside it");
        let centre = wide[(14, 7)].map(i32::from);
        assert!(centre.iter().zip(image[(4, 3)]).all(|(a, b)| (a - i32::from(b)).abs() < 12), "{centre:?}");
    }
}
