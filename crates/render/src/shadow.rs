//! Deep shadows: the optical depth of the hair between a point and a light, in a volume that stands along the light.
//!
//! The volume form of deep shadow maps (Lokovic and Veach 2000): columns along the light, each the running sum of the hair
//! in it, so that the depth in front of any point is one interpolation. The head is a height field, added to the same columns.

use glam::{Mat3, UVec2, Vec2, Vec3};
use rayon::prelude::*;

use crate::{chance::Chance, groom::Grown};

/// Width of a column \[mm\]. Below 1.5 mm cells hold too few pieces of hair and shadows are noise; above 3 mm locks throw none.
const CELL_MM: f32 = 2.2;

/// Most cells of a volume: 64 MB. A larger scene has wider columns.
const MAX_CELLS: f32 = 16e6;

/// Optical depth of one count. Sums of whole counts are the same in any order, whatever the threads do.
const COUNT: f32 = 1.0 / 16384.0;

/// Most cells of all volumes that are filled beside one another, one a thread: 128 MB. Threads that add to one volume wait for
/// one another at every piece.
const MAX_PRIVATE_CELLS: usize = 32_000_000;

/// Depth by which the head must be in front of a point to hide it from the light \[mm\], and over how much more its shadow
/// fades in: roots sit on the head, and its surface is known to some millimetres.
const HEAD_BIAS_MM: f32 = 4.0;
const HEAD_FADE_MM: f32 = 10.0;

/// Optical depth of the head.
const HEAD_DEPTH: f32 = 7.0;

/// The optical depth towards one light.
pub(crate) struct Shadow {
    /// Rows: across, across, away from the light.
    axes: Mat3,
    low: Vec3,
    per_mm: f32,
    /// Columns, columns, layers.
    dims: [usize; 3],
    /// Depth in front of each layer, column by column; one more a column than layers.
    depth: Vec<f32>,
}

/// The head's surface, world \[mm\].
pub(crate) struct Surface<'a> {
    /// Vertices.
    pub vertices: &'a [Vec3],
    /// Vertex indices.
    pub faces: &'a [[u32; 3]],
}

impl Shadow {
    /// From hairs `width_mm` thick, and the head.
    pub(crate) fn new(towards: Vec3, hair: &Grown, width_mm: f32, head: Option<&Surface>) -> Self {
        let (a, b) = towards.any_orthonormal_pair();
        let axes = Mat3::from_cols(a, b, -towards).transpose();
        let (mut low, mut high) = bounds(&axes, &hair.points);
        if let Some(head) = head {
            let (nearest, farthest) = bounds(&axes, head.vertices);
            (low.z, high.z) = (low.z.min(nearest.z), high.z.max(farthest.z));
        }
        let size = high - low;
        let cell = CELL_MM.max((size.x * size.y * size.z / MAX_CELLS).cbrt());
        let dims = (size / cell).ceil().max(Vec3::ONE).to_array().map(|n| n as usize + 1);
        let mut shadow = Self { axes, low, per_mm: 1.0 / cell, dims, depth: Vec::new() };
        let counts = shadow.counts(hair, width_mm, cell);
        shadow.depth = shadow.summed(&counts, &shadow.head_distance(head));
        shadow
    }

    /// Hair in each cell, in parts to be added up; column by column.
    ///
    /// Every third piece stands for three: cells hold some of several hairs. Of 56,000 hairs every second one gives pictures
    /// that differ by a sixth of a level of 8 bits.
    fn counts(&self, hair: &Grown, width_mm: f32, cell: f32) -> Vec<Vec<u32>> {
        const STEP: usize = 3;
        let [nx, ny, nz] = self.dims;
        let cells = nx * ny * nz;
        let parts = rayon::current_num_threads().min(MAX_PRIVATE_CELLS / cells).max(1);
        let of_mm = STEP as f32 * width_mm / (cell * cell) / COUNT;
        let strands: Vec<usize> = (0..hair.counts.len()).collect();
        let parts = strands.par_chunks(strands.len().div_ceil(parts).max(1)).map(|strands| {
            let mut counts = vec![0u32; cells];
            let mut of_strand: Vec<(u32, u32)> = Vec::new();
            for &n in strands {
                let points = &hair.points[hair.starts[n]..hair.starts[n + 1]];
                // Points lie equally far along all strands of a take: places drawn by chance keep that out of the shadows.
                let mut chance = Chance::of(0x5ad0, n as u64);
                of_strand.clear();
                for (child, strand) in points.chunks(hair.counts[n].max(1)).enumerate() {
                    for pair in strand.windows(2).skip(child % STEP).step_by(STEP) {
                        let (a, b) = (self.axes * pair[0], self.axes * pair[1]);
                        let across = (b - a).truncate().length();
                        let spread = Vec3::new(chance.share() - 0.5, chance.share() - 0.5, 0.0);
                        let at = (a.lerp(b, chance.share()) - self.low) * self.per_mm + spread;
                        let [x, y, z] = at.max(Vec3::ZERO).to_array().map(|c| c as usize);
                        let cell = (y.min(ny - 1) * nx + x.min(nx - 1)) * nz + z.min(nz - 1);
                        of_strand.push((cell as u32, (across * of_mm + 0.5) as u32));
                    }
                }
                // Cells lie all over the memory: in a loop that does nothing else many are waited for together.
                of_strand
                    .iter()
                    .for_each(|&(cell, count)| counts[cell as usize] = counts[cell as usize].saturating_add(count));
            }
            counts
        });
        parts.collect()
    }

