//! The velocity field of a frame on the sparse hair region: deposit, diffusion (eq. 5) and look-up.
//!
//! Reference: Zhang et al. 2012 eq. 5. *Deviation*: "zeros elsewhere" damps the velocity at the strands by 82–98 %.
//! [`normalised`] diffuses occupancy · v and occupancy alike and divides, after which the gain at the strands is 0.98–1.00.

use std::ops::Add;

use glam::{DVec3, DVec4, Vec3, Vec4};
use rayon::prelude::*;
use strandflow_core::{
    Grid, Occupancy, SparseVoxels,
    grid::{bits_across, floor},
};

/// Where voxel `i` of a region has no neighbour.
const ABSENT: u32 = u32::MAX;

/// A sparse set of voxels with constant-time lookup (bits and a running count of them).
#[derive(Clone, Debug)]
pub struct VoxelIndex {
    /// The grid.
    pub grid: Grid,
    words: Vec<Word>,
}

/// 64 voxels, side by side in memory with what their positions count from.
#[derive(Clone, Copy, Debug)]
struct Word {
    bits: u64,
    /// Voxels of the set in the words before.
    before: u32,
}

impl Word {
    fn has(self, bit: usize) -> bool {
        self.bits >> bit & 1 == 1
    }

    /// The position of the first voxel of the set from a bit on.
    fn position(self, bit: usize) -> usize {
        self.before as usize + (self.bits & ((1u64 << bit) - 1)).count_ones() as usize
    }
}

impl VoxelIndex {
    /// From bits.
    pub fn new(occupancy: &Occupancy) -> Self {
        let mut total = 0u32;
        let word = |&bits: &u64| {
            let before = total;
            total += bits.count_ones();
            Word { bits, before }
        };
        Self { grid: occupancy.grid, words: occupancy.words.iter().map(word).collect() }
    }

    /// From the rising linear indices of a sparse set.
    pub fn of_sparse<T>(voxels: &SparseVoxels<T>) -> Self {
        let mut occupancy = Occupancy::empty(voxels.grid);
        voxels.indices.iter().for_each(|&index| occupancy.set(index as usize, true));
        Self::new(&occupancy)
    }

    /// The position of a voxel (linear index) among the rising indices of the set.
    #[inline]
    pub fn rank(&self, index: usize) -> Option<usize> {
        let (word, bit) = (self.words[index / 64], index % 64);
        word.has(bit).then(|| word.position(bit))
    }

    /// Like `rank`, for signed voxel coordinates that may lie outside the grid.
    #[inline]
    pub fn rank_at(&self, voxel: [i64; 3]) -> Option<usize> {
        self.index_at(voxel).and_then(|index| self.rank(index))
    }

    /// Whether the set holds a voxel; its coordinates may lie outside the grid.
    #[inline]
    pub fn holds(&self, voxel: [i64; 3]) -> bool {
        self.index_at(voxel).is_some_and(|index| self.words[index / 64].has(index % 64))
    }

    /// The linear index of a voxel that lies in the grid.
    #[inline]
    fn index_at(&self, voxel: [i64; 3]) -> Option<usize> {
        let inside = (0..3).all(|axis| voxel[axis] >= 0 && (voxel[axis] as usize) < self.grid.dims[axis]);
        inside.then(|| self.grid.index(voxel.map(|c| c as usize)))
    }

    /// The positions of the eight voxels from one on, each either that or one higher along x (lowest bit), y and z.
    #[inline]
    pub fn corners(&self, [x, y, z]: [i64; 3]) -> [Option<usize>; 8] {
        let mut corners = [None; 8];
        if x < 0 || x + 1 >= self.grid.dims[0] as i64 {
            for (corner, rank) in corners.iter_mut().enumerate() {
                let [i, j, k] = [corner & 1, corner >> 1 & 1, corner >> 2].map(|c| c as i64);
                *rank = self.rank_at([x + i, y + j, z + k]);
            }
            return corners;
        }
        for (row, pair) in corners.chunks_exact_mut(2).enumerate() {
            let (j, k) = (row as i64 & 1, row as i64 >> 1);
            let Some(index) = self.index_at([x, y + j, z + k]) else { continue };
            let (word, bit) = (self.words[index / 64], index % 64);
            let first = word.position(bit);
            pair[0] = word.has(bit).then_some(first);
            pair[1] = if bit < 63 {
                word.has(bit + 1).then(|| first + usize::from(word.has(bit)))
            } else {
                self.rank(index + 1)
            };
        }
        corners
    }

