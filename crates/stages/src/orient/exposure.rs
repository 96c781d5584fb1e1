//! Where hair is overexposed, its texture is gone.

use strandflow_core::{Plane, RgbImage};
use strandflow_image::{filter::gaussian_where, region::Region};

/// Code value from which on a channel counts as clipped: sensors and codecs end a few codes below 255. Lower, and highlights
/// that still have texture are lost.
const CLIPPED: u8 = 250;
/// Local share of clipped pixels up to which nothing is lost: single glints are texture, and the best of it.
const GLINTS: f32 = 0.15;
/// Local share from which on nothing is believed, be the pixel itself clipped or not: the border of a clipped patch, where its
/// outline is all the filters see.
const PATCH: f32 = 0.5;

/// What is overexposed of the hair.
pub struct Exposure {
    /// Share of the hair's pixels with a clipped channel.
    pub share: f32,
    /// What is left of each pixel's trust, 0 to 1; `None` where all of it is everywhere.
    pub trust: Option<Plane<f32>>,
}

/// The exposure of the hair in a region of an image; `reach_px`: sigma of the widest filter.
pub fn exposure(image: &RgbImage, region: Region, inside: &Plane<bool>, reach_px: f32) -> Exposure {
    let clipped = region.crop(image, |colour| colour.iter().any(|&c| c >= CLIPPED));
    let (mut hair, mut lost) = (0usize, 0usize);
    for (inside, clipped) in inside.data.iter().zip(&clipped.data) {
        hair += usize::from(*inside);
        lost += usize::from(*inside && *clipped);
    }
    let share = lost as f32 / hair.max(1) as f32;
    if lost == 0 {
        return Exposure { share, trust: None };
    }
    let code = |is: &bool| f32::from(u8::from(*is));
    let around = gaussian_where(&clipped.map(code), &inside.map(code), reach_px);
    let left = |(&around, &clipped): (&f32, &bool)| match around {
        around if around <= GLINTS => 1.0,
        _ if clipped => 0.0,
        around => 1.0 - ((around - GLINTS) / (PATCH - GLINTS)).min(1.0),
    };
    let data = around.data.iter().zip(&clipped.data).map(left).collect();
    Exposure { share, trust: Some(Plane { data, ..around }) }
}
