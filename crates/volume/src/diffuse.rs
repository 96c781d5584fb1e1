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

use glam::{Vec3, Vec4};
use rayon::prelude::*;
use strandflow_core::{Grid, Occupancy};

use crate::{tensor::Tensor, velocity::VoxelIndex};

/// Marks an absent neighbour: beyond all positions.
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
    /// What neighbours read of a voxel: its value, and what of the coupling depends on that voxel alone.
    type Shown: Copy + Default + Send + Sync;
    /// A sum over neighbours.
    type Sum;

    /// What a voxel of this value shows.
    fn shown(self, value: Q) -> Self::Shown;

    /// The value of a voxel.
    fn value(shown: &Self::Shown) -> Q;

    /// The sum before the first neighbour, of what is asked for.
    fn asked(pull: Q) -> Self::Sum;

    /// Adds the pull of a neighbour along an axis (0, 1, 2).
    fn add(self, sum: &mut Self::Sum, neighbour: &Self::Shown, axis: usize);

    /// The pull of all that was added.
    fn total(self, sum: Self::Sum) -> Q;

    /// What the pull of a neighbour weighs beyond 1.
    fn weight(self, neighbour: Self, axis: usize) -> Q::Weight;

    /// That of eight voxels together, of which `count` are present.
    fn merged(sum: Self, count: usize) -> Self;

    /// The sum of those of two voxels.
    fn joined(self, other: Self) -> Self;
}

/// Neighbours pull evenly.
impl<Q: Quantity> Coupling<Q> for () {
    type Shown = Q;
    type Sum = Q;

    #[inline]
    fn shown(self, value: Q) -> Q {
        value
    }

    #[inline]
    fn value(shown: &Q) -> Q {
        *shown
    }

    #[inline]
    fn asked(pull: Q) -> Q {
        pull
    }

    #[inline]
    fn add(self, sum: &mut Q, neighbour: &Q, _: usize) {
        *sum += *neighbour;
    }

