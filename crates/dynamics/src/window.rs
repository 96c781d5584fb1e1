//! One window: simulate from (x⁰, v⁰), compare with the targets (eq. 4), and differentiate exactly.
//!
//! φ = Σᵢ Σⱼ Wᵢⱼ |xⱼⁱ − x̃ⱼⁱ|² over the frames i = 1..=s, with any weights W (aging, masks, normalisation).
//! The gradient is the discrete adjoint of the linearised steps, including the derivative of the Jacobian: one
//! transposed solve a substep with the factor kept from the forward run.
//!
//! Reference: Zhang, Wu, Zhang et al. 2012, eq. 4; McNamara, Treuille, Popović, Stam 2004 (adjoint method).
//! Deviation: exact where the reference method freezes the Jacobian, which is wrong by up to 50 % on noisy states.

use crate::{
    band::{self, BlockRow},
    fused,
    lanes::{Lanes, V3, axpy, scale, sub, zero3},
    params::LaneParams,
    rest::LaneRest,
    system::{self, StepConstants},
};

/// One window of every lane.
pub struct WindowInput<'a, R> {
    /// Rest shapes, n particles.
    pub rest: &'a LaneRest<R>,
    /// Parameters.
    pub params: LaneParams<R>,
    /// Step length, gravity, kinematic count.
    pub constants: StepConstants<R>,
    /// Steps per frame.
    pub substeps: usize,
    /// Initial positions \[mm\], length n.
    pub x0: &'a [V3<R>],
    /// Initial velocities \[mm/s\], length n.
    pub v0: &'a [V3<R>],
    /// Kinematic positions at the frames 0..=s \[mm\], shape (s+1, kinematic); linear in between.
    pub path: &'a [V3<R>],
    /// Targets of the frames 1..=s \[mm\], shape (s, n).
    pub targets: &'a [V3<R>],
    /// Weights of the targets, shape (s, n).
    pub weights: &'a [R],
}

/// Scratch and results of a window; reused, grows once.
pub struct WindowWorkspace<R> {
    x: Vec<V3<R>>,
    v: Vec<V3<R>>,
    factors: Vec<BlockRow<R>>,
    mu: Vec<V3<R>>,
    /// φ.
    pub value: R,
    /// ∂φ/∂p.
    pub by_params: [R; 9],
    /// ∂φ/∂x⁰, length n; meaningless for kinematic particles.
    pub by_x0: Vec<V3<R>>,
    /// ∂φ/∂v⁰, length n; zero for kinematic particles.
    pub by_v0: Vec<V3<R>>,
}

impl<R: Lanes> WindowWorkspace<R> {
    /// Scratch for windows of `steps` substeps and n particles.
    pub fn new(n: usize, steps: usize) -> Self {
        Self {
            x: vec![zero3(); n * (steps + 1)],
            v: vec![zero3(); n * (steps + 1)],
            factors: vec![band::zero_row(); n * steps],
            mu: vec![zero3(); n],
            value: R::zero(),
            by_params: [R::zero(); 9],
            by_x0: vec![zero3(); n],
            by_v0: vec![zero3(); n],
        }
    }

    /// Factors of the steps of the last run, shape (steps, n).
    pub fn factors(&self) -> &[BlockRow<R>] {
        &self.factors
    }

    /// Positions after `step` substeps of the last run \[mm\], length n.
    pub fn positions(&self, step: usize) -> &[V3<R>] {
        let n = self.mu.len();
        &self.x[step * n..(step + 1) * n]
    }

    /// Velocities after `step` substeps of the last run \[mm/s\], length n.
    pub fn velocities(&self, step: usize) -> &[V3<R>] {
        let n = self.mu.len();
        &self.v[step * n..(step + 1) * n]
    }
}

/// One step from (x, v) to (x₁, v₁), with the kinematic particles going to `path`; leaves the factor in `a`. The packs take
/// [`fused::advance`], which is the same in one sweep; this one is the scalar reference.
#[inline(always)]
pub fn advance<R: Lanes>(
    rest: &LaneRest<R>,
    params: &LaneParams<R>,
    s: &StepConstants<R>,
    (x, v): (&[V3<R>], &[V3<R>]),
    path: &[V3<R>],
    a: &mut [BlockRow<R>],
    (x1, v1): (&mut [V3<R>], &mut [V3<R>]),
) {
    system::assemble(rest, params, s, (x, v), a, v1);
    solve(s, path, x, a, v1);
    for i in 0..rest.n {
        x1[i] = if i < s.kinematic { path[i] } else { axpy(s.dt, v1[i], x[i]) };
    }
}

/// Factors and solves the assembled system in place, with the kinematic particles going to `path`.
#[inline(always)]
pub(crate) fn solve<R: Lanes>(
    s: &StepConstants<R>,
    path: &[V3<R>],
    x: &[V3<R>],
    a: &mut [BlockRow<R>],
    v1: &mut [V3<R>],
) {
    let per_step = R::splat(1.0) / s.dt;
    for i in 0..s.kinematic {
        v1[i] = scale(per_step, sub(path[i], x[i]));
    }
    system::condense(a, s.kinematic, v1);
    band::factor(a, s.kinematic);
    band::solve(a, s.kinematic, v1);
}

