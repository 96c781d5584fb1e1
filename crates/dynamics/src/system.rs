//! One implicit step as a linear system in the new velocity, and its adjoint.
//!
//! Eq. 3 with unit mass reads (I + Δt D + Δt² K) Δv = Δt (f − Δt K v). Written for v₁ = v + Δv the damping force and K v
//! cancel:
//!
//! A v₁ = v + Δt g + Δt a − Δt Σ k (C − C₀) ∇C,  A = (1 + Δt drag) I + Σ (Δt c + Δt² k) ∇C∇Cᵀ + transverse terms,
//!
//! which is cheaper and makes the residual one formula for the adjoint (METHOD §4). K is *clamped*: the transverse part
//! of a spring counts only while the spring is stretched, so that A stays positive definite.
//!
//! Reference: Zhang, Wu, Zhang et al. 2012, eq. 3; Baraff, Witkin 1998; Choi, Ko 2002 (clamping).
//! Deviation: the printed equation uses the raw Jacobian, which fails in 12 of 12 runs from a state with 3 mm of noise.

use crate::{
    altitude::{altitude_adjoint, altitude_gradients},
    band::{Block, BlockRow, zero_row},
    lanes::{Lanes, V3, add, axpy, dot, scale, sub, zero3},
    params::LaneParams,
    rest::LaneRest,
};

/// What of the force's derivative the linear system keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Jacobian {
    /// Stretch, and the transverse part of stretched springs: always positive definite.
    Clamped,
    /// Stretch only.
    Rank1,
    /// The true derivative, see [`crate::exact`]: for scalar steps only, without an adjoint, and not for noisy states.
    Exact,
}

impl Jacobian {
    /// Factor of the transverse part in [`assemble`].
    #[inline(always)]
    pub(crate) fn transverse<R: Lanes>(self) -> R {
        R::splat(if self == Self::Clamped { 1.0 } else { 0.0 })
    }
}

/// Constants of a step.
#[derive(Clone, Copy, Debug)]
pub struct StepConstants<R> {
    /// Step length Δt \[s\].
    pub dt: R,
    /// Gravity \[mm/s²\].
    pub gravity: V3<R>,
    /// Factor of the transverse part: 1 clamped, 0 rank-1.
    pub transverse: R,
    /// Kinematic particles, counted from the root.
    pub kinematic: usize,
}

/// Writes A and the right-hand side `q` for the state (x, v), all particles free.
#[inline(always)]
pub fn assemble<R: Lanes>(
    rest: &LaneRest<R>,
    p: &LaneParams<R>,
    s: &StepConstants<R>,
    (x, v): (&[V3<R>], &[V3<R>]),
    a: &mut [BlockRow<R>],
    q: &mut [V3<R>],
) {
    let n = rest.n;
    let identity = s.dt.mul_add(p.0[8], R::splat(1.0));
    for i in 0..n {
        a[i] = zero_row();
        (a[i][0][0], a[i][0][4], a[i][0][8]) = (identity, identity, identity);
        q[i] = axpy(s.dt, s.gravity, v[i]);
    }
    for order in 1..4 {
        for j in order..n {
            pair(rest, p, s, x, order, j, a, q);
        }
    }
    for i in 0..n.saturating_sub(3) {
        tetrahedron(rest, p, s, x, i, a, q);
    }
}

/// Adds the spring of this order that ends in particle j.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // the inner loop of `assemble`
fn pair<R: Lanes>(
    rest: &LaneRest<R>,
    p: &LaneParams<R>,
    s: &StepConstants<R>,
    x: &[V3<R>],
    order: usize,
    j: usize,
    a: &mut [BlockRow<R>],
    q: &mut [V3<R>],
) {
    let i = j - order;
    let on = rest.on[order - 1][i];
    let (k, c) = (on * p.0[order - 1], on * p.0[order + 3]);
    let (n, length, inverse) = direction(x[i], x[j]);
    let l0 = rest.lengths[order - 1][i];
    let slack = (R::splat(1.0) - l0 * inverse).at_least_zero() * s.transverse;
    let dt2k = s.dt * s.dt * k;
    let across = dt2k * slack;
    let along = s.dt.mul_add(c, dt2k) - across;
    let an = scale(along, n);
    let b = [
        an[0].mul_add(n[0], across),
        an[0] * n[1],
        an[0] * n[2],
        an[1] * n[0],
        an[1].mul_add(n[1], across),
        an[1] * n[2],
        an[2] * n[0],
        an[2] * n[1],
        an[2].mul_add(n[2], across),
    ];
    for e in 0..9 {
        a[i][0][e] += b[e];
        a[j][0][e] += b[e];
        a[j][order][e] -= b[e];
    }
    let impulse = scale(s.dt * k * (length - l0), n);
    q[i] = add(q[i], impulse);
    q[j] = sub(q[j], impulse);
}