    #[inline]
    fn total(self, sum: Q) -> Q {
        sum
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

/// What neighbours read of motion u along a line l that does not stretch.
#[derive(Clone, Copy, Default)]
pub struct Tied {
    /// u.
    value: Vec4,
    /// l (l·u) / 2.
    along: Vec4,
    /// The squares of l along each axis.
    squares: [f32; 3],
}

/// The sums over the neighbours j of uⱼ + lⱼ l_ja² (lⱼ·uⱼ) / 2, and of l_ia² uⱼ.
pub struct Ties {
    pull: Vec4,
    weighted: Vec4,
}

impl Coupling<Vec3> for Inextensible {
    type Shown = Tied;
    type Sum = Ties;

    #[inline]
    fn shown(self, value: Vec3) -> Tied {
        let Self(line) = self;
        let along = line * (0.5 * line.dot(value));
        Tied { value: value.extend(0.0), along: along.extend(0.0), squares: (line * line).to_array() }
    }

    #[inline]
    fn value(shown: &Tied) -> Vec3 {
        shown.value.truncate()
    }

    #[inline]
    fn asked(pull: Vec3) -> Ties {
        Ties { pull: pull.extend(0.0), weighted: Vec4::ZERO }
    }

    #[inline]
    fn add(self, sum: &mut Ties, neighbour: &Tied, axis: usize) {
        sum.pull += neighbour.value + neighbour.along * neighbour.squares[axis];
        sum.weighted += neighbour.value * (self.0[axis] * self.0[axis]);
    }

    #[inline]
    fn total(self, sum: Ties) -> Vec3 {
        let Self(line) = self;
        sum.pull.truncate() + line * (0.5 * line.dot(sum.weighted.truncate()))
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
    Diffusion::new(grid, indices, couplings, solver).solve(constraints)
}

/// Voxels and their couplings at all resolutions, for several sets of constraints.
pub struct Diffusion<Q: Quantity, C: Coupling<Q>> {
    /// The finest first.
    levels: Vec<Level<Q, C>>,
    solver: Solver,
}

impl<Q: Quantity, C: Coupling<Q>> Diffusion<Q, C> {
    /// Of the voxels of `grid` with these linear `indices` (strictly rising), one coupling each.
    pub fn new(grid: &Grid, indices: &[u32], couplings: &[C], solver: &Solver) -> Self {
        let mut finest = Occupancy::empty(*grid);
        indices.iter().for_each(|&index| finest.set(index as usize, true));
        let mut voxels = Voxels { lookup: VoxelIndex::new(&finest), indices: indices.to_vec() };
        let mut couplings = couplings.to_vec();
        let mut leak = solver.leak;
        let mut levels: Vec<Level<Q, C>> = Vec::new();
        for _ in 1..solver.levels {
            let (coarser, parents) = voxels.coarser();
            if coarser.indices.len() < 64 {
                break;
            }
            let merged = merged(&couplings, &parents, coarser.indices.len());
            levels.push(Level::new(&voxels, &couplings, parents, leak));
            (voxels, couplings, leak) = (coarser, merged, 4.0 * leak);
        }
        levels.push(Level::new(&voxels, &couplings, Vec::new(), leak));
        Self { levels, solver: *solver }
    }

    /// The diffused values, one a voxel, of one constraint each.
    pub fn solve(&self, constraints: &[Constraint<Q>]) -> Vec<Q> {
        let mut asked = vec![constraints.to_vec()];
        for pair in self.levels.windows(2) {
            asked.push(pair[0].asked_of_parents(&asked[asked.len() - 1], pair[1].count));
        }
        let mut coarse: Option<Vec<Q>> = None;
        for (level, constraints) in self.levels.iter().zip(&asked).rev() {
            let start = match &coarse {
                // The parent's value at each voxel.
                Some(solution) => level.parents.par_iter().map(|&parent| solution[parent as usize]).collect(),
                // What is asked for where it is asked for; the small diagonal keeps unmeasured directions at zero.
                None => constraints.iter().map(|c| Q::apply(&Q::inverse(c.weight, 1e-3), c.pull)).collect(),
            };
            let longer = if coarse.is_none() && self.solver.levels > 1 { 4 } else { 1 };
            coarse = Some(level.relax(constraints, start, longer * self.solver.sweeps, self.solver.relaxation));
        }
        coarse.unwrap_or_default()
    }
}

/// The voxels of one resolution.
struct Voxels {
    lookup: VoxelIndex,
    indices: Vec<u32>,
}

impl Voxels {
    /// Those of half the resolution, and the position of the parent of each voxel among them.
    fn coarser(&self) -> (Self, Vec<u32>) {
        let fine = self.lookup.grid;
        let grid = fine.halved();
        let mut occupancy = Occupancy::empty(grid);
        let parents: Vec<usize> = self.indices.iter().map(|&i| parent_of(&fine, &grid, i)).collect();
        parents.iter().for_each(|&parent| occupancy.set(parent, true));
        let lookup = VoxelIndex::new(&occupancy);
        let parents = parents.into_iter().filter_map(|parent| lookup.rank(parent)).map(|rank| rank as u32).collect();
        let indices = occupancy.indices().map(|index| index as u32).collect();
        (Self { lookup, indices }, parents)
    }

    /// The positions of a voxel's neighbours: down and up along each axis.
    fn around(&self, rank: usize) -> [Option<usize>; 6] {
        let [x, y, z] = self.lookup.grid.coordinates(self.indices[rank] as usize).map(|c| c as i64);
        [[x - 1, y, z], [x + 1, y, z], [x, y - 1, z], [x, y + 1, z], [x, y, z - 1], [x, y, z + 1]]
            .map(|voxel| self.lookup.rank_at(voxel))
    }
}

/// The couplings of `count` parents.
fn merged<Q: Quantity, C: Coupling<Q>>(couplings: &[C], parents: &[u32], count: usize) -> Vec<C> {
    let mut together = vec![(C::default(), 0); count];
    for (&parent, &coupling) in parents.iter().zip(couplings) {
        let (sum, count) = &mut together[parent as usize];
        (*sum, *count) = (sum.joined(coupling), *count + 1);
    }
    together.into_iter().map(|(sum, count)| C::merged(sum, count)).collect()
}

/// One resolution: its voxels by colour, those of even and those of odd coordinate sum. Neighbours differ in parity.
struct Level<Q: Quantity, C: Coupling<Q>> {
    count: usize,
    /// The position of each voxel's parent at the next coarser resolution; empty at the coarsest.
    parents: Vec<u32>,
    colours: [Colour<Q, C>; 2],
}

/// The voxels of one colour.
struct Colour<Q: Quantity, C> {
    /// The position of each among all voxels.
    ranks: Vec<u32>,
    stencils: Vec<Stencil<C>>,
    /// What the neighbours weigh beyond 1 each, and the number of neighbours and the leak.
    weights: Vec<(Q::Weight, f32)>,
}

/// A voxel and its neighbours.
struct Stencil<C> {
    /// Positions within the other colour, down and up along each axis.
    neighbours: [u32; 6],
    coupling: C,
}

/// One voxel's equation: T = inverse (Σ pulls of the neighbours + pull).
struct Equation<Q: Quantity> {
    inverse: Q::Weight,
    pull: Q,
}

impl<Q: Quantity, C: Coupling<Q>> Level<Q, C> {
    fn new(voxels: &Voxels, couplings: &[C], parents: Vec<u32>, leak: f32) -> Self {
        let grid = voxels.lookup.grid;
        let parity = |index: u32| grid.coordinates(index as usize).iter().sum::<usize>() % 2;
        // Position of each voxel within its colour.
        let mut position = Vec::with_capacity(voxels.indices.len());
        let mut members: [Vec<u32>; 2] = [Vec::new(), Vec::new()];
        for (rank, &index) in voxels.indices.iter().enumerate() {
            let colour = &mut members[parity(index)];
            position.push(colour.len() as u32);
            colour.push(rank as u32);
        }
        let of = |&rank: &u32| {
            let (around, coupling) = (voxels.around(rank as usize), couplings[rank as usize]);
            let mut weight = Q::Weight::default();
            for (side, neighbour) in around.iter().enumerate() {
                neighbour.iter().for_each(|&neighbour| weight += coupling.weight(couplings[neighbour], side / 2));
            }
            let present = around.iter().flatten().count() as f32;
            let neighbours = around.map(|rank| rank.map_or(ABSENT, |rank| position[rank]));
            (Stencil { neighbours, coupling }, (weight, present + leak))
        };
        let colours = members.map(|ranks| {
            let (stencils, weights) = ranks.par_iter().map(of).unzip();
            Colour { ranks, stencils, weights }
        });
        Self { count: voxels.indices.len(), parents, colours }
    }

    /// The constraints of half the resolution. Against the pull of a neighbour, which doubles with the edge, the weights of
    /// the eight children count half, and so does their leak: κ quadruples.
    fn asked_of_parents(&self, constraints: &[Constraint<Q>], count: usize) -> Vec<Constraint<Q>> {
        let mut asked = vec![Constraint { pull: Q::default(), weight: Q::Weight::default() }; count];
        for (&parent, child) in self.parents.iter().zip(constraints) {
            asked[parent as usize].pull += child.pull * 0.5;
            asked[parent as usize].weight += child.weight * 0.5;
        }
        asked
    }

    /// Sweeps of over-relaxation: first all even voxels, then all odd ones, so that each half reads only the other.
    fn relax(&self, constraints: &[Constraint<Q>], start: Vec<Q>, sweeps: usize, relaxation: f32) -> Vec<Q> {
        let [even, odd] = &self.colours;
        let equations = [even, odd].map(|colour| colour.equations(constraints));
        let [mut of_even, mut of_odd] = [even, odd].map(|colour| colour.shown(&start));
        for _ in 0..sweeps {
            even.sweep(&equations[0], &mut of_even, &of_odd, relaxation);
            odd.sweep(&equations[1], &mut of_odd, &of_even, relaxation);
        }
        let mut out = start;
        for (colour, shown) in self.colours.iter().zip([of_even, of_odd]) {
            colour.ranks.iter().zip(&shown).for_each(|(&rank, shown)| out[rank as usize] = C::value(shown));
        }
        out
    }
}

impl<Q: Quantity, C: Coupling<Q>> Colour<Q, C> {
    fn equations(&self, constraints: &[Constraint<Q>]) -> Vec<Equation<Q>> {
        let of = |(&rank, &(mut weight, diagonal)): (&u32, &(Q::Weight, f32))| {
            let asked = &constraints[rank as usize];
            weight += asked.weight;
            Equation { inverse: Q::inverse(weight, diagonal), pull: asked.pull }
        };
        self.ranks.par_iter().zip(&self.weights).map(of).collect()
    }

    fn shown(&self, values: &[Q]) -> Vec<C::Shown> {
        self.ranks.iter().zip(&self.stencils).map(|(&rank, s)| s.coupling.shown(values[rank as usize])).collect()
    }

    fn sweep(&self, equations: &[Equation<Q>], own: &mut [C::Shown], others: &[C::Shown], relaxation: f32) {
        let voxels = own.par_iter_mut().with_min_len(4096).zip(&self.stencils).zip(equations);
        voxels.for_each(|((shown, Stencil { neighbours, coupling }), equation)| {
            let mut sum = C::asked(equation.pull);
            for (side, &neighbour) in neighbours.iter().enumerate() {
                if let Some(other) = others.get(neighbour as usize) {
                    coupling.add(&mut sum, other, side / 2);
                }
            }
            let target = Q::apply(&equation.inverse, coupling.total(sum));
            *shown = coupling.shown(C::value(shown) * (1.0 - relaxation) + target * relaxation);
        });
    }
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
