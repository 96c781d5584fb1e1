//! The shape of a 5-4-3 tree: a table of nodes of 32³ children, each of 16³ leaves, each of 8³ voxels.

use std::collections::BTreeMap;

use glam::Vec3;

/// Logarithms of the children along an axis of each kind of node, root side first, and of the voxels that a child spans.
pub(super) const UPPER: Level = Level { log: 5, child_log: 7 };
pub(super) const LOWER: Level = Level { log: 4, child_log: 3 };
pub(super) const LEAF: Level = Level { log: 3, child_log: 0 };

#[derive(Clone, Copy)]
pub(super) struct Level {
    log: u32,
    child_log: u32,
}

impl Level {
    /// Children, or voxels of a leaf.
    pub const fn size(self) -> usize {
        1 << (3 * self.log)
    }

    /// The child of a node that holds a voxel; z runs fastest.
    fn child_of(self, voxel: [i32; 3]) -> usize {
        let part = voxel.map(|x| (x >> self.child_log & ((1 << self.log) - 1)) as usize);
        (part[0] << (2 * self.log)) | (part[1] << self.log) | part[2]
    }

    /// The first voxel of a child, relative to its node's.
    pub fn voxel_of(self, child: usize) -> [i32; 3] {
        let mask = (1 << self.log) - 1;
        [child >> (2 * self.log), child >> self.log & mask, child & mask].map(|x| (x << self.child_log) as i32)
    }
}

/// Voxels of a leaf by their number in it.
pub(super) type Leaf = BTreeMap<usize, Vec3>;
/// Leaves by their number in a lower node.
pub(super) type Lower = BTreeMap<usize, Leaf>;
/// Lower nodes by their number in an upper one.
pub(super) type Upper = BTreeMap<usize, Lower>;

/// Voxels sorted into the tree: upper nodes by their first voxel.
pub(super) fn sorted(voxels: &[([i32; 3], Vec3)]) -> BTreeMap<[i32; 3], Upper> {
    let mut root: BTreeMap<[i32; 3], Upper> = BTreeMap::new();
    let spanned = UPPER.log + UPPER.child_log;
    for &(at, value) in voxels {
        let upper = root.entry(at.map(|x| x >> spanned << spanned)).or_default();
        let lower = upper.entry(UPPER.child_of(at)).or_default();
        lower.entry(LOWER.child_of(at)).or_default().insert(LEAF.child_of(at), value);
    }
    root
}

/// One bit a child.
pub(super) fn mask<'a>(level: Level, on: impl Iterator<Item = &'a usize>) -> Vec<u8> {
    let mut mask = vec![0; level.size() / 8];
    on.for_each(|&at| mask[at / 8] |= 1 << (at % 8));
    mask
}

/// The children whose bit is on.
pub(super) fn children(mask: &[u8]) -> Vec<usize> {
    (0..mask.len() * 8).filter(|&at| mask[at / 8] >> (at % 8) & 1 == 1).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_voxel_comes_back_from_its_place_in_the_tree() {
        for voxel in [[0, 0, 0], [1, 2, 3], [4095, 4096, 130], [-1, -9, -4097], [1000, 77, 12345]] {
            let root = sorted(&[(voxel, Vec3::X)]);
            let (first, upper) = root.first_key_value().unwrap();
            let (u, lower) = upper.first_key_value().unwrap();
            let (l, leaf) = lower.first_key_value().unwrap();
            let v = leaf.keys().next().unwrap();
            let parts = [*first, UPPER.voxel_of(*u), LOWER.voxel_of(*l), LEAF.voxel_of(*v)];
            let sum = parts.iter().fold([0; 3], |a, b| [a[0] + b[0], a[1] + b[1], a[2] + b[2]]);
            assert_eq!(sum, voxel);
        }
    }
}