/// Unit vector from a to b, its length and the reciprocal. Coincident points give a zero vector.
#[inline(always)]
pub(crate) fn direction<R: Lanes>(a: V3<R>, b: V3<R>) -> (V3<R>, R, R) {
    let d = sub(b, a);
    let length = (dot(d, d) + R::splat(1e-13)).sqrt();
    let inverse = R::splat(1.0) / length;
    (scale(inverse, d), length, inverse)
}

/// Adds the seven altitude springs of particles i..i+4.
#[inline(always)]
fn tetrahedron<R: Lanes>(
    rest: &LaneRest<R>,
    p: &LaneParams<R>,
    s: &StepConstants<R>,
    x: &[V3<R>],
    i: usize,
    a: &mut [BlockRow<R>],
    q: &mut [V3<R>],
) {
    let on = rest.on[2][i];
    let (k, c) = (on * p.0[3], on * p.0[7]);
    let (h, g) = altitude_gradients([x[i], x[i + 1], x[i + 2], x[i + 3]], rest.epsilon2);
    let weight = s.dt.mul_add(s.dt * k, s.dt * c);
    let mut impulse = [zero3::<R>(); 3];
    let mut weighted = g;
    for t in 0..7 {
        let f = s.dt * k * (h[t] - rest.altitudes[i][t]);
        for e in 0..3 {
            impulse[e] = axpy(f, g[t][e], impulse[e]);
            weighted[t][e] = scale(weight, g[t][e]);
        }
    }
    // Σ w g gᵀ over the seven, by blocks of e₁ e₂ e₃.
    let (m11, m22, m33) = (outer(&weighted, &g, 0, 0), outer(&weighted, &g, 1, 1), outer(&weighted, &g, 2, 2));
    let (m21, m31, m32) = (outer(&weighted, &g, 1, 0), outer(&weighted, &g, 2, 0), outer(&weighted, &g, 2, 1));
    // Particle a carries minus the sum of the others.
    for r in 0..3 {
        for col in 0..3 {
            let (e, t) = (3 * r + col, 3 * col + r);
            a[i + 1][0][e] += m11[e];
            a[i + 2][0][e] += m22[e];
            a[i + 3][0][e] += m33[e];
            a[i + 2][1][e] += m21[e];
            a[i + 3][2][e] += m31[e];
            a[i + 3][1][e] += m32[e];
            let (ba, ca, da) = (m11[e] + m21[t] + m31[t], m21[e] + m22[e] + m32[t], m31[e] + m32[e] + m33[e]);
            a[i + 1][1][e] -= ba;
            a[i + 2][2][e] -= ca;
            a[i + 3][3][e] -= da;
            a[i][0][e] += ba + ca + da;
        }
    }
    for e in 0..3 {
        q[i + 1 + e] = sub(q[i + 1 + e], impulse[e]);
        q[i] = add(q[i], impulse[e]);
    }
}

/// Σₜ aₜ bₜᵀ of the chosen edge gradients.
#[inline(always)]
fn outer<R: Lanes>(a: &[[V3<R>; 3]; 7], b: &[[V3<R>; 3]; 7], row: usize, col: usize) -> Block<R> {
    let mut m = [R::zero(); 9];
    for t in 0..7 {
        for r in 0..3 {
            for s in 0..3 {
                m[3 * r + s] = a[t][row][r].mul_add(b[t][col][s], m[3 * r + s]);
            }
        }
    }
    m
}

/// Moves what the known velocities of the kinematic particles (the first entries of `q`) contribute to the free
/// particles' right-hand side.
#[inline(always)]
pub fn condense<R: Lanes>(a: &[BlockRow<R>], kinematic: usize, q: &mut [V3<R>]) {
    for i in kinematic..(kinematic + 3).min(a.len()) {
        for d in 1..4 {
            if i >= d && i - d < kinematic {
                let (block, w) = (&a[i][d], q[i - d]);
                for r in 0..3 {
                    q[i][r] -= block[3 * r].mul_add(w[0], block[3 * r + 1].mul_add(w[1], block[3 * r + 2] * w[2]));
                }
            }
        }
    }
}

