//! Arithmetic on whole fields of vectors, compiled with the instructions of their lanes.
#![expect(clippy::needless_range_loop, reason = "iterators over vectors lose the vector instructions of their caller")]
#![allow(missing_docs)] // the fields of a job are the arguments of the formula in its sentence

use crate::{
    kernels::Job,
    lanes::{Lanes, V3, axpy, dot},
    linear,
    params::THETA,
};

/// Half the gradient by the initial velocity: data and prior.
pub struct HalfGradient<'a, R> {
    pub by_v0: &'a [V3<R>],
    pub base: &'a [V3<R>],
    pub prior: R,
    pub out: &'a mut [V3<R>],
}

impl<R: Lanes> Job<R> for HalfGradient<'_, R> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let half = R::splat(0.5);
        for i in 0..self.out.len() {
            let (g, v) = (self.by_v0[i], self.base[i]);
            for axis in 0..3 {
                self.out[i][axis] = self.prior.mul_add(v[axis], half * g[axis]);
            }
        }
    }
}

/// Sum of products of two fields.
pub struct Inner<'a, R>(pub &'a [V3<R>], pub &'a [V3<R>]);

impl<R: Lanes> Job<R> for Inner<'_, R> {
    type Output = R;
    #[inline(always)]
    fn run(self) -> R {
        let mut sum = R::zero();
        for i in 0..self.0.len() {
            sum += dot(self.0[i], self.1[i]);
        }
        sum
    }
}

/// The way from the base: −(solution + Σ eliminatedₐ δθₐ) where a lane is `fresh`, else its old way times `shorter`;
/// and the velocity to try.
pub struct Way<'a, R> {
    pub fresh: R,
    pub shorter: R,
    pub solution: &'a [V3<R>],
    pub eliminated: &'a [Vec<V3<R>>],
    pub step: &'a [R; THETA],
    pub way: &'a mut [V3<R>],
    pub base: &'a [V3<R>],
    pub start: &'a [V3<R>],
    pub v0: &'a mut [V3<R>],
    pub fixed: usize,
}

impl<R: Lanes> Job<R> for Way<'_, R> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        for i in self.fixed..self.way.len() {
            let mut next = self.solution[i];
            for a in 0..THETA {
                next = axpy(self.step[a], self.eliminated[a][i], next);
            }
            for axis in 0..3 {
                let old = self.shorter * self.way[i][axis];
                let way = self.fresh.choose(-next[axis], old);
                self.way[i][axis] = way;
                self.v0[i][axis] = self.start[i][axis] + self.base[i][axis] + way;
            }
        }
    }
}

/// Takes the way in the lanes that `accept`, and what they predict.
pub struct Accept<'a, R> {
    pub accept: R,
    pub way: &'a [V3<R>],
    pub base: &'a mut [V3<R>],
}

impl<R: Lanes> Job<R> for Accept<'_, R> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        for i in 0..self.base.len() {
            for axis in 0..3 {
                self.base[i][axis] += self.accept.where_positive(self.way[i][axis]);
            }
        }
    }
}

/// `to` becomes `from` in the lanes that `accept`.
pub struct Keep<'a, R> {
    pub accept: R,
    pub from: &'a [V3<R>],
    pub to: &'a mut [V3<R>],
}

impl<R: Lanes> Job<R> for Keep<'_, R> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        for i in 0..self.to.len() {
            for axis in 0..3 {
                self.to[i][axis] = self.accept.choose(self.from[i][axis], self.to[i][axis]);
            }
        }
    }
}

/// Displacements by one log parameter from two runs: `scale` (after − before), shape (span, n).
pub struct Slope<'a, R> {
    pub before: &'a [V3<R>],
    pub after: &'a [V3<R>],
    pub scale: R,
    pub out: &'a mut [V3<R>],
}

impl<R: Lanes> Job<R> for Slope<'_, R> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        linear::difference(self.after, self.before, self.scale, self.out);
    }
}

/// Σ W a·b over the frames.
pub struct Weighted<'a, R>(pub &'a [R], pub &'a [V3<R>], pub &'a [V3<R>]);

impl<R: Lanes> Job<R> for Weighted<'_, R> {
    type Output = R;
    #[inline(always)]
    fn run(self) -> R {
        let mut sum = R::zero();
        for e in 0..self.0.len() {
            sum = self.0[e].mul_add(dot(self.1[e], self.2[e]), sum);
        }
        sum
    }
}
