//! Pooling of orientation evidence along the lines themselves.
//!
//! Reference: Cabral & Leedom 1993 (line integrals along a vector field); Granlund & Knutsson 1995 (doubled angle).

use glam::Vec4;
use rayon::prelude::*;
use strandflow_core::Plane;

use crate::{filter::gaussian, gabor::OrientationEnergy};

/// Gaussian pooling with one sigma \[px\] in every direction.
pub fn isotropic(energy: &OrientationEnergy, sigma: f32) -> OrientationEnergy {
    energy.each(|plane| gaussian(plane, sigma))
}

/// Pools `energy` along the lines of the `guide` field with a Gaussian of `sigma` \[px\] of arc length (to 2 sigma).
///
/// Lines are followed in steps of `step` \[px\], [`LONGEST_STEP`] at most, through the nearest guide vector, so the window
/// bends with the lines; it ends where `inside` does or where the line turns by more than 60° in a step (another layer of
/// lines).
pub fn along_lines(
    energy: &OrientationEnergy,
    guide: &OrientationEnergy,
    inside: &Plane<bool>,
    (sigma, step): (f32, f32),
) -> OrientationEnergy {
    debug_assert!(step <= LONGEST_STEP as f32);
    let (width, height) = (inside.width, inside.height);
    let reach = (2.0 * sigma / step).round().max(1.0) as usize;
    let weights: Vec<f32> = (0..=reach).map(|i| (-0.5 * (i as f32 * step / sigma).powi(2)).exp()).collect();
    let field = Field::new(energy, guide, inside);
    let mut out = [0, 1, 2].map(|_| Plane::filled(width, height, 0.0f32));
    let [cos2, sin2, total] = &mut out;
    let rows =
        cos2.data.par_chunks_mut(width).zip(sin2.data.par_chunks_mut(width)).zip(total.data.par_chunks_mut(width));
    rows.enumerate().for_each(|(y, ((cos2, sin2), total))| {
        let columns: Vec<usize> = (0..width).filter(|&x| inside[(x, y)]).collect();
        for columns in columns.chunks(TOGETHER) {
            // What is left at the end of a row fills up with itself.
            let pixels = std::array::from_fn(|lane| [columns[lane % columns.len()], y]);
            for (&x, pooled) in columns.iter().zip(field.pooled(pixels, &weights, step)) {
                [cos2[x], sin2[x], total[x]] = pooled;
            }
        }
    });
    let [cos2, sin2, total] = out;
    OrientationEnergy { cos2, sin2, total }
}

/// Longest way between two samples of a line \[px\].
pub const LONGEST_STEP: usize = 2;

/// Width of the border: a step, and a pixel since a rounded step may be longer by a bit.
const BORDER: usize = LONGEST_STEP + 1;

/// Pixels whose lines are followed at once, both ways each: every line waits for its cells, and the others go on meanwhile.
const TOGETHER: usize = 8;
const LANES: usize = 2 * TOGETHER;