/// Positions, velocities after the step and multipliers of one strand, per particle.
type Motion<'a, R> = (&'a [V3<R>], &'a [V3<R>], &'a [V3<R>]);

/// Derivatives of the residual R·μ of one step by state and parameters: adds −∂(R·μ)/∂x to `by_x`, −∂(R·μ)/∂p to `by_p`.
/// `mu` must vanish on kinematic particles. (By v the derivative of −R·μ is μ itself.)
#[inline(always)]
pub fn adjoint<R: Lanes>(
    rest: &LaneRest<R>,
    p: &LaneParams<R>,
    s: &StepConstants<R>,
    (x, v1, mu): Motion<R>,
    by_x: &mut [V3<R>],
    by_p: &mut [R; 9],
) {
    let n = rest.n;
    for order in 1..4 {
        for j in order..n {
            pair_adjoint(rest, p, s, (x, v1, mu), (order, j), by_x, by_p);
        }
    }
    for i in 0..n.saturating_sub(3) {
        let on = rest.on[2][i];
        let (k, c) = (on * p.0[3], on * p.0[7]);
        let e = altitude_adjoint(four(x, i), four(mu, i), four(v1, i), &rest.altitudes[i], rest.epsilon2, k, c, s.dt);
        for d in 0..3 {
            let g = scale(s.dt, e.by_edges[d]);
            by_x[i + 1 + d] = sub(by_x[i + 1 + d], g);
            by_x[i] = add(by_x[i], g);
        }
        by_p[3] -= s.dt * on * e.by_stiffness;
        by_p[7] -= s.dt * on * e.by_damping;
    }
    for i in s.kinematic..n {
        by_p[8] -= s.dt * dot(mu[i], v1[i]);
    }
}

/// Four consecutive entries from i on.
#[inline(always)]
fn four<R: Lanes>(y: &[V3<R>], i: usize) -> [V3<R>; 4] {
    [y[i], y[i + 1], y[i + 2], y[i + 3]]
}

/// The pair spring's part of [`adjoint`].
#[inline(always)]
fn pair_adjoint<R: Lanes>(
    rest: &LaneRest<R>,
    p: &LaneParams<R>,
    s: &StepConstants<R>,
    (x, v1, mu): Motion<R>,
    (order, j): (usize, usize),
    by_x: &mut [V3<R>],
    by_p: &mut [R; 9],
) {
    let i = j - order;
    let on = rest.on[order - 1][i];
    let (k, c) = (on * p.0[order - 1], on * p.0[order + 3]);
    let (n, length, inverse) = direction(x[i], x[j]);
    let l0 = rest.lengths[order - 1][i];
    let slack_raw = R::splat(1.0) - l0 * inverse;
    let slack = slack_raw.at_least_zero() * s.transverse;
    let slack_slope = slack_raw.where_positive(l0 * inverse * inverse) * s.transverse;
    let (m, w) = (sub(mu[j], mu[i]), sub(v1[j], v1[i]));
    let (nm, nw) = (dot(n, m), dot(n, w));
    let (pm, pw) = (axpy(-nm, n, m), axpy(-nw, n, w));
    let transverse = dot(pm, w);
    let beta = s.dt.mul_add(k, c);
    let force = k.mul_add(length - l0, beta * nw);
    let dt2k = s.dt * s.dt * k;
    // E = Δt (n·m) F + Δt² k t (Pm·w) by x_j; by x_i the opposite.
    let along = s.dt.mul_add(nm * k, dt2k * slack_slope * transverse);
    let fall = dt2k * slack * inverse;
    let on_pm = (s.dt * inverse).mul_add(force, -(fall * nw));
    let on_pw = (s.dt * inverse * beta).mul_add(nm, -(fall * nm));
    let g = axpy(along, n, axpy(on_pm, pm, scale(on_pw, pw)));
    by_x[j] = sub(by_x[j], g);
    by_x[i] = add(by_x[i], g);
    let stretch = nm * s.dt.mul_add(nw, length - l0);
    by_p[order - 1] -= s.dt * on * s.dt.mul_add(slack * transverse, stretch);
    by_p[order + 3] -= s.dt * on * nm * nw;
}
