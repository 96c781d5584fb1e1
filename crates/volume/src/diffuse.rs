//! Diffusion of line tensors or vectors through a sparse set of voxels, coarse to fine, by red–black over-relaxation.
//!
//! The field T minimises Σ |Tᵢ − Tⱼ|² over neighbouring voxels + Σ (Tᵢ − Dᵢ)ᵀ Wᵢ (Tᵢ − Dᵢ) over constrained ones +
//! κ Σ |Tᵢ|². For line tensors W is a number; for vectors it is a symmetric matrix, so that what was measured across a
//! strand only says nothing along it. Vectors of motion along hair that does not stretch have a further term, see
//! [`Inextensible`]. The last term makes the field fall off with the distance from the constraints, over
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

/// What a voxel adds to the pull between it and its neighbours, which is 1 in every direction without.
pub trait Coupling<Q: Quantity>: Copy + Default + Send + Sync {
    /// The pull of a neighbour along an axis (0, 1, 2) with this value.
    fn pull(self, neighbour: Self, axis: usize, value: Q) -> Q;

    /// What the pull weighs beyond 1.
    fn weight(self, neighbour: Self, axis: usize) -> Q::Weight;

    /// That of eight voxels together, of which `count` are present.
    fn merged(sum: Self, count: usize) -> Self;

    /// The sum of those of two voxels.
    fn joined(self, other: Self) -> Self;
}

/// Neighbours pull evenly.
impl<Q: Quantity> Coupling<Q> for () {
    #[inline]
    fn pull(self, (): Self, _: usize, value: Q) -> Q {
        value
    }

    fn weight(self, (): Self, _: usize) -> Q::Weight {
        Q::Weight::default()
    }

    fn merged((): Self, _: usize) {}

    fn joined(self, (): Self) {}
}

/// The line along which motion u does not stretch: its direction l, of length β^¼.
///
/// A strand keeps its length, so l·(∇u)l = 0. Every pair of neighbours along axis a adds β l_a² (l·(uᵢ − uⱼ))², of the lines
/// of both by halves: motion along a strand comes from its root, however far away that is, while motion across it is free.
/// The products of different axes are left out, which keeps six neighbours; so an oblique line also ties the strands beside it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Inextensible(Vec3);

impl Inextensible {
    /// Of a unit direction and β, against the pull of one neighbour.
    pub fn along(direction: Vec3, beta: f32) -> Self {
        Self(direction * beta.sqrt().sqrt())
    }
}

impl Coupling<Vec3> for Inextensible {
    #[inline]
    fn pull(self, neighbour: Self, axis: usize, value: Vec3) -> Vec3 {
        let tie = |Self(line): Self| line * (0.5 * line[axis] * line[axis] * line.dot(value));
        value + tie(self) + tie(neighbour)
    }

    fn weight(self, neighbour: Self, axis: usize) -> Tensor {
        let tie = |Self(line): Self| Tensor::of_line(line) * (0.5 * line[axis] * line[axis]);
        tie(self) + tie(neighbour)
    }

    fn merged(Self(sum): Self, count: usize) -> Self {
        Self(sum / count as f32)
    }

    /// Lines have no sign.
    fn joined(self, other: Self) -> Self {
        Self(if self.0.dot(other.0) < 0.0 { self.0 - other.0 } else { self.0 + other.0 })
    }
}

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

