//! Diffusion of line tensors or vectors through a sparse set of voxels, coarse to fine, by red–black over-relaxation.
//!
//! The field T minimises Σ |Tᵢ − Tⱼ|² over neighbouring voxels + Σ (Tᵢ − Dᵢ)ᵀ Wᵢ (Tᵢ − Dᵢ) over constrained ones +
//! κ Σ |Tᵢ|². For line tensors W is a number; for vectors it is a symmetric matrix, so that what was measured across a
//! strand only says nothing along it. The last term makes the field fall off with the distance from the constraints, over
//! h/√κ: the trace of a tensor then says how much of the evidence has reached a voxel, and turns no line.
//!
//! Reference: Paris et al. 2008, section 5. *Deviation*: the reference averages neighbours in hundreds of Jacobi sweeps
//! at full resolution; here coarse solutions start the finer ones, which converges in tens.

use std::ops::{Add, AddAssign, Mul};

use glam::Vec3;
use rayon::prelude::*;
use strandflow_core::{Grid, Occupancy};

use crate::{tensor::Tensor, velocity::VoxelIndex};

/// Marks an absent neighbour.
const ABSENT: u32 = u32::MAX;

/// What can be diffused: a value, and the weight W of a constraint on it.
pub trait Quantity: Linear {
    /// A number, or a symmetric positive semidefinite matrix.
    type Weight: Linear;

    /// (W + diagonal)⁻¹, zero where that is singular.
    fn inverse(weight: Self::Weight, diagonal: f32) -> Self::Weight;

    /// The product of an inverse and a value.
    fn apply(inverse: &Self::Weight, value: Self) -> Self;
}

/// What can be added and scaled.
pub trait Linear: Copy + Default + Send + Sync + Add<Output = Self> + AddAssign + Mul<f32, Output = Self> {}

impl<T: Copy + Default + Send + Sync + Add<Output = T> + AddAssign + Mul<f32, Output = T>> Linear for T {}

impl Quantity for Tensor {
    type Weight = f32;

    fn inverse(weight: f32, diagonal: f32) -> f32 {
        if weight + diagonal > 0.0 { 1.0 / (weight + diagonal) } else { 0.0 }
    }

    #[inline]
    fn apply(inverse: &f32, value: Self) -> Self {
        value * *inverse
    }
}

impl Quantity for Vec3 {
    type Weight = Tensor;

    fn inverse(weight: Tensor, diagonal: f32) -> Tensor {
        (weight + Tensor([diagonal, diagonal, diagonal, 0.0, 0.0, 0.0])).inverse().unwrap_or_default()
    }

    #[inline]
    fn apply(inverse: &Tensor, value: Self) -> Self {
        inverse.apply(value)
    }
}

/// A soft constraint, (0, 0) where there is none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Constraint<Q: Quantity> {
    /// W D: the value that is asked for, times its weight.
    pub pull: Q,
    /// W, against the pull of one neighbour.
    pub weight: Q::Weight,
}

impl Constraint<Tensor> {
    /// Asks for a tensor.
    pub fn on(tensor: Tensor, weight: f32) -> Self {
        Self { pull: tensor * weight, weight }
    }
}

/// How to solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solver {
    /// Resolutions, each half of the one before; 1 solves at full resolution alone.
    pub levels: usize,
    /// Sweeps at each resolution; the coarsest takes four times as many.
    pub sweeps: usize,
    /// Over-relaxation, 1 to below 2.
    pub relaxation: f32,
    /// κ at full resolution: (voxel / fall-off length)².
    pub leak: f32,
}

/// The diffused values of the voxels of `grid` with these linear `indices` (strictly rising), one constraint each.
///
/// The result does not depend on the number of threads.
pub fn diffuse<Q: Quantity>(grid: &Grid, indices: &[u32], constraints: &[Constraint<Q>], solver: &Solver) -> Vec<Q> {
    let mut levels = vec![Level::new(*grid, indices.to_vec(), constraints, solver.leak)];
    for _ in 1..solver.levels {
        let next = levels[levels.len() - 1].coarser();
        if next.indices.len() < 64 {
            break;
        }
        levels.push(next);
    }
    let mut coarse: Option<(Level<Q>, Vec<Q>)> = None;
    while let Some(level) = levels.pop() {
        let start = match &coarse {
            Some((parent, solution)) => level.prolong(parent, solution),
            // What is asked for where it is asked for; the small diagonal keeps unmeasured directions at zero.
            None => level.constraints.iter().map(|c| Q::apply(&Q::inverse(c.weight, 1e-3), c.pull)).collect(),
        };
        let sweeps = if coarse.is_none() && solver.levels > 1 { 4 * solver.sweeps } else { solver.sweeps };
        let solution = level.relax(start, sweeps, solver.relaxation);
        coarse = Some((level, solution));
    }
    coarse.map(|(_, solution)| solution).unwrap_or_default()
}