    /// Which of the `count` (1 to 64) voxels of a row from one on are in the set, the first in the lowest bit; coordinates
    /// may lie outside the grid.
    #[inline]
    pub fn row_bits(&self, [x, y, z]: [i64; 3], count: i64) -> u64 {
        let (from, to) = (x.max(0), (x + count).min(self.grid.dims[0] as i64));
        let Some(index) = self.index_at([from, y, z]).filter(|_| from < to) else { return 0 };
        let bits = bits_across(|word| self.words.get(word).map(|word| word.bits), index as isize);
        (bits & (u64::MAX >> (64 - (to - from)))) << (from - x)
    }
}

/// What can be diffused.
pub trait Sample: Copy + Send + Sync + Add<Output = Self> {
    /// Nothing.
    const ZERO: Self;
    /// Scaled by a double.
    fn scaled(self, factor: f64) -> Self;
}

impl Sample for Vec4 {
    const ZERO: Self = Vec4::ZERO;

    #[inline]
    fn scaled(self, factor: f64) -> Self {
        self * factor as f32
    }
}

impl Sample for DVec4 {
    const ZERO: Self = DVec4::ZERO;

    #[inline]
    fn scaled(self, factor: f64) -> Self {
        self * factor
    }
}

/// What lies beyond the region in eq. 5.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Border {
    /// Zeros, as printed.
    Zero,
    /// No flow: absent neighbours do not count.
    Neumann,
}

/// The voxels in which velocities are defined, each with its six neighbours (built once, no lookup in the sweep).
#[derive(Clone, Debug)]
pub struct Region {
    /// Linear indices, strictly rising.
    pub indices: Vec<u32>,
    /// Constant-time lookup.
    pub lookup: VoxelIndex,
    neighbours: Vec<[u32; 6]>,
}

impl Region {
    /// The occupied voxels.
    pub fn new(occupancy: &Occupancy) -> Self {
        let indices: Vec<u32> = occupancy.indices().map(|index| index as u32).collect();
        let lookup = VoxelIndex::new(occupancy);
        let neighbours = indices
            .par_iter()
            .map(|&index| {
                let [x, y, z] = lookup.grid.coordinates(index as usize).map(|c| c as i64);
                [[x - 1, y, z], [x + 1, y, z], [x, y - 1, z], [x, y + 1, z], [x, y, z - 1], [x, y, z + 1]]
                    .map(|voxel| lookup.rank_at(voxel).map_or(ABSENT, |rank| rank as u32))
            })
            .collect();
        Self { indices, lookup, neighbours }
    }

    /// Number of voxels.
    pub fn len(&self) -> usize {
        self.indices.len()
    }

    /// Whether the region holds no voxel.
    pub fn is_empty(&self) -> bool {
        self.indices.is_empty()
    }

    /// `sweeps` Jacobi sweeps of eq. 5, double buffered: v ← (1 − 6s) v + s Σ v(neighbours).
    ///
    /// `values`: one a voxel of the region. Stable for s ≤ 1/6; free of oscillation for s ≤ 1/12.
    pub fn diffuse<V: Sample>(&self, values: Vec<V>, s: f64, sweeps: usize, border: Border) -> Vec<V> {
        let (mut now, mut next) = (values.clone(), values);
        for _ in 0..sweeps {
            next.par_chunks_mut(4096).enumerate().for_each(|(chunk, out)| {
                let start = chunk * 4096;
                for (offset, value) in out.iter_mut().enumerate() {
                    let (mut sum, mut present) = (V::ZERO, 0u32);
                    for &neighbour in &self.neighbours[start + offset] {
                        if neighbour != ABSENT {
                            sum = sum + now[neighbour as usize];
                            present += 1;
                        }
                    }
                    let leaving = if border == Border::Zero { 6.0 } else { f64::from(present) };
                    *value = now[start + offset].scaled(1.0 - leaving * s) + sum.scaled(s);
                }
            });
            std::mem::swap(&mut now, &mut next);
        }
        now
    }
}