/// The diffused values of the voxels of `grid` with these linear `indices` (strictly rising), one constraint and one
/// coupling each.
///
/// The result does not depend on the number of threads.
pub fn diffuse<Q: Quantity, C: Coupling<Q>>(
    grid: &Grid,
    indices: &[u32],
    constraints: &[Constraint<Q>],
    couplings: &[C],
    solver: &Solver,
) -> Vec<Q> {
    let mut levels = vec![Level::new(*grid, indices.to_vec(), (constraints, couplings), solver.leak)];
    for _ in 1..solver.levels {
        let next = levels[levels.len() - 1].coarser();
        if next.indices.len() < 64 {
            break;
        }
        levels.push(next);
    }
    let mut coarse: Option<(Level<Q, C>, Vec<Q>)> = None;
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
struct Level<Q: Quantity, C: Coupling<Q>> {
    lookup: VoxelIndex,
    indices: Vec<u32>,
    constraints: Vec<Constraint<Q>>,
    couplings: Vec<C>,
    leak: f32,
}

impl<Q: Quantity, C: Coupling<Q>> Level<Q, C> {
    fn new(grid: Grid, indices: Vec<u32>, (constraints, couplings): (&[Constraint<Q>], &[C]), leak: f32) -> Self {
        let mut occupancy = Occupancy::empty(grid);
        indices.iter().for_each(|&index| occupancy.set(index as usize, true));
        Self {
            lookup: VoxelIndex::new(&occupancy),
            indices,
            constraints: constraints.to_vec(),
            couplings: couplings.to_vec(),
            leak,
        }
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
        let mut together = vec![(C::default(), 0); constraints.len()];
        for ((&parent, child), &coupling) in parents.iter().zip(&self.constraints).zip(&self.couplings) {
            let Some(rank) = lookup.rank(parent) else { continue };
            constraints[rank].pull += child.pull * 0.5;
            constraints[rank].weight += child.weight * 0.5;
            let (sum, count) = &mut together[rank];
            (*sum, *count) = (sum.joined(coupling), *count + 1);
        }
        let couplings = together.into_iter().map(|(sum, count)| C::merged(sum, count)).collect();
        let indices = occupancy.indices().map(|index| index as u32).collect();
        Self { lookup, indices, constraints, couplings, leak: 4.0 * self.leak }
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
        let [even_couplings, odd_couplings] =
            members.each_ref().map(|ranks| ranks.iter().map(|&rank| self.couplings[rank as usize]).collect::<Vec<_>>());
        for _ in 0..sweeps {
            sweep(&even, &mut even_values, (&odd_values, &odd_couplings), relaxation);
            sweep(&odd, &mut odd_values, (&even_values, &even_couplings), relaxation);
        }
        let mut out = start;
        for (ranks, values) in members.iter().zip([even_values, odd_values]) {
            ranks.iter().zip(values).for_each(|(&rank, value)| out[rank as usize] = value);
        }
        out
    }

    /// The stencils of one colour.
    fn half(&self, ranks: &[u32], position: &[u32]) -> Vec<Stencil<Q, C>> {
        let grid = self.lookup.grid;
        let stencil = |&rank: &u32| {
            let [x, y, z] = grid.coordinates(self.indices[rank as usize] as usize).map(|c| c as i64);
            let around = [[x - 1, y, z], [x + 1, y, z], [x, y - 1, z], [x, y + 1, z], [x, y, z - 1], [x, y, z + 1]];
            let ranks = around.map(|voxel| self.lookup.rank_at(voxel));
            let Constraint { pull, mut weight } = self.constraints[rank as usize];
            let coupling = self.couplings[rank as usize];
            for (side, rank) in ranks.iter().enumerate() {
                let Some(neighbour) = rank else { continue };
                weight += coupling.weight(self.couplings[*neighbour], side / 2);
            }
            let present = ranks.iter().flatten().count() as f32;
            let neighbours = ranks.map(|rank| rank.map_or(ABSENT, |rank| position[rank]));
            Stencil { neighbours, inverse: Q::inverse(weight, present + self.leak), pull, coupling }
        };
        ranks.par_iter().map(stencil).collect()
    }
}

/// One voxel's equation: T = inverse (Σ pulls of the neighbours + pull).
struct Stencil<Q: Quantity, C> {
    /// Down and up along each axis.
    neighbours: [u32; 6],
    inverse: Q::Weight,
    pull: Q,
    coupling: C,
}

fn sweep<Q: Quantity, C: Coupling<Q>>(
    stencils: &[Stencil<Q, C>],
    values: &mut [Q],
    (others, couplings): (&[Q], &[C]),
    relaxation: f32,
) {
    values.par_iter_mut().with_min_len(4096).zip(stencils).for_each(|(value, stencil)| {
        let mut sum = stencil.pull;
        for (side, &neighbour) in stencil.neighbours.iter().enumerate() {
            if neighbour != ABSENT {
                let (other, coupling) = (others[neighbour as usize], couplings[neighbour as usize]);
                sum += stencil.coupling.pull(coupling, side / 2, other);
            }
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
        for (&index, found) in
            indices.iter().zip(diffuse(&grid, &indices, &constraints, &vec![(); indices.len()], &solver))
        {
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
        let found = diffuse(&grid, &indices, &constraints, &vec![(); indices.len()], &solver);
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
        for (&index, found) in
            indices.iter().zip(diffuse(&grid, &indices, &constraints, &vec![(); indices.len()], &solver))
        {
            let s = grid.coordinates(index as usize)[0] as f32 / 16.0;
            assert!(found.distance(Vec3::new(1.0 + 4.0 * s, 2.0, 3.0)) < 0.05, "{s} {found}");
        }
    }

    #[test]
    fn motion_along_a_strand_comes_from_its_root_and_not_from_the_strands_beside() {
        // Strands along x in a slab; the root end does not move, one side wall moves by (1, 1, 0).
        let (grid, indices) = slab([33, 9, 9]);
        let all = |weight: f32| Tensor([weight, weight, weight, 0.0, 0.0, 0.0]);
        let constraints: Vec<Constraint<Vec3>> = indices
            .iter()
            .map(|&i| match grid.coordinates(i as usize) {
                [0, ..] => Constraint { pull: Vec3::ZERO, weight: all(1e3) },
                [_, 8, _] => Constraint { pull: Vec3::new(0.1, 0.1, 0.0), weight: all(0.1) },
                _ => Constraint { pull: Vec3::ZERO, weight: Tensor::default() },
            })
            .collect();
        let solver = Solver { levels: 3, sweeps: 200, relaxation: 1.6, leak: 0.0 };
        let tied = vec![Inextensible::along(Vec3::X, 1e3); indices.len()];
        let found = diffuse(&grid, &indices, &constraints, &tied, &solver)[grid.index([20, 4, 4])];
        let free = diffuse(&grid, &indices, &constraints, &vec![(); indices.len()], &solver)[grid.index([20, 4, 4])];
        assert!(free.x > 0.7 && (free.x - free.y).abs() < 0.01, "{free}");
        assert!(found.x < 0.2 && (found.y - free.y).abs() < 0.01, "{found} {free}");
    }
}
