//! The take's regular voxel grid, dense occupancy as bits, and sparse sets of voxels.

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

/// A regular grid of cubic voxels, aligned with the world's axes. Linear index: x fastest, then y, then z.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Grid {
    /// The corner of voxel (0, 0, 0) with the smallest coordinates \[mm\].
    pub origin: DVec3,
    /// Edge length \[mm\].
    pub voxel_mm: f64,
    /// Voxels along x, y, z.
    pub dims: [usize; 3],
}

impl Grid {
    /// Number of voxels.
    pub fn len(&self) -> usize {
        self.dims.iter().product()
    }

    /// Whether the grid holds no voxel.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The grid of voxels of twice the size from the same origin; it covers all of this one.
    pub fn halved(&self) -> Self {
        Self { origin: self.origin, voxel_mm: 2.0 * self.voxel_mm, dims: self.dims.map(|n| n.div_ceil(2)) }
    }

    /// Linear index of a voxel.
    #[inline]
    pub fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.dims[1] + y) * self.dims[0] + x
    }

    /// The voxel of a linear index.
    #[inline]
    pub fn coordinates(&self, index: usize) -> [usize; 3] {
        let (nx, ny) = (self.dims[0], self.dims[1]);
        // Divisions are dear: two, and products for the remainders.
        let row = index / nx;
        let z = row / ny;
        [index - row * nx, row - z * ny, z]
    }

    /// Centre of a voxel in world coordinates \[mm\].
    #[inline]
    pub fn centre(&self, [x, y, z]: [usize; 3]) -> DVec3 {
        self.origin + DVec3::new(x as f64 + 0.5, y as f64 + 0.5, z as f64 + 0.5) * self.voxel_mm
    }

    /// Centre of the voxel with this linear index \[mm\].
    #[inline]
    pub fn centre_of_index(&self, index: usize) -> DVec3 {
        self.centre(self.coordinates(index))
    }

    /// Continuous voxel coordinates of a world point: the centre of voxel (0, 0, 0) is (0.5, 0.5, 0.5).
    #[inline]
    pub fn continuous(&self, point: DVec3) -> DVec3 {
        (point - self.origin) / self.voxel_mm
    }

    /// The voxel that contains a world point, if any.
    #[inline]
    pub fn voxel_at(&self, point: DVec3) -> Option<[usize; 3]> {
        let c = self.continuous(point);
        let [nx, ny, nz] = self.dims.map(|n| n as f64);
        let inside = c.x >= 0.0 && c.y >= 0.0 && c.z >= 0.0 && c.x < nx && c.y < ny && c.z < nz;
        inside.then_some([c.x as usize, c.y as usize, c.z as usize])
    }
}

/// The greatest integer that is not above a number; the nearest there is for one beyond all integers, and 0 for none.
/// Without the call to the system's library that `f64::floor` is on plain x86-64.
#[inline]
pub fn floor(number: f64) -> i64 {
    let towards_zero = number as i64;
    towards_zero.saturating_sub(i64::from(towards_zero as f64 > number))
}

/// 64 bits from an index on, of words of 64; what lies beyond them is zero.
#[inline]
pub fn bits_across(word: impl Fn(usize) -> Option<u64>, index: isize) -> u64 {
    let (first, bit) = (index.div_euclid(64), index.rem_euclid(64));
    let at = |number: isize| usize::try_from(number).ok().and_then(&word).unwrap_or(0);
    if bit == 0 { at(first) } else { at(first) >> bit | at(first + 1) << (64 - bit) }
}

/// Dense occupancy of a grid, one bit a voxel.
#[derive(Clone, Debug, PartialEq)]
pub struct Occupancy {
    /// The grid.
    pub grid: Grid,
    /// Bits in linear-index order, 64 a word, least significant first.
    pub words: Vec<u64>,
}

impl Occupancy {
    /// Nothing occupied.
    pub fn empty(grid: Grid) -> Self {
        Self { grid, words: vec![0; grid.len().div_ceil(64)] }
    }