/// Velocities gathered on a region: (Σ v / count, 1) where strands pass, zero elsewhere.
///
/// `segments`: for each strand piece its two ends \[mm\] and their velocities \[mm/s\]; each is walked at half a voxel. Order
/// of the sums is the order of the segments. Pieces outside the region do not count.
pub fn deposit(region: &Region, segments: impl Iterator<Item = [(Vec3, Vec3); 2]>) -> Vec<Vec4> {
    let mut sums = vec![Vec4::ZERO; region.len()];
    let grid = region.lookup.grid;
    for [(a, va), (b, vb)] in segments {
        let pieces = (a.distance(b) / (0.5 * grid.voxel_mm as f32)).ceil().max(1.0) as usize;
        for i in 0..pieces {
            let t = (i as f32 + 0.5) / pieces as f32;
            let voxel = grid.voxel_at(a.lerp(b, t).as_dvec3());
            if let Some(rank) = voxel.and_then(|voxel| region.lookup.rank(grid.index(voxel))) {
                sums[rank] += va.lerp(vb, t).extend(1.0);
            }
        }
    }
    sums.iter_mut().filter(|sum| sum.w > 0.0).for_each(|sum| *sum /= sum.w);
    sums
}

/// Eq. 5 on (v, occupancy) together, then v / occupancy; `None` where less than `least` of occupancy arrived.
pub fn normalised<V: Sample>(
    region: &Region,
    deposited: Vec<V>,
    (s, sweeps, border): (f64, usize, Border),
    least: f64,
    occupancy_of: impl Fn(&V) -> f64,
) -> Vec<Option<V>> {
    let diffused = region.diffuse(deposited, s, sweeps, border);
    diffused
        .into_iter()
        .map(|value| {
            let weight = occupancy_of(&value);
            (weight > least).then(|| value.scaled(1.0 / weight))
        })
        .collect()
}

/// Looks a velocity field up between voxel centres.
pub struct VelocitySampler<'a> {
    lookup: VoxelIndex,
    values: &'a [Vec3],
}

impl<'a> VelocitySampler<'a> {
    /// A sampler of a field.
    pub fn new(field: &'a SparseVoxels<Vec3>) -> Self {
        Self { lookup: VoxelIndex::of_sparse(field), values: &field.values }
    }

    /// Velocity \[mm/s\] at a world point \[mm\], trilinear over those of the eight voxels that exist (weights renormalised);
    /// `None` where none does.
    pub fn at(&self, point: Vec3) -> Option<Vec3> {
        let c = self.lookup.grid.continuous(point.as_dvec3()) - DVec3::splat(0.5);
        if !c.is_finite() {
            return None;
        }
        let base = c.to_array().map(floor);
        let f = (c - DVec3::from_array(base.map(|b| b as f64))).as_vec3();
        let (mut sum, mut total) = (Vec3::ZERO, 0.0f32);
        for (corner, rank) in self.lookup.corners(base).into_iter().enumerate() {
            let Some(rank) = rank else { continue };
            let share = |axis: usize| if corner >> axis & 1 == 1 { f[axis] } else { 1.0 - f[axis] };
            let weight = (share(0) * share(1) * share(2)).max(1e-6);
            sum += self.values[rank] * weight;
            total += weight;
        }
        (total > 0.0).then(|| sum / total)
    }
}