/// One resolution.
struct Level<Q: Quantity> {
    lookup: VoxelIndex,
    indices: Vec<u32>,
    constraints: Vec<Constraint<Q>>,
    leak: f32,
}

impl<Q: Quantity> Level<Q> {
    fn new(grid: Grid, indices: Vec<u32>, constraints: &[Constraint<Q>], leak: f32) -> Self {
        let mut occupancy = Occupancy::empty(grid);
        indices.iter().for_each(|&index| occupancy.set(index as usize, true));
        Self { lookup: VoxelIndex::new(&occupancy), indices, constraints: constraints.to_vec(), leak }
    }

    /// Half the resolution. Against the pull of a neighbour, which doubles with the edge, the weights of the eight
    /// children count half, and so does their leak: κ quadruples.
    fn coarser(&self) -> Self {
        let fine = self.lookup.grid;
        let grid = fine.halved();
        let mut occupancy = Occupancy::empty(grid);
        let parents: Vec<usize> = self.indices.iter().map(|&i| parent_of(&fine, &grid, i)).collect();
        parents.iter().for_each(|&parent| occupancy.set(parent, true));
        let lookup = VoxelIndex::new(&occupancy);
        let mut constraints = vec![Constraint { pull: Q::default(), weight: Q::Weight::default() }; occupancy.count()];
        for (&parent, child) in parents.iter().zip(&self.constraints) {
            let Some(rank) = lookup.rank(parent) else { continue };
            constraints[rank].pull += child.pull * 0.5;
            constraints[rank].weight += child.weight * 0.5;
        }
        let indices = occupancy.indices().map(|index| index as u32).collect();
        Self { lookup, indices, constraints, leak: 4.0 * self.leak }
    }

    /// The parent's value at each voxel.
    fn prolong(&self, parent: &Self, solution: &[Q]) -> Vec<Q> {
        let (fine, coarse) = (self.lookup.grid, parent.lookup.grid);
        let value = |&index: &u32| parent.lookup.rank(parent_of(&fine, &coarse, index)).map(|rank| solution[rank]);
        self.indices.par_iter().map(|index| value(index).unwrap_or_default()).collect()
    }

    /// Sweeps of over-relaxation: first all voxels of even coordinate sum, then all odd ones; neighbours differ in parity,
    /// so that each half reads only the other.
    fn relax(&self, start: Vec<Q>, sweeps: usize, relaxation: f32) -> Vec<Q> {
        let grid = self.lookup.grid;
        let parity = |index: u32| grid.coordinates(index as usize).iter().sum::<usize>() % 2;
        // Position of each voxel within its colour.
        let mut position = Vec::with_capacity(self.indices.len());
        let mut members: [Vec<u32>; 2] = [Vec::new(), Vec::new()];
        for (rank, &index) in self.indices.iter().enumerate() {
            let colour = &mut members[parity(index)];
            position.push(colour.len() as u32);
            colour.push(rank as u32);
        }
        let [even, odd] = members.each_ref().map(|ranks| self.half(ranks, &position));
        let [mut even_values, mut odd_values] =
            members.each_ref().map(|ranks| ranks.iter().map(|&rank| start[rank as usize]).collect::<Vec<_>>());
        for _ in 0..sweeps {
            sweep(&even, &mut even_values, &odd_values, relaxation);
            sweep(&odd, &mut odd_values, &even_values, relaxation);
        }
        let mut out = start;
        for (ranks, values) in members.iter().zip([even_values, odd_values]) {
            ranks.iter().zip(values).for_each(|(&rank, value)| out[rank as usize] = value);
        }
        out
    }

    /// The stencils of one colour.
    fn half(&self, ranks: &[u32], position: &[u32]) -> Vec<Stencil<Q>> {
        let grid = self.lookup.grid;
        let stencil = |&rank: &u32| {
            let [x, y, z] = grid.coordinates(self.indices[rank as usize] as usize).map(|c| c as i64);
            let around = [[x - 1, y, z], [x + 1, y, z], [x, y - 1, z], [x, y + 1, z], [x, y, z - 1], [x, y, z + 1]];
            let neighbours = around.map(|voxel| self.lookup.rank_at(voxel).map_or(ABSENT, |rank| position[rank]));
            let present = neighbours.iter().filter(|&&n| n != ABSENT).count() as f32;
            let Constraint { pull, weight } = self.constraints[rank as usize];
            Stencil { neighbours, inverse: Q::inverse(weight, present + self.leak), pull }
        };
        ranks.par_iter().map(stencil).collect()
    }
}