/// What a line meets in a pixel, on one half of a cache line.
#[derive(Clone, Copy, Default)]
#[repr(align(32))]
struct Cell {
    /// The energies (cos, sin, total), and one.
    energy: Vec4,
    /// Unit direction of the guide; zero outside, where every line ends.
    direction: [f32; 2],
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
            let length = (c * c + s * s).sqrt();
            let cosine = if length > 0.0 { c / length } else { 1.0 };
            let direction =
                [(0.5 * (1.0 + cosine)).max(0.0).sqrt(), (0.5 * (1.0 - cosine)).max(0.0).sqrt().copysign(s)];
            let at = (i / inside.width + BORDER) * stride + i % inside.width + BORDER;
            let energy = Vec4::new(energy.cos2.data[i], energy.sin2.data[i], energy.total.data[i], 1.0);
            cells[at] = Cell { energy, direction };
        }
        Self { stride, cells }
    }

    /// The weighted means of the energies along the lines through pixels (column, row). On the widest registers there are;
    /// the same operations in the same order on all.
    fn pooled(&self, pixels: [[usize; 2]; TOGETHER], weights: &[f32], step: f32) -> [[f32; 3]; TOGETHER] {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the feature has just been detected.
            return unsafe { self.pooled_avx2(pixels, weights, step) };
        }
        self.pooled_lanes(pixels, weights, step)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    unsafe fn pooled_avx2(&self, pixels: [[usize; 2]; TOGETHER], weights: &[f32], step: f32) -> [[f32; 3]; TOGETHER] {
        self.pooled_lanes(pixels, weights, step)
    }

    #[inline(always)]
    fn pooled_lanes(&self, pixels: [[usize; 2]; TOGETHER], weights: &[f32], step: f32) -> [[f32; 3]; TOGETHER] {
        let starts = pixels.map(|[x, y]| &self.cells[(y + BORDER) * self.stride + x + BORDER]);
        let mut sums = starts.map(|cell| cell.energy * weights[0]);
        // Lane 2 i goes forwards from pixel i, lane 2 i + 1 backwards. A line that ended stands still.
        let mut u: [f32; LANES] = std::array::from_fn(|lane| (pixels[lane / 2][0] + BORDER) as f32 + 0.5);
        let mut v: [f32; LANES] = std::array::from_fn(|lane| (pixels[lane / 2][1] + BORDER) as f32 + 0.5);
        let way = |lane: usize| if lane.is_multiple_of(2) { step } else { -step };
        let mut dx: [f32; LANES] = std::array::from_fn(|lane| starts[lane / 2].direction[0] * way(lane));
        let mut dy: [f32; LANES] = std::array::from_fn(|lane| starts[lane / 2].direction[1] * way(lane));
        for &weight in &weights[1..] {
            for lane in 0..LANES {
                u[lane] += dx[lane];
                v[lane] += dy[lane];
            }
            let (column, row, stride) = (truncated(u), truncated(v), self.stride as i32);
            let at: [i32; LANES] =
                std::array::from_fn(|lane| row[lane].wrapping_mul(stride).wrapping_add(column[lane]));
            let cells = at.map(|at| self.cells.get(at as usize).unwrap_or(&self.cells[0]));
            let nx: [f32; LANES] = std::array::from_fn(|lane| cells[lane].direction[0]);
            let ny: [f32; LANES] = std::array::from_fn(|lane| cells[lane].direction[1]);
            let mut share = [0.0f32; LANES];
            for lane in 0..LANES {
                let turn = nx[lane] * dx[lane] + ny[lane] * dy[lane];
                let goes_on = turn.abs() >= 0.5 * step;
                let along = if goes_on { step.copysign(turn) } else { 0.0 };
                share[lane] = if goes_on { weight } else { 0.0 };
                (dx[lane], dy[lane]) = (along * nx[lane], along * ny[lane]);
            }
            for (pixel, sum) in sums.iter_mut().enumerate() {
                *sum += cells[2 * pixel].energy * share[2 * pixel];
                *sum += cells[2 * pixel + 1].energy * share[2 * pixel + 1];
            }
        }
        sums.map(|sum| (sum.truncate() / sum.w).to_array())
    }
}

/// The integers towards zero. What no integer holds is none or the lowest, as the machine has it.
#[inline(always)]
fn truncated(values: [f32; LANES]) -> [i32; LANES] {
    let mut out = [0; LANES];
    #[cfg(target_arch = "x86_64")]
    for (out, values) in out.chunks_exact_mut(4).zip(values.chunks_exact(4)) {
        use std::arch::x86_64::{_mm_cvttps_epi32, _mm_loadu_ps, _mm_storeu_si128};
        // SAFETY: all of x86-64 has these; four values are read and four written, at any alignment.
        unsafe { _mm_storeu_si128(out.as_mut_ptr().cast(), _mm_cvttps_epi32(_mm_loadu_ps(values.as_ptr()))) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    out.iter_mut().zip(values).for_each(|(out, value)| *out = value as i32);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_registers_give_the_same_bits_and_lines_end_where_the_inside_does() {
        let (width, height) = (61, 40);
        let plane = |k: usize| Plane::from_fn(width, height, |x, y| ((x * x + k * y * x + 7 * y) % 97) as f32 - 48.0);
        let energy = OrientationEnergy { cos2: plane(3), sin2: plane(5), total: plane(11).map(|v| v + 100.0) };
        let inside = Plane::from_fn(width, height, |x, y| (x as f32 - 30.0).hypot(y as f32 - 20.0) < 17.0);
        let weights = [1.0, 0.9, 0.7, 0.4, 0.2];
        let field = Field::new(&energy, &isotropic(&energy, 3.0), &inside);
        for y in 4..36 {
            let pixels = std::array::from_fn(|lane| [26 + lane, y]);
            for step in [1.0, 2.0] {
                assert_eq!(field.pooled(pixels, &weights, step), field.pooled_lanes(pixels, &weights, step));
            }
        }
        // A line of its own: across a constant field the mean is that of the row's inside.
        let along_x = OrientationEnergy { cos2: plane(0).map(|_| 1.0), ..OrientationEnergy::zero(width, height) };
        let field = Field::new(&energy, &along_x, &inside);
        let [found, ..] = field.pooled([[15, 20]; TOGETHER], &weights, 2.0);
        let row = [(15, 1.0), (17, 0.9), (19, 0.7), (21, 0.4), (23, 0.2), (13, 0.0)];
        let mean = |of: &Plane<f32>| {
            let (sum, all) = row.iter().fold((0.0, 0.0), |(s, a), &(x, w)| (s + w * of[(x, 20)], a + w));
            sum / all
        };
        assert!(inside[(14, 20)] && !inside[(13, 20)]);
        assert!((found[0] - mean(&energy.cos2)).abs() < 1e-4 && (found[2] - mean(&energy.total)).abs() < 1e-4);
    }
}