    /// Whether the voxel of a linear index is occupied.
    #[inline]
    pub fn get(&self, index: usize) -> bool {
        self.words[index / 64] >> (index % 64) & 1 == 1
    }

    /// The bits of 64 voxels from a linear index on, the first in the lowest bit; nothing is occupied before the first voxel
    /// and beyond the last.
    #[inline]
    pub fn bits_from(&self, index: isize) -> u64 {
        bits_across(|word| self.words.get(word).copied(), index)
    }

    /// Sets one voxel.
    #[inline]
    pub fn set(&mut self, index: usize, value: bool) {
        let bit = 1u64 << (index % 64);
        if value { self.words[index / 64] |= bit } else { self.words[index / 64] &= !bit }
    }

    /// Whether the voxel that contains a world point is occupied (false outside the grid).
    pub fn contains(&self, point: DVec3) -> bool {
        self.grid.voxel_at(point).is_some_and(|voxel| self.get(self.grid.index(voxel)))
    }

    /// Number of occupied voxels.
    pub fn count(&self) -> usize {
        self.words.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// Linear indices of the occupied voxels, rising.
    pub fn indices(&self) -> impl Iterator<Item = usize> + '_ {
        self.words.iter().enumerate().flat_map(|(w, &word)| {
            let mut rest = word;
            std::iter::from_fn(move || {
                (rest != 0).then(|| {
                    let bit = rest.trailing_zeros() as usize;
                    rest &= rest - 1;
                    w * 64 + bit
                })
            })
        })
    }
}

/// A set of voxels of a grid with one value each, sorted by linear index.
#[derive(Clone, Debug, PartialEq)]
pub struct SparseVoxels<T> {
    /// The grid.
    pub grid: Grid,
    /// Linear indices, strictly rising.
    pub indices: Vec<u32>,
    /// One value a voxel.
    pub values: Vec<T>,
}

impl<T> SparseVoxels<T> {
    /// The value of a voxel by linear index (binary search).
    pub fn get(&self, index: usize) -> Option<&T> {
        let at = self.indices.binary_search(&(index as u32)).ok()?;
        self.values.get(at)
    }

    /// Number of voxels in the set.
    pub fn len(&self) -> usize {
        self.indices.len()
    }

    /// Whether the set is empty.
    pub fn is_empty(&self) -> bool {
        self.indices.is_empty()
    }
}

/// Converts a world point to single precision \[mm\].
pub fn single(point: DVec3) -> Vec3 {
    point.as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn index_centre_and_bits_agree() {
        let grid = Grid { origin: DVec3::new(-3.0, 4.0, 5.0), voxel_mm: 2.0, dims: [5, 6, 7] };
        let mut occupancy = Occupancy::empty(grid);
        for index in [0, 63, 64, 209] {
            assert_eq!(grid.index(grid.coordinates(index)), index);
            assert_eq!(grid.voxel_at(grid.centre_of_index(index)), Some(grid.coordinates(index)));
            occupancy.set(index, true);
        }
        assert_eq!(occupancy.indices().collect::<Vec<_>>(), [0, 63, 64, 209]);
        assert!(occupancy.contains(grid.centre_of_index(64)) && !occupancy.contains(grid.centre_of_index(65)));
        assert_eq!(occupancy.count(), 4);
        assert_eq!((occupancy.bits_from(-1), occupancy.bits_from(63), occupancy.bits_from(209)), (2, 3, 1));
        assert_eq!((occupancy.bits_from(-64), occupancy.bits_from(210), occupancy.bits_from(9999)), (0, 0, 0));
    }

    #[test]
    fn floors_are_those_of_the_library() {
        for number in [0.0, -0.0, 0.3, -0.3, 1.0, -1.0, 2.999_999, -2.000_001, 1e9 + 0.5, -1e9 - 0.5] {
            assert_eq!(floor(number), f64::floor(number) as i64, "{number}");
        }
        assert_eq!([f64::NAN, f64::INFINITY, f64::NEG_INFINITY].map(floor), [0, i64::MAX, i64::MIN]);
    }
}