/// One voxel's equation: T = inverse (Σ neighbours + pull).
struct Stencil<Q: Quantity> {
    neighbours: [u32; 6],
    inverse: Q::Weight,
    pull: Q,
}

fn sweep<Q: Quantity>(stencils: &[Stencil<Q>], values: &mut [Q], others: &[Q], relaxation: f32) {
    values.par_iter_mut().with_min_len(4096).zip(stencils).for_each(|(value, stencil)| {
        let mut sum = stencil.pull;
        for &neighbour in stencil.neighbours.iter().filter(|&&n| n != ABSENT) {
            sum += others[neighbour as usize];
        }
        *value = *value * (1.0 - relaxation) + Q::apply(&stencil.inverse, sum) * relaxation;
    });
}

fn parent_of(fine: &Grid, coarse: &Grid, index: u32) -> usize {
    coarse.index(fine.coordinates(index as usize).map(|c| c / 2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn slab(dims: [usize; 3]) -> (Grid, Vec<u32>) {
        let grid = Grid { origin: DVec3::ZERO, voxel_mm: 2.0, dims };
        (grid, (0..grid.len() as u32).collect())
    }

    #[test]
    fn between_two_walls_the_tensors_are_interpolated_linearly() {
        let (grid, indices) = slab([17, 6, 6]);
        let (a, b) = (Tensor::of_line(Vec3::X), Tensor::of_line(Vec3::Y));
        let constraints: Vec<Constraint<Tensor>> = indices
            .iter()
            .map(|&i| match grid.coordinates(i as usize)[0] {
                0 => Constraint::on(a, 1e6),
                16 => Constraint::on(b, 1e6),
                _ => Constraint::default(),
            })
            .collect();
        let solver = Solver { levels: 3, sweeps: 60, relaxation: 1.6, leak: 0.0 };
        for (&index, found) in indices.iter().zip(diffuse(&grid, &indices, &constraints, &solver)) {
            let s = grid.coordinates(index as usize)[0] as f32 / 16.0;
            let expected = a * (1.0 - s) + b * s;
            for k in 0..6 {
                assert!((found.0[k] - expected.0[k]).abs() < 0.005, "{s} {k} {} {}", found.0[k], expected.0[k]);
            }
        }
    }

    #[test]
    fn what_reaches_a_voxel_falls_off_over_the_given_length() {
        // Wide enough to have coarser levels.
        let (grid, indices) = slab([64, 8, 8]);
        let constraints: Vec<Constraint<Tensor>> = indices
            .iter()
            .map(|&i| if grid.coordinates(i as usize)[0] == 0 { (1.0, 1e6) } else { (0.0, 0.0) })
            .map(|(scale, weight)| Constraint::on(Tensor::of_line(Vec3::Z) * scale, weight))
            .collect();
        let solver = Solver { levels: 4, sweeps: 20, relaxation: 1.6, leak: 0.01 };
        let found = diffuse(&grid, &indices, &constraints, &solver);
        let at = |x: usize| found[grid.index([x, 0, 0])].trace();
        assert!((at(20) / at(10) - (-1.0f32).exp()).abs() < 0.03, "{}", at(20) / at(10));
    }

    #[test]
    fn what_is_measured_across_leaves_the_rest_to_the_neighbours() {
        // One end knows all of the vector, the other only its x; y and z come from the first end.
        let (grid, indices) = slab([17, 6, 6]);
        let all = Tensor([1e4, 1e4, 1e4, 0.0, 0.0, 0.0]);
        let constraints: Vec<Constraint<Vec3>> = indices
            .iter()
            .map(|&i| match grid.coordinates(i as usize)[0] {
                0 => Constraint { pull: all.apply(Vec3::new(1.0, 2.0, 3.0)), weight: all },
                16 => Constraint { pull: Vec3::X * 5e4, weight: Tensor::of_line(Vec3::X) * 1e4 },
                _ => Constraint { pull: Vec3::ZERO, weight: Tensor::default() },
            })
            .collect();
        let solver = Solver { levels: 3, sweeps: 80, relaxation: 1.6, leak: 0.0 };
        for (&index, found) in indices.iter().zip(diffuse(&grid, &indices, &constraints, &solver)) {
            let s = grid.coordinates(index as usize)[0] as f32 / 16.0;
            assert!(found.distance(Vec3::new(1.0 + 4.0 * s, 2.0, 3.0)) < 0.05, "{s} {found}");
        }
    }
}
