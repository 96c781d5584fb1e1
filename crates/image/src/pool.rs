//! Pooling of orientation evidence along the lines themselves.
//!
//! Reference: Cabral & Leedom 1993 (line integrals along a vector field); Granlund & Knutsson 1995 (doubled angle).

use rayon::prelude::*;
use strandflow_core::Plane;

use crate::{filter::gaussian, gabor::OrientationEnergy};

/// Gaussian pooling with one sigma \[px\] in every direction.
pub fn isotropic(energy: &OrientationEnergy, sigma: f32) -> OrientationEnergy {
    let blur = |plane| gaussian(plane, sigma);
    OrientationEnergy { cos2: blur(&energy.cos2), sin2: blur(&energy.sin2), total: blur(&energy.total) }
}

/// Pools `energy` along the lines of the `guide` field with a Gaussian of `sigma` \[px\] of arc length (to 2 sigma).
///
/// Lines are followed in steps of two pixels through the nearest guide vector, so the window bends with the lines; it
/// ends where `inside` does or where the line turns by more than 60° in a step (another layer of lines).
pub fn along_lines(
    energy: &OrientationEnergy,
    guide: &OrientationEnergy,
    inside: &Plane<bool>,
    sigma: f32,
) -> OrientationEnergy {
    let (width, height) = (inside.width, inside.height);
    let reach = (2.0 * sigma / STEP as f32).round().max(1.0) as usize;
    let weights: Vec<f32> = (0..=reach).map(|i| (-0.5 * ((i * STEP) as f32 / sigma).powi(2)).exp()).collect();
    let field = Field::new(energy, guide, inside);
    let mut out = [0, 1, 2].map(|_| Plane::filled(width, height, 0.0f32));
    let [cos2, sin2, total] = &mut out;
    let rows =
        cos2.data.par_chunks_mut(width).zip(sin2.data.par_chunks_mut(width)).zip(total.data.par_chunks_mut(width));
    rows.enumerate().for_each(|(y, ((cos2, sin2), total))| {
        for x in (0..width).filter(|&x| inside[(x, y)]) {
            [cos2[x], sin2[x], total[x]] = field.pooled(x, y, &weights);
        }
    });
    let [cos2, sin2, total] = out;
    OrientationEnergy { cos2, sin2, total }
}

/// Way between two samples of a line \[px\].
const STEP: usize = 2;

/// Width of the border: a step, and a pixel since a rounded step may be longer by a bit.
const BORDER: usize = STEP + 1;

/// What a line meets in a pixel, on one half of a cache line.
#[derive(Clone, Copy, Default)]
#[repr(align(32))]
struct Cell {
    /// Unit direction of the guide; zero outside, where every line ends.
    direction: [f32; 2],
    energy: [f32; 3],
}

/// The cells with a border that no line crosses.
struct Field {
    stride: usize,
    cells: Vec<Cell>,
}

impl Field {
    fn new(energy: &OrientationEnergy, guide: &OrientationEnergy, inside: &Plane<bool>) -> Self {
        let stride = inside.width + 2 * BORDER;
        let mut cells = vec![Cell::default(); stride * (inside.height + 2 * BORDER)];
        for (i, _) in inside.data.iter().enumerate().filter(|(_, inside)| **inside) {
            // Half of the doubled angle, without an angle.
            let (c, s) = (guide.cos2.data[i], guide.sin2.data[i]);
            let length = c.hypot(s);
            let cosine = if length > 0.0 { c / length } else { 1.0 };
            let direction =
                [(0.5 * (1.0 + cosine)).max(0.0).sqrt(), (0.5 * (1.0 - cosine)).max(0.0).sqrt().copysign(s)];
            let at = (i / inside.width + BORDER) * stride + i % inside.width + BORDER;
            cells[at] = Cell { direction, energy: [energy.cos2.data[i], energy.sin2.data[i], energy.total.data[i]] };
        }
        Self { stride, cells }
    }

    /// The weighted mean of the energies along the line through a pixel.
    fn pooled(&self, x: usize, y: usize, weights: &[f32]) -> [f32; 3] {
        let start = &self.cells[(y + BORDER) * self.stride + x + BORDER];
        let (mut sum, mut norm) = (start.energy.map(|e| weights[0] * e), weights[0]);
        // Both ways at once, so that one waits for its cell while the other computes. A line that ended stands still.
        let [dx, dy] = start.direction.map(|d| d * STEP as f32);
        let at = [(x + BORDER) as f32 + 0.5, (y + BORDER) as f32 + 0.5];
        let mut lines = [(at, [dx, dy]), (at, [-dx, -dy])];
        for &weight in &weights[1..] {
            for ([u, v], [dx, dy]) in &mut lines {
                (*u, *v) = (*u + *dx, *v + *dy);
                let cell = &self.cells[*v as i32 as usize * self.stride + *u as i32 as usize];
                let [nx, ny] = cell.direction;
                let turn = nx * *dx + ny * *dy;
                let goes_on = turn.abs() >= 0.5 * STEP as f32;
                let along = if goes_on { (STEP as f32).copysign(turn) } else { 0.0 };
                let weight = if goes_on { weight } else { 0.0 };
                (*dx, *dy) = (along * nx, along * ny);
                (0..3).for_each(|k| sum[k] += weight * cell.energy[k]);
                norm += weight;
            }
        }
        sum.map(|s| s / norm)
    }
}
