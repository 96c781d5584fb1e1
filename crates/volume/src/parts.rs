//! Separate parts of an occupancy: bodies that a gap divides.

use strandflow_core::{Grid, Occupancy};

use crate::carve::components;

/// The occupied voxels of each part, rising; the largest part first. Parts are apart by at least one empty cube of `gap`
/// voxels: at a gap of 1 they touch by no corner. Costs a pass over the voxels and a flood fill over cubes.
pub fn parts(occupancy: &Occupancy, gap: usize) -> Vec<Vec<usize>> {
    let (fine, gap) = (occupancy.grid, gap.max(1));
    let coarse = Grid { voxel_mm: fine.voxel_mm * gap as f64, dims: fine.dims.map(|n| n.div_ceil(gap)), ..fine };
    let cube = |index: usize| coarse.index(fine.coordinates(index).map(|k| k / gap));
    let mut cubes = Occupancy::empty(coarse);
    occupancy.indices().for_each(|index| cubes.set(cube(index), true));
    let found = components(&cubes);
    let mut part_of = vec![0u32; coarse.len()];
    for (part, members) in found.iter().enumerate() {
        members.iter().for_each(|&member| part_of[member] = part as u32);
    }
    let mut parts = vec![Vec::new(); found.len()];
    occupancy.indices().for_each(|index| parts[part_of[cube(index)] as usize].push(index));
    parts.sort_by_key(|part| std::cmp::Reverse(part.len()));
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn bodies_are_told_apart_by_their_gap() {
        let grid = Grid { origin: DVec3::ZERO, voxel_mm: 2.0, dims: [40, 12, 11] };
        let mut occupancy = Occupancy::empty(grid);
        for index in 0..grid.len() {
            let [x, ..] = grid.coordinates(index);
            occupancy.set(index, (3..10).contains(&x) || (18..39).contains(&x));
        }
        let slab = 12 * 11;
        let sizes = |gap| parts(&occupancy, gap).iter().map(Vec::len).collect::<Vec<_>>();
        assert_eq!(
            (sizes(1), sizes(4), sizes(9)),
            (vec![21 * slab, 7 * slab], vec![21 * slab, 7 * slab], vec![28 * slab])
        );
        assert!(parts(&Occupancy::empty(grid), 4).is_empty());
    }
}
