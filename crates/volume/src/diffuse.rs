//! Diffusion of line tensors through a sparse set of voxels, coarse to fine, by red–black over-relaxation.
//!
//! The field T minimises Σ |Tᵢ − Tⱼ|² over neighbouring voxels + Σ wᵢ |Tᵢ − Dᵢ|² over constrained ones + κ Σ |Tᵢ|².
//! The last term makes the trace of the tensor fall off with the distance from the constraints, over h/√κ, so that the
//! trace says how much of the evidence has reached a voxel; it has no direction and turns no line.
//!
//! Reference: Paris et al. 2008, section 5. *Deviation*: the reference averages neighbours in hundreds of Jacobi sweeps
//! at full resolution; here coarse solutions start the finer ones, which converges in tens.

use rayon::prelude::*;
use strandflow_core::{Grid, Occupancy};

use crate::{tensor::Tensor, velocity::VoxelIndex};

/// Marks an absent neighbour.
const ABSENT: u32 = u32::MAX;

/// A soft constraint: the tensor, and its weight against one neighbour (0: free).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Constraint {
    /// The tensor that is asked for.
    pub tensor: Tensor,
    /// Weight against the pull of one neighbour.
    pub weight: f32,
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

/// The diffused tensors of the voxels of `grid` with these linear `indices` (strictly rising), one constraint each.
///
/// The result does not depend on the number of threads.
pub fn diffuse(grid: &Grid, indices: &[u32], constraints: &[Constraint], solver: &Solver) -> Vec<Tensor> {
    let mut levels = vec![Level::new(*grid, indices.to_vec(), constraints, solver.leak)];
    for _ in 1..solver.levels {
        let next = levels[levels.len() - 1].coarser();
        if next.indices.len() < 64 {
            break;
        }
        levels.push(next);
    }
    let mut coarse: Option<(Level, Vec<Tensor>)> = None;
    while let Some(level) = levels.pop() {
        let start = match &coarse {
            Some((parent, solution)) => level.prolong(parent, solution),
            None => {
                level.constraints.iter().map(|c| if c.weight > 0.0 { c.tensor } else { Tensor::default() }).collect()
            }
        };
        let sweeps = if coarse.is_none() && solver.levels > 1 { 4 * solver.sweeps } else { solver.sweeps };
        let solution = level.relax(start, sweeps, solver.relaxation);
        coarse = Some((level, solution));
    }
    coarse.map(|(_, solution)| solution).unwrap_or_default()
}

/// One resolution.
struct Level {
    lookup: VoxelIndex,
    indices: Vec<u32>,
    constraints: Vec<Constraint>,
    leak: f32,
}

impl Level {
    fn new(grid: Grid, indices: Vec<u32>, constraints: &[Constraint], leak: f32) -> Self {
        let mut occupancy = Occupancy::empty(grid);
        indices.iter().for_each(|&index| occupancy.set(index as usize, true));
        Self { lookup: VoxelIndex::new(&occupancy), indices, constraints: constraints.to_vec(), leak }
    }

    /// Half the resolution. Against the pull of a neighbour, which doubles with the edge, the weights of the eight
    /// children count half, and so does their leak: κ quadruples.
    fn coarser(&self) -> Self {
        let fine = self.lookup.grid;
        let grid = Grid { origin: fine.origin, voxel_mm: fine.voxel_mm * 2.0, dims: fine.dims.map(|n| n.div_ceil(2)) };
        let mut occupancy = Occupancy::empty(grid);
        let parents: Vec<usize> = self.indices.iter().map(|&i| parent_of(&fine, &grid, i)).collect();
        parents.iter().for_each(|&parent| occupancy.set(parent, true));
        let lookup = VoxelIndex::new(&occupancy);
        let mut constraints = vec![Constraint::default(); occupancy.count()];
        for (&parent, child) in parents.iter().zip(&self.constraints) {
            let Some(rank) = lookup.rank(parent) else { continue };
            constraints[rank].tensor += child.tensor * (0.5 * child.weight);
            constraints[rank].weight += 0.5 * child.weight;
        }
        for constraint in constraints.iter_mut().filter(|c| c.weight > 0.0) {
            constraint.tensor = constraint.tensor * (1.0 / constraint.weight);
        }
        let indices = occupancy.indices().map(|index| index as u32).collect();
        Self { lookup, indices, constraints, leak: 4.0 * self.leak }
    }

