//! Light in hair: transmittance through the hair's density, and the reflection of a fibre.
//!
//! References: Marschner et al. 2003 (longitudinal lobes R and TRT), Kajiya and Kay 1989 (diffuse term); the density
//! volume is the voxel form of deep shadow maps (Lokovic and Veach 2000).

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use strandflow_core::Grid;

use crate::head::distance;
use crate::spec::SynthSpec;

/// A distant light.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Light {
    /// Unit direction towards the light, world.
    pub towards: Vec3,
    /// Strength.
    pub strength: f32,
}

/// The studio: a key from above and behind, two fills, a little from the front.
pub(crate) fn lights() -> [Light; 4] {
    let light = |x: f32, y: f32, z: f32, strength| Light { towards: Vec3::new(x, y, z).normalize(), strength };
    [
        light(0.35, 0.75, 1.0, 1.25),
        light(-0.95, 0.35, 0.45, 0.55),
        light(0.95, 0.1, 0.35, 0.5),
        light(0.1, -0.9, 0.7, 0.45),
    ]
}

/// Optical depth of the hair per millimetre, and opaque where the head is.
pub(crate) struct Density {
    grid: Grid,
    origin: Vec3,
    per_mm: f32,
    values: Vec<f32>,
}

impl Density {
    /// From strands in the head frame. Exactly the same at any thread count: lengths are counted in whole samples.
    pub(crate) fn new(spec: &SynthSpec, strands: &[Vec<DVec3>], head_opacity: &[f32], grid: Grid) -> Self {
        const SAMPLES: usize = 2;
        let mut counts = vec![0u32; grid.len()];
        for strand in strands {
            for pair in strand.windows(2) {
                for s in 0..SAMPLES {
                    let p = pair[0].lerp(pair[1], (s as f64 + 0.5) / SAMPLES as f64);
                    if let Some(voxel) = grid.voxel_at(p) {
                        counts[grid.index(voxel)] += 1;
                    }
                }
            }
        }
        // A fibre of width w and length l shadows w·l·sin θ; the mean of sin θ is π/4. Half of the light goes on.
        let of_sample = 0.5 * std::f64::consts::FRAC_PI_4 * spec.groom.width_mm * spec.groom.edge_mm
            / SAMPLES as f64
            / grid.voxel_mm.powi(3);
        let mut values: Vec<f32> = counts.iter().map(|&c| (c as f64 * of_sample) as f32).collect();
        for stride in [1, grid.dims[0], grid.dims[0] * grid.dims[1]] {
            values = blurred(&values, stride);
        }
        for (value, head) in values.iter_mut().zip(head_opacity) {
            *value += head;
        }
        Self { grid, origin: grid.origin.as_vec3(), per_mm: 1.0 / grid.voxel_mm as f32, values }
    }

    /// Share of a light that reaches a point (head frame) from a direction.
    pub(crate) fn transmittance(&self, p: Vec3, towards: Vec3) -> f32 {
        let (mut depth, mut t, mut step) = (0.0f32, 2.0f32, 2.5f32);
        for _ in 0..10 {
            depth += self.at(p + towards * (t + 0.5 * step)) * step;
            t += step;
            step *= 1.3;
            if depth > 5.0 {
                return 0.0;
            }
        }
        (-depth).exp()
    }

    /// Trilinear interpolation; zero outside.
    fn at(&self, p: Vec3) -> f32 {
        let c = (p - self.origin) * self.per_mm - 0.5;
        let base = c.floor();
        let [nx, ny, nz] = self.grid.dims;
        let limit = Vec3::new(nx as f32, ny as f32, nz as f32) - 1.0;
        if base.cmplt(Vec3::ZERO).any() || base.cmpge(limit).any() {
            return 0.0;
        }
        let f = c - base;
        let i = self.grid.index([base.x as usize, base.y as usize, base.z as usize]);
        let row = |i: usize| self.values[i] + (self.values[i + 1] - self.values[i]) * f.x;
        let layer = |i: usize| row(i) + (row(i + nx) - row(i)) * f.y;
        layer(i) + (layer(i + nx * ny) - layer(i)) * f.z
    }
}

/// The grid of the density, head frame, with room for hair that swings.
pub(crate) fn density_grid(spec: &SynthSpec) -> Grid {
    let below = spec.groom.cut_below_mm.max(60.0) + 90.0;
    let voxel_mm = 4.0;
    let size = DVec3::new(400.0, 440.0, below + 190.0);
    let dims = (size / voxel_mm).ceil().as_uvec3().to_array().map(|n| n as usize);
    Grid { origin: DVec3::new(-200.0, -220.0, -below), voxel_mm, dims }
}

/// Optical depth per millimetre of the head on a grid.
pub(crate) fn head_opacity(grid: &Grid) -> Vec<f32> {
    (0..grid.len()).into_par_iter().map(|i| if distance(grid.centre_of_index(i)) < -3.0 { 0.4 } else { 0.0 }).collect()
}

fn blurred(values: &[f32], stride: usize) -> Vec<f32> {
    (0..values.len())
        .into_par_iter()
        .map(|i| {
            let before = if i >= stride { values[i - stride] } else { 0.0 };
            0.5 * values[i] + 0.25 * (before + values.get(i + stride).copied().unwrap_or(0.0))
        })
        .collect()
}

/// Light that a fibre returns towards the viewer: (neutral highlight, coloured part) for unit tangent `t` (root to
/// tip), direction to the light `l` and to the viewer `v`.
pub(crate) fn fibre(t: Vec3, l: Vec3, v: Vec3) -> (f32, f32) {
    let (sin_l, sin_v) = (t.dot(l).clamp(-1.0, 1.0), t.dot(v).clamp(-1.0, 1.0));
    let (theta_l, theta_v) = (sin_l.asin(), sin_v.asin());
    let half = 0.5 * (theta_l + theta_v);
    let lobe = |shift: f32, width: f32| (-0.5 * ((half - shift) / width).powi(2)).exp();
    let across = |d: Vec3, s: f32| (d - t * s).normalize_or_zero();
    let cos_phi = across(l, sin_l).dot(across(v, sin_v));
    let cos_l = (1.0 - sin_l * sin_l).max(0.0).sqrt();
    // R is shifted towards the root (−5°), TRT towards the tip (+7.5°); widths 8° and 15° (Marschner et al. 2003 §5).
    let r = lobe(-0.087, 0.14) * (0.5 * (1.0 + cos_phi)).max(0.0).sqrt();
    let trt = lobe(0.131, 0.26) * (0.25 + 0.75 * cos_phi.max(0.0).powi(2));
    let diffuse = cos_l * (0.35 + 0.65 * (0.5 + 0.5 * cos_phi));
    (0.055 * r * cos_l, 0.42 * trt * cos_l + 0.52 * diffuse)
}
