//! From light to pixels: background, lens blur, sRGB, sensor noise, and masks from samples.

use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;
use strandflow_core::{Mask, Plane, RgbImage};

use crate::random::{normal, smooth_noise, stream};
use crate::spec::SynthSpec;

/// The plain, slightly uneven background of a view, linear.
pub(crate) fn background(spec: &SynthSpec, view: usize) -> Plane<Vec3> {
    let (w, h) = (spec.rig.width, spec.rig.height);
    let seed = crate::random::mix(spec.seed ^ (0x5eed + view as u64));
    let scale = 640.0 / w as f64;
    Plane::from_fn(w, h, |x, y| {
        let p = DVec3::new(x as f64, y as f64, 0.5) * scale;
        let falloff = 1.0 - 0.16 * (y as f64 / h as f64) - 0.10 * ((x as f64 / w as f64) - 0.45).powi(2);
        let uneven = 1.0 + 0.05 * smooth_noise(seed, p / 160.0) + 0.02 * smooth_noise(seed ^ 1, p / 23.0);
        let texture = 1.0 + 0.02 * smooth_noise(seed ^ 2, p / 3.1);
        Vec3::new(0.31, 0.45, 0.37) * (falloff * uneven * texture) as f32
    })
}

/// Standard deviation of the blur of a view \[px\].
fn blur_of(spec: &SynthSpec, view: usize) -> f64 {
    use rand::Rng;
    let out_of_focus: f64 = stream(spec.seed, &[30, view as u64]).random();
    spec.noise.blur_px.hypot(spec.noise.defocus_px * out_of_focus)
}

/// The light in a frame, of that in the first.
pub(crate) fn light_of(spec: &SynthSpec, frame: usize) -> f32 {
    let share = frame as f64 / spec.rig.frames as f64;
    (spec.noise.light_stops * (std::f64::consts::TAU * share).sin()).exp2() as f32
}

/// Lens, tone curve and sensor: a linear picture as the camera stores it. `exposure` tells pictures of one view apart.
pub(crate) fn expose(spec: &SynthSpec, view: usize, exposure: u64, linear: &Plane<Vec3>) -> RgbImage {
    let soft = blurred(linear, blur_of(spec, view));
    let sigma = spec.noise.image_sigma;
    let data = (0..soft.height)
        .into_par_iter()
        .flat_map_iter(|y| {
            let mut rng = stream(spec.seed, &[31, view as u64, exposure, y as u64]);
            soft.row(y)
                .iter()
                .map(|c| {
                    [c.x, c.y, c.z].map(|value| {
                        let noise = if sigma > 0.0 { sigma * normal(&mut rng) } else { 0.0 };
                        (255.0 * srgb(value as f64) + noise).round().clamp(0.0, 255.0) as u8
                    })
                })
                .collect::<Vec<_>>()
        })
        .collect();
    RgbImage { width: soft.width, height: soft.height, data }
}

/// The sRGB curve (IEC 61966-2-1) of a linear value, with a soft shoulder above 0.8.
fn srgb(linear: f64) -> f64 {
    let v = if linear > 0.8 { 0.8 + 0.2 * (1.0 - (-(linear - 0.8) / 0.2).exp()) } else { linear.max(0.0) };
    if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// Gaussian blur, edges repeated.
fn blurred(image: &Plane<Vec3>, sigma: f64) -> Plane<Vec3> {
    if sigma < 0.05 {
        return image.clone();
    }
    let reach = (3.0 * sigma).ceil() as isize;
    let mut kernel: Vec<f32> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp() as f32).collect();
    let sum: f32 = kernel.iter().sum();
    kernel.iter_mut().for_each(|k| *k /= sum);
    let pass = |source: &Plane<Vec3>, dx: isize, dy: isize| {
        let clamp = |v: isize, n: usize| v.clamp(0, n as isize - 1) as usize;
        let data = (0..source.height)
            .into_par_iter()
            .flat_map_iter(|y| {
                (0..source.width)
                    .map(|x| {
                        let sample = |k: isize| {
                            let at = |v: usize, d: isize, n| clamp(v as isize + k * d, n);
                            source[(at(x, dx, source.width), at(y, dy, source.height))]
                        };
                        kernel.iter().enumerate().map(|(i, w)| sample(i as isize - reach) * *w).sum()
                    })
                    .collect::<Vec<Vec3>>()
            })
            .collect();
        Plane { width: source.width, height: source.height, data }
    };
    pass(&pass(image, 1, 0), 0, 1)
}

/// A mask whose outline a careless hand has moved by about `mask_px`.
pub(crate) fn careless(spec: &SynthSpec, view: usize, mask: &Mask) -> Mask {
    let size = spec.noise.mask_px;
    if size == 0.0 {
        return mask.clone();
    }
    let seed = crate::random::mix(spec.seed ^ (0x3a5c + view as u64));
    Mask::from_fn(mask.width, mask.height, |x, y| {
        let p = DVec3::new(x as f64, y as f64, 0.5) / 14.0;
        // Value noise has a standard deviation of about 0.4.
        let by = DVec2::new(smooth_noise(seed, p), smooth_noise(seed ^ 1, p)) * size / 0.4;
        let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) + by;
        mask.at_point(at.x, at.y).copied().unwrap_or(0)
    })
}
