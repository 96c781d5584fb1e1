//! A window linearised in its initial velocity, cheap enough to solve for the velocity step of every window.
//!
//! With A v₁ = q of [`crate::system`], springs alike in stiffness and damping (c = τ k) and the derivative of A left out,
//! a change (δx, δv) of the state goes through one step as
//!
//! δv₁ = A⁻¹ (δv + α r δx) − r δx,  δx₁ = δx + Δt δv₁,  with α = 1 + Δt drag and r = 1 / (τ + Δt),
//!
//! one banded solve with a factor that the last simulation left behind. Only the search direction comes from here; value
//! and gradient stay exact.

use crate::{
    band::{self, BlockRow},
    lanes::{Lanes, V3, axpy, dot, sub, zero3},
};

/// The linearised windows of all lanes.
pub struct LinearModel<'a, R> {
    /// Particles.
    pub n: usize,
    /// Kinematic particles.
    pub fixed: usize,
    /// Steps per frame; the factor in the middle of a frame serves for all of them.
    pub substeps: usize,
    /// Factors of all steps, shape (frames · substeps, n).
    pub factors: &'a [BlockRow<R>],
    /// Δt \[s\].
    pub dt: R,
    /// r \[1/s\].
    pub rate: R,
    /// α r \[1/s\].
    pub push: R,
    /// Weights of the targets, shape (frames, n).
    pub weights: &'a [R],
    /// Weight of |δv⁰|² against squared distances \[s²\].
    pub prior: R,
}

/// Scratch of [`solve`]; reused.
pub struct LinearScratch<R> {
    x: Vec<V3<R>>,
    v: Vec<V3<R>>,
    frames: Vec<V3<R>>,
    residual: Vec<V3<R>>,
    direction: Vec<V3<R>>,
    product: Vec<V3<R>>,
}

impl<R: Lanes> LinearScratch<R> {
    /// Scratch for n particles and windows of `span` frames.
    pub fn new(n: usize, span: usize) -> Self {
        let zeros = |count: usize| vec![zero3(); count];
        Self {
            x: zeros(n),
            v: zeros(n),
            frames: zeros(n * span),
            residual: zeros(n),
            direction: zeros(n),
            product: zeros(n),
        }
    }
}

impl<R: Lanes> LinearModel<'_, R> {
    #[inline(always)]
    fn factor(&self, frame: usize) -> &[BlockRow<R>] {
        let step = frame * self.substeps + self.substeps / 2;
        &self.factors[step * self.n..(step + 1) * self.n]
    }

    /// Displacements at the frames that a change `u` of the initial velocity makes, into `frames`, shape (span, n).
    #[inline(always)]
    fn forward(&self, u: &[V3<R>], x: &mut [V3<R>], v: &mut [V3<R>], frames: &mut [V3<R>]) {
        let n = self.n;
        for i in 0..n {
            x[i] = zero3();
            v[i] = u[i];
        }
        for frame in 0..frames.len() / n {
            for _ in 0..self.substeps {
                for i in self.fixed..n {
                    v[i] = axpy(self.push, x[i], v[i]);
                }
                band::solve(self.factor(frame), self.fixed, v);
                for i in self.fixed..n {
                    v[i] = axpy(-self.rate, x[i], v[i]);
                    x[i] = axpy(self.dt, v[i], x[i]);
                }
            }
            for i in 0..n {
                frames[frame * n + i] = x[i];
            }
        }
    }

    /// The transpose of [`Self::forward`]: from weighted displacements at the frames to the initial velocity, into `v`.
    #[inline(always)]
    fn backward(&self, frames: &[V3<R>], x: &mut [V3<R>], v: &mut [V3<R>]) {
        let n = self.n;
        for i in 0..n {
            x[i] = zero3();
            v[i] = zero3();
        }
        for frame in (0..frames.len() / n).rev() {
            for i in self.fixed..n {
                let w = self.weights[frame * n + i];
                x[i] = axpy(w, frames[frame * n + i], x[i]);
            }
            for _ in 0..self.substeps {
                for i in self.fixed..n {
                    v[i] = axpy(self.dt, x[i], v[i]);
                    x[i] = axpy(-self.rate, v[i], x[i]);
                }
                band::solve(self.factor(frame), self.fixed, v);
                for i in self.fixed..n {
                    x[i] = axpy(self.push, v[i], x[i]);
                }
            }
        }
    }
}

/// JᵀW `frames`: what displacements at the frames, shape (span, n), say about the initial velocity, into `out`.
#[inline(always)]
pub fn gather<R: Lanes>(model: &LinearModel<R>, frames: &[V3<R>], out: &mut [V3<R>], scratch: &mut LinearScratch<R>) {
    model.backward(frames, &mut scratch.x, out);
}

/// Solves (JᵀWJ + prior) `out` = `rhs` by `iterations` conjugate gradients from zero, each lane with its own steps.
#[inline(always)]
pub fn solve<R: Lanes>(
    model: &LinearModel<R>,
    rhs: &[V3<R>],
    out: &mut [V3<R>],
    iterations: usize,
    scratch: &mut LinearScratch<R>,
) {
    let LinearScratch { x, v, frames, residual, direction, product } = scratch;
    let (n, fixed) = (model.n, model.fixed);
    let tiny = R::splat(1e-30);
    let mut square = R::zero();
    for i in 0..n {
        out[i] = zero3();
        residual[i] = if i < fixed { zero3() } else { rhs[i] };
        direction[i] = residual[i];
        square += dot(residual[i], residual[i]);
    }
    for _ in 0..iterations {
        model.forward(direction, x, v, frames);
        model.backward(frames, x, product);
        let mut curvature = R::zero();
        for i in fixed..n {
            product[i] = axpy(model.prior, direction[i], product[i]);
            curvature += dot(direction[i], product[i]);
        }
        let step = square / (curvature + tiny);
        let mut next = R::zero();
        for i in fixed..n {
            out[i] = axpy(step, direction[i], out[i]);
            residual[i] = axpy(-step, product[i], residual[i]);
            next += dot(residual[i], residual[i]);
        }
        let share = next / (square + tiny);
        for i in fixed..n {
            direction[i] = axpy(share, direction[i], residual[i]);
        }
        square = next;
    }
}

/// Displacements between two runs' frames times `scale`, shape (span, n).
#[inline(always)]
pub fn difference<R: Lanes>(a: &[V3<R>], b: &[V3<R>], scale: R, out: &mut [V3<R>]) {
    for i in 0..out.len() {
        let d = sub(a[i], b[i]);
        out[i] = [scale * d[0], scale * d[1], scale * d[2]];
    }
}