    /// The parent's value at each voxel.
    fn prolong(&self, parent: &Level, solution: &[Tensor]) -> Vec<Tensor> {
        let (fine, coarse) = (self.lookup.grid, parent.lookup.grid);
        let value = |&index: &u32| parent.lookup.rank(parent_of(&fine, &coarse, index)).map(|rank| solution[rank]);
        self.indices.par_iter().map(|index| value(index).unwrap_or_default()).collect()
    }

    /// Sweeps of over-relaxation: first all voxels of even coordinate sum, then all odd ones; neighbours differ in parity,
    /// so that each half reads only the other.
    fn relax(&self, start: Vec<Tensor>, sweeps: usize, relaxation: f32) -> Vec<Tensor> {
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
    fn half(&self, ranks: &[u32], position: &[u32]) -> Vec<Stencil> {
        let grid = self.lookup.grid;
        let stencil = |&rank: &u32| {
            let [x, y, z] = grid.coordinates(self.indices[rank as usize] as usize).map(|c| c as i64);
            let around = [[x - 1, y, z], [x + 1, y, z], [x, y - 1, z], [x, y + 1, z], [x, y, z - 1], [x, y, z + 1]];
            let neighbours = around.map(|voxel| self.lookup.rank_at(voxel).map_or(ABSENT, |rank| position[rank]));
            let present = neighbours.iter().filter(|&&n| n != ABSENT).count() as f32;
            let Constraint { tensor, weight } = self.constraints[rank as usize];
            let total = present + weight + self.leak;
            let scale = if total > 0.0 { 1.0 / total } else { 0.0 };
            Stencil { neighbours, scale, pull: tensor * weight }
        };
        ranks.par_iter().map(stencil).collect()
    }
}

/// One voxel's equation: T = scale (Σ neighbours + pull).
struct Stencil {
    neighbours: [u32; 6],
    scale: f32,
    pull: Tensor,
}

fn sweep(stencils: &[Stencil], values: &mut [Tensor], others: &[Tensor], relaxation: f32) {
    values.par_iter_mut().with_min_len(4096).zip(stencils).for_each(|(value, stencil)| {
        let mut sum = stencil.pull;
        for &neighbour in stencil.neighbours.iter().filter(|&&n| n != ABSENT) {
            sum += others[neighbour as usize];
        }
        *value = *value * (1.0 - relaxation) + sum * (stencil.scale * relaxation);
    });
}

fn parent_of(fine: &Grid, coarse: &Grid, index: u32) -> usize {
    coarse.index(fine.coordinates(index as usize).map(|c| c / 2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, Vec3};

    fn slab(dims: [usize; 3]) -> (Grid, Vec<u32>) {
        let grid = Grid { origin: DVec3::ZERO, voxel_mm: 2.0, dims };
        (grid, (0..grid.len() as u32).collect())
    }

    #[test]
    fn between_two_walls_the_tensors_are_interpolated_linearly() {
        let (grid, indices) = slab([17, 6, 6]);
        let (a, b) = (Tensor::of_line(Vec3::X), Tensor::of_line(Vec3::Y));
        let constraints: Vec<Constraint> = indices
            .iter()
            .map(|&i| match grid.coordinates(i as usize)[0] {
                0 => Constraint { tensor: a, weight: 1e6 },
                16 => Constraint { tensor: b, weight: 1e6 },
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
        let constraints: Vec<Constraint> = indices
            .iter()
            .map(|&i| if grid.coordinates(i as usize)[0] == 0 { (1.0, 1e6) } else { (0.0, 0.0) })
            .map(|(scale, weight)| Constraint { tensor: Tensor::of_line(Vec3::Z) * scale, weight })
            .collect();
        let solver = Solver { levels: 4, sweeps: 20, relaxation: 1.6, leak: 0.01 };
        let found = diffuse(&grid, &indices, &constraints, &solver);
        let at = |x: usize| found[grid.index([x, 0, 0])].trace();
        assert!((at(20) / at(10) - (-1.0f32).exp()).abs() < 0.03, "{}", at(20) / at(10));
    }
}