/// Occupancy grown by one voxel along each axis (six neighbours).
pub fn dilated(occupancy: &Occupancy) -> Occupancy {
    let grid = occupancy.grid;
    let mut out = occupancy.clone();
    let [nx, ny, nz] = grid.dims;
    for index in occupancy.indices() {
        let [x, y, z] = grid.coordinates(index);
        let steps = [(x > 0, 1, false), (x + 1 < nx, 1, true), (y > 0, nx, false), (y + 1 < ny, nx, true)];
        for (inside, stride, up) in steps.into_iter().chain([(z > 0, nx * ny, false), (z + 1 < nz, nx * ny, true)]) {
            if inside {
                out.set(if up { index + stride } else { index - stride }, true);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_and_rows_are_those_of_single_voxels() {
        // Rows that begin anywhere in a word of 64, voxels by chance, and places on and beyond every border.
        let grid = Grid { origin: DVec3::ZERO, voxel_mm: 2.0, dims: [37, 11, 9] };
        let mut occupancy = Occupancy::empty(grid);
        (0..grid.len()).for_each(|index| occupancy.set(index, index * index % 7 < 3));
        let index = VoxelIndex::new(&occupancy);
        for (z, y, x) in (-2..11).flat_map(|z| (-2..13).flat_map(move |y| (-7..39).map(move |x| (z, y, x)))) {
            let offsets = |corner: i64| [x + (corner & 1), y + (corner >> 1 & 1), z + (corner >> 2)];
            let expected = [0, 1, 2, 3, 4, 5, 6, 7].map(|corner| index.rank_at(offsets(corner)));
            assert_eq!(index.corners([x, y, z]), expected, "{x} {y} {z}");
            let row = (0..5).filter(|&i| index.holds([x + i, y, z])).fold(0, |bits, i| bits | 1u64 << i);
            assert_eq!(index.row_bits([x, y, z], 5), row, "{x} {y} {z}");
        }
    }

    fn block() -> Occupancy {
        let grid = Grid { origin: DVec3::ZERO, voxel_mm: 2.0, dims: [20, 20, 20] };
        let mut occupancy = Occupancy::empty(grid);
        (0..grid.len()).for_each(|index| occupancy.set(index, true));
        occupancy
    }

    #[test]
    fn a_uniform_motion_of_one_strand_is_kept_at_full_strength() {
        let region = Region::new(&block());
        let v = Vec3::new(120.0, -40.0, 900.0);
        let segments = (0..6).map(|i| {
            let at = |k: i32| Vec3::new(20.0, 19.0, 4.0 + 5.0 * k as f32);
            [(at(i), v), (at(i + 1), v)]
        });
        let field = normalised(&region, deposit(&region, segments), (1.0 / 12.0, 30, Border::Neumann), 1e-6, |v| {
            f64::from(v.w)
        });
        let known: Vec<Vec3> = field.iter().flatten().map(|value| value.truncate()).collect();
        assert!(known.len() > 5000);
        assert!(known.iter().all(|found| found.distance(v) < 1e-2));
    }

    #[test]
    fn a_linear_field_is_read_back_between_centres() {
        let occupancy = block();
        let region = Region::new(&occupancy);
        let f = |p: DVec3| Vec3::new(p.x as f32, 2.0 * p.y as f32 - p.z as f32, 1.0);
        let values = region.indices.iter().map(|&i| f(occupancy.grid.centre_of_index(i as usize))).collect();
        let field = SparseVoxels { grid: occupancy.grid, indices: region.indices.clone(), values };
        let sampler = VelocitySampler::new(&field);
        let point = DVec3::new(12.3, 17.9, 25.01);
        assert!(sampler.at(point.as_vec3()).unwrap().distance(f(point)) < 1e-3);
        assert!(sampler.at(Vec3::splat(-50.0)).is_none() && sampler.at(Vec3::NAN).is_none());
    }

    #[test]
    fn neumann_keeps_the_sum() {
        let region = Region::new(&block());
        let mut values = vec![DVec4::ZERO; region.len()];
        values[0] = DVec4::splat(8.0);
        let after = region.diffuse(values, 1.0 / 6.0, 50, Border::Neumann);
        assert!((after.iter().map(|v| v.x).sum::<f64>() - 8.0).abs() < 1e-10);
    }
}