    /// Depth in front of each layer: the hair of the layers before it, and the head as a point in the next layer meets it, whose
    /// own cell does not count.
    fn summed(&self, counts: &[Vec<u32>], head: &[f32]) -> Vec<f32> {
        let [nx, ny, nz] = self.dims;
        let mut depth = vec![0.0f32; nx * ny * (nz + 1)];
        let columns = depth.par_chunks_mut(nz + 1).zip(head).enumerate().with_min_len(64);
        columns.for_each(|(column, (depth, head))| {
            let mut sum = 0;
            for (k, depth) in depth.iter_mut().enumerate() {
                let into_head = ((k + 1) as f32 - head) / self.per_mm - HEAD_BIAS_MM;
                *depth = sum as f32 * COUNT + HEAD_DEPTH * (into_head / HEAD_FADE_MM).clamp(0.0, 1.0);
                if k < nz {
                    sum += counts.iter().map(|counts| u64::from(counts[column * nz + k])).sum::<u64>();
                }
            }
        });
        depth
    }

    /// Where the head begins in each column, seen from the light.
    fn head_distance(&self, head: Option<&Surface>) -> Vec<f32> {
        let [nx, ny, _] = self.dims;
        let mut nearest = vec![f32::INFINITY; nx * ny];
        let Some(head) = head else { return nearest };
        let seen: Vec<Vec3> = head.vertices.iter().map(|&v| (self.axes * v - self.low) * self.per_mm).collect();
        for face in head.faces {
            let [a, b, c] = face.map(|v| seen[v as usize]);
            let area = (b - a).truncate().perp_dot((c - a).truncate());
            if area.abs() < 1e-9 {
                continue;
            }
            let limit = Vec2::new(nx as f32, ny as f32);
            let low: UVec2 = (a.min(b).min(c).truncate() - 0.5).ceil().clamp(Vec2::ZERO, limit).as_uvec2();
            let high: UVec2 = (a.max(b).max(c).truncate() + 0.5).floor().clamp(Vec2::ZERO, limit).as_uvec2();
            for y in low.y..high.y {
                for x in low.x..high.x {
                    let p = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                    let wb = (p - a.truncate()).perp_dot((c - a).truncate()) / area;
                    let wc = (b - a).truncate().perp_dot(p - a.truncate()) / area;
                    if wb >= 0.0 && wc >= 0.0 && wb + wc <= 1.0 {
                        let z = a.z + (b.z - a.z) * wb + (c.z - a.z) * wc;
                        let cell = &mut nearest[y as usize * nx + x as usize];
                        *cell = cell.min(z);
                    }
                }
            }
        }
        nearest
    }

    /// Number of cells.
    pub(crate) fn cells(&self) -> usize {
        self.dims.iter().product()
    }

    /// Optical depth between the light and a point \[1\]; its own cell does not count.
    pub(crate) fn depth(&self, p: Vec3) -> f32 {
        let [nx, ny, nz] = self.dims;
        let at = (self.axes * p - self.low) * self.per_mm;
        let layer = (at.z - 1.0).clamp(0.0, nz as f32 - 1e-3);
        let (k, fz) = (layer as usize, layer.fract());
        let (x, y) = ((at.x - 0.5).clamp(0.0, nx as f32 - 1.001), (at.y - 0.5).clamp(0.0, ny as f32 - 1.001));
        let (i, j, fx, fy) = (x as usize, y as usize, x.fract(), y.fract());
        let (right, below) = ((i + 1).min(nx - 1), (j + 1).min(ny - 1));
        let column = |i: usize, j: usize| {
            let from = (j * nx + i) * (nz + 1) + k;
            self.depth[from] + (self.depth[from + 1] - self.depth[from]) * fz
        };
        let top = column(i, j) * (1.0 - fx) + column(right, j) * fx;
        let bottom = column(i, below) * (1.0 - fx) + column(right, below) * fx;
        top + (bottom - top) * fy
    }
}

/// The box around points along some axes.
fn bounds(axes: &Mat3, points: &[Vec3]) -> (Vec3, Vec3) {
    let none = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    points
        .par_chunks(1 << 14)
        .map(|points| {
            points.iter().fold(none, |(low, high), p| {
                let p = *axes * *p;
                (low.min(p), high.max(p))
            })
        })
        .reduce(|| none, |a, b| (a.0.min(b.0), a.1.max(b.1)))
}