/// Runs the window forward and leaves φ, states and factors in the workspace.
#[inline(always)]
pub fn simulate<R: Lanes>(input: &WindowInput<R>, w: &mut WindowWorkspace<R>) {
    let (n, fixed) = (input.rest.n, input.constants.kinematic);
    let frames = input.targets.len() / n;
    w.x[..n].copy_from_slice(input.x0);
    w.v[..n].copy_from_slice(input.v0);
    let mut value = R::zero();
    let mut path = [zero3(); MAX_KINEMATIC];
    for frame in 0..frames {
        for sub_step in 0..input.substeps {
            let step = frame * input.substeps + sub_step;
            let along = R::splat((sub_step + 1) as f64 / input.substeps as f64);
            for (i, slot) in path[..fixed].iter_mut().enumerate() {
                let (from, to) = (input.path[frame * fixed + i], input.path[(frame + 1) * fixed + i]);
                *slot = axpy(along, sub(to, from), from);
            }
            let (before, after) = w.x.split_at_mut((step + 1) * n);
            let (v_before, v_after) = w.v.split_at_mut((step + 1) * n);
            let (rest, params, constants) = (input.rest, &input.params, &input.constants);
            let state = (&before[step * n..], &v_before[step * n..]);
            let factors = &mut w.factors[step * n..(step + 1) * n];
            let out = (&mut after[..n], &mut v_after[..n]);
            if R::COUNT > 1 {
                fused::advance(rest, params, constants, state, &path, factors, out);
            } else {
                advance(rest, params, constants, state, &path, factors, out);
            }
        }
        let x = &w.x[(frame + 1) * input.substeps * n..][..n];
        #[expect(clippy::needless_range_loop, reason = "one index through several arrays reads as the formula")]
        for i in fixed..n {
            let d = sub(x[i], input.targets[frame * n + i]);
            let square = d[0].mul_add(d[0], d[1].mul_add(d[1], d[2] * d[2]));
            value = input.weights[frame * n + i].mul_add(square, value);
        }
    }
    w.value = value;
}

/// The most particles a window can clamp.
pub const MAX_KINEMATIC: usize = 8;

/// Runs the window forward and backward: φ and its gradient by parameters, x⁰ and v⁰. Kinematic particles count
/// neither in φ nor in the gradients.
#[inline(always)]
pub fn evaluate<R: Lanes>(input: &WindowInput<R>, w: &mut WindowWorkspace<R>) {
    simulate(input, w);
    let (n, s) = (input.rest.n, &input.constants);
    let fixed = s.kinematic;
    let frames = input.targets.len() / n;
    let two = R::splat(2.0);
    w.by_params = [R::zero(); 9];
    w.by_x0.fill(zero3());
    w.by_v0.fill(zero3());
    w.mu.fill(zero3());
    for step in (0..frames * input.substeps).rev() {
        // What φ says directly about x₁.
        if (step + 1) % input.substeps == 0 {
            let frame = step / input.substeps;
            let x = &w.x[(step + 1) * n..(step + 2) * n];
            #[expect(clippy::needless_range_loop, reason = "one index through several arrays reads as the formula")]
            for i in fixed..n {
                let weight = two * input.weights[frame * n + i];
                w.by_x0[i] = axpy(weight, sub(x[i], input.targets[frame * n + i]), w.by_x0[i]);
            }
        }
        // Through x₁ = x + Δt v₁ and A v₁ = q.
        for i in fixed..n {
            w.mu[i] = axpy(s.dt, w.by_x0[i], w.by_v0[i]);
        }
        band::solve(&w.factors[step * n..(step + 1) * n], fixed, &mut w.mu);
        let x = &w.x[step * n..(step + 1) * n];
        let v1 = &w.v[(step + 1) * n..(step + 2) * n];
        system::adjoint(input.rest, &input.params, s, (x, v1, &w.mu), &mut w.by_x0, &mut w.by_params);
        w.by_v0.copy_from_slice(&w.mu);
    }
}

/// Six (`iterations`) steps of length τ from `x_tilde`, without damping: the minimiser of ½|x−x̃|² + τ²(E(x) − g·x).
/// The kinematic particles stay. `w` needs room for one step. The result is in `x`.
#[inline(always)]
pub fn relax<R: Lanes>(
    rest: &LaneRest<R>,
    params: &LaneParams<R>,
    s: &StepConstants<R>,
    iterations: usize,
    x_tilde: &[V3<R>],
    x: &mut [V3<R>],
    w: &mut WindowWorkspace<R>,
) {
    let n = rest.n;
    let per_step = R::splat(1.0) / s.dt;
    x.copy_from_slice(x_tilde);
    for _ in 0..iterations {
        for i in 0..n {
            w.mu[i] = scale(per_step, sub(x_tilde[i], x[i]));
        }
        let (x1, v1) = (&mut w.x[..n], &mut w.v[..n]);
        if R::COUNT > 1 {
            fused::advance(rest, params, s, (x, &w.mu), x_tilde, &mut w.factors[..n], (x1, v1));
        } else {
            advance(rest, params, s, (x, &w.mu), x_tilde, &mut w.factors[..n], (x1, v1));
        }
        x[s.kinematic..n].copy_from_slice(&x1[s.kinematic..n]);
    }
}
