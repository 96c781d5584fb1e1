//! Light from all around: how much of the dome a place inside the hair still sees.

use glam::Vec3;
use rayon::prelude::*;

use crate::{groom::Grown, shadow::Surface};

/// Edge of a voxel \[mm\]: light from all around has no finer shadows.
const VOXEL_MM: f32 = 6.0;

/// Optical depth of the head \[1/mm\]: one voxel hides most.
const HEAD_PER_MM: f32 = 0.4;

/// Share of optical depth that takes light away; the rest is scattered on. At 1 the inside of the hair is black.
const LOST: f32 = 0.55;

/// Shares of the dome that are seen.
pub(crate) struct Dome {
    low: Vec3,
    dims: [usize; 3],
    seen: Vec<f32>,
}

impl Dome {
    /// From hairs `width_mm` thick and the head, brightest towards `up`.
    pub(crate) fn new(hair: &Grown, width_mm: f32, head: Option<&Surface>, up: Vec3) -> Self {
        let none = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let hairs = hair.points.iter().step_by(7).copied();
        let all = hairs.chain(head.iter().flat_map(|head| head.vertices.iter().copied()));
        let (low, high) = all.fold(none, |(low, high), p| (low.min(p), high.max(p)));
        let low = low - 2.0 * VOXEL_MM;
        let dims = ((high - low) / VOXEL_MM).to_array().map(|n| (n as usize + 3).min(400));
        let mut dome = Self { low, dims, seen: Vec::new() };
        let density = dome.density(hair, width_mm, head);
        dome.seen = dome.visibility(&density, up);
        dome
    }

    /// Optical depth of a voxel's edge.
    fn density(&self, hair: &Grown, width_mm: f32, head: Option<&Surface>) -> Vec<f32> {
        /// Every seventh point stands for its neighbours; a voxel holds hundreds.
        const STEP: usize = 7;
        let mut counts = vec![0.0f32; self.dims.iter().product()];
        let points = &hair.points;
        let mean_edge = points
            .windows(2)
            .step_by(101)
            .map(|pair| pair[0].distance(pair[1]))
            .filter(|edge| *edge < 20.0)
            .fold((0.0, 0.0), |(sum, n), edge| (sum + edge, n + 1.0));
        let edge = if mean_edge.1 > 0.0 { mean_edge.0 / mean_edge.1 } else { 0.0 };
        let of_point = STEP as f32 * std::f32::consts::FRAC_PI_4 * width_mm * edge / (VOXEL_MM * VOXEL_MM);
        for p in points.iter().step_by(STEP) {
            counts[self.voxel(*p)] += of_point;
        }
        if let Some(head) = head {
            self.fill_head(head, &mut counts);
        }
        counts
    }

    /// Between the lowest and the highest point of the surface in each column: exact where no column leaves the head twice.
    fn fill_head(&self, head: &Surface, density: &mut [f32]) {
        let [nx, ny, _] = self.dims;
        let mut spans = vec![(f32::INFINITY, f32::NEG_INFINITY); nx * ny];
        for face in head.faces {
            let corners = face.map(|v| (head.vertices[v as usize] - self.low) / VOXEL_MM);
            // Faces are as small as voxels: corners, edges' middles and the centre meet every column that matters.
            let [a, b, c] = corners;
            for p in [a, b, c, (a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5, (a + b + c) / 3.0] {
                let span = &mut spans[(p.y as usize).min(ny - 1) * nx + (p.x as usize).min(nx - 1)];
                *span = (span.0.min(p.z), span.1.max(p.z));
            }
        }
        for (i, value) in density.iter_mut().enumerate() {
            let (low, high) = spans[i % (nx * ny)];
            let z = (i / (nx * ny)) as f32 + 0.5;
            if z > low + 0.5 && z < high - 0.5 {
                *value += HEAD_PER_MM * VOXEL_MM;
            }
        }
    }

    fn visibility(&self, density: &[f32], up: Vec3) -> Vec<f32> {
        let directions: Vec<[isize; 3]> = (0..27)
            .map(|i| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1])
            .filter(|d| matches!(d.iter().map(|c| c * c).sum::<isize>(), 1 | 3))
            .collect();
        let weight = |d: &[isize; 3]| 0.55 + 0.45 * Vec3::from_array(d.map(|c| c as f32)).normalize().dot(up);
        let shares: Vec<Vec<f32>> = directions.par_iter().map(|d| self.along(density, *d)).collect();
        let whole: f32 = directions.iter().map(weight).sum();
        let weights: Vec<f32> = directions.iter().map(|d| weight(d) / whole).collect();
        (0..density.len()).into_par_iter().map(|i| shares.iter().zip(&weights).map(|(s, w)| s[i] * w).sum()).collect()
    }

    /// Share of light that reaches each voxel from one direction of the lattice.
    fn along(&self, density: &[f32], direction: [isize; 3]) -> Vec<f32> {
        let [nx, ny, nz] = self.dims;
        let step = direction.iter().map(|c| (c * c) as f32).sum::<f32>().sqrt();
        let mut depth = vec![0.0f32; density.len()];
        // Voxels nearer to the light first.
        let ordered = |n: usize, d: isize, k: usize| if d > 0 { n - 1 - k } else { k };
        let towards = |at: usize, d: isize, n: usize| at.checked_add_signed(d).filter(|&to| to < n);
        for kz in 0..nz {
            let z = ordered(nz, direction[2], kz);
            let Some(z1) = towards(z, direction[2], nz) else { continue };
            for ky in 0..ny {
                let y = ordered(ny, direction[1], ky);
                let Some(y1) = towards(y, direction[1], ny) else { continue };
                for kx in 0..nx {
                    let x = ordered(nx, direction[0], kx);
                    let Some(x1) = towards(x, direction[0], nx) else { continue };
                    let (i, before) = ((z * ny + y) * nx + x, (z1 * ny + y1) * nx + x1);
                    depth[i] = depth[before] + 0.5 * step * (density[i] + density[before]);
                }
            }
        }
        depth.iter_mut().for_each(|d| *d = (-LOST * *d).exp());
        depth
    }

    fn voxel(&self, p: Vec3) -> usize {
        let [nx, ny, nz] = self.dims;
        let c = ((p - self.low) / VOXEL_MM).max(Vec3::ZERO);
        ((c.z as usize).min(nz - 1) * ny + (c.y as usize).min(ny - 1)) * nx + (c.x as usize).min(nx - 1)
    }

    /// Share of the dome that a place sees, 0 to 1.
    pub(crate) fn seen(&self, p: Vec3) -> f32 {
        let [nx, ny, nz] = self.dims;
        let limit = Vec3::new(nx as f32, ny as f32, nz as f32) - 1.001;
        let c = ((p - self.low) / VOXEL_MM - 0.5).clamp(Vec3::ZERO, limit);
        let (base, f) = (c.floor(), c.fract());
        let i = (base.z as usize * ny + base.y as usize) * nx + base.x as usize;
        let row = |i: usize| self.seen[i] + (self.seen[i + 1] - self.seen[i]) * f.x;
        let layer = |i: usize| row(i) + (row(i + nx) - row(i)) * f.y;
        layer(i) + (layer(i + nx * ny) - layer(i)) * f.z
    }
}
