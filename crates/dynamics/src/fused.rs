//! One implicit step in a single sweep along the strand: springs, factor and forward substitution of a row while the row
//! is in the nearest cache.
//!
//! The same system as [`crate::system::assemble`], [`crate::band::factor`] and [`crate::band::solve`] one after the other,
//! which stays the reference that the packs are tested and timed against. When the springs that end in particle i are
//! added, row i−3 has got all it gets: it is factored at once. A sweep touches seven rows (8 KiB with eight lanes of
//! `f32`) instead of all of them (46 KiB) six times. Diagonal blocks are kept as lower triangles.
#![expect(clippy::needless_range_loop, reason = "iterators over vectors lose the vector instructions of their caller")]

use crate::{
    altitude::altitude_gradients,
    band::{Block, BlockRow, solve_right},
    lanes::{Lanes, V3, add, axpy, scale, sub, zero3},
    params::LaneParams,
    rest::LaneRest,
    system::{StepConstants, direction},
};

/// The lower triangle of a symmetric block: entries 00, 10, 11, 20, 21, 22.
type Lower<R> = [R; 6];

/// What the springs that end in one particle add, by pairs of the four particles a, b, c, d.
struct Stencil<R> {
    /// Blocks (a, a), (b, b), (c, c), (d, d).
    diagonal: [Lower<R>; 4],
    ba: Block<R>,
    ca: Block<R>,
    cb: Block<R>,
    da: Block<R>,
    db: Block<R>,
    dc: Block<R>,
    /// Impulses on a, b, c, d.
    impulse: [V3<R>; 4],
}

/// One step from (x, v) to (x₁, v₁), with the kinematic particles going to `path`; leaves the factor in `a`.
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
    let n = rest.n;
    let (x, v, a, x1, v1) = (&x[..n], &v[..n], &mut a[..n], &mut x1[..n], &mut v1[..n]);
    let identity = s.dt.mul_add(params.0[8], R::splat(1.0));
    let per_step = R::splat(1.0) / s.dt;
    for i in 0..n {
        springs(rest, params, s, (x, v), (identity, i), a, v1);
        if i >= 3 {
            finish_row(s, per_step, path, x, i - 3, a, v1);
        }
    }
    for i in n.saturating_sub(3)..n {
        finish_row(s, per_step, path, x, i, a, v1);
    }
    back_substitute(a, s.kinematic, v1);
    for i in 0..n {
        x1[i] = if i < s.kinematic { path[i] } else { axpy(s.dt, v1[i], x[i]) };
    }
}

/// The springs of [`advance`] alone: writes the whole system before anything is factored. For timing.
#[inline(always)]
pub(crate) fn assemble<R: Lanes>(
    rest: &LaneRest<R>,
    params: &LaneParams<R>,
    s: &StepConstants<R>,
    (x, v): (&[V3<R>], &[V3<R>]),
    a: &mut [BlockRow<R>],
    q: &mut [V3<R>],
) {
    let n = rest.n;
    let (x, v, a, q) = (&x[..n], &v[..n], &mut a[..n], &mut q[..n]);
    let identity = s.dt.mul_add(params.0[8], R::splat(1.0));
    for i in 0..n {
        springs(rest, params, s, (x, v), (identity, i), a, q);
    }
}

/// The rest of [`advance`]: factors and solves what [`assemble`] wrote. For timing.
#[inline(always)]
pub(crate) fn factor_and_solve<R: Lanes>(
    s: &StepConstants<R>,
    path: &[V3<R>],
    x: &[V3<R>],
    a: &mut [BlockRow<R>],
    y: &mut [V3<R>],
) {
    let n = a.len();
    let (x, y) = (&x[..n], &mut y[..n]);
    let per_step = R::splat(1.0) / s.dt;
    for i in 0..n {
        finish_row(s, per_step, path, x, i, a, y);
    }
    back_substitute(a, s.kinematic, y);
}

/// The impulses of gravity and of all springs at the state (x, v), added to v, without any matrix. For timing.
#[inline(always)]
pub(crate) fn forces<R: Lanes>(
    rest: &LaneRest<R>,
    params: &LaneParams<R>,
    s: &StepConstants<R>,
    (x, v): (&[V3<R>], &[V3<R>]),
    q: &mut [V3<R>],
) {
    let n = rest.n;
    let (x, v, q) = (&x[..n], &v[..n], &mut q[..n]);
    for i in 0..n {
        q[i] = axpy(s.dt, s.gravity, v[i]);
        if i >= 3 {
            let (_, p) = pulls(rest, params, s, x, i - 3);
            q[i - 3] = add(q[i - 3], add(p[0], add(p[1], p[2])));
            (q[i - 2], q[i - 1], q[i]) = (sub(q[i - 2], p[0]), sub(q[i - 1], p[1]), sub(q[i], p[2]));
        }
        for order in 1..=i.min(3) {
            let impulse = stretch(rest, params, s, x, (order, i)).impulse;
            (q[i - order], q[i]) = (add(q[i - order], impulse), sub(q[i], impulse));
        }
    }
}

/// Begins row i with the identity's factor, and adds all springs that end in particle i.
#[inline(always)]
fn springs<R: Lanes>(
    rest: &LaneRest<R>,
    params: &LaneParams<R>,
    s: &StepConstants<R>,
    (x, v): (&[V3<R>], &[V3<R>]),
    (identity, i): (R, usize),
    a: &mut [BlockRow<R>],
    q: &mut [V3<R>],
) {
    q[i] = axpy(s.dt, s.gravity, v[i]);
    if i >= 3 {
        let mut t = tetrahedron(rest, params, s, x, i - 3);
        pair(rest, params, s, x, (1, i), &mut t);
        pair(rest, params, s, x, (2, i), &mut t);
        pair(rest, params, s, x, (3, i), &mut t);
        scatter(&t, identity, i, a, q);
    } else {
        let mut t = empty();
        for order in 1..=i {
            pair(rest, params, s, x, (order, i), &mut t);
        }
        scatter_first(&t, identity, i, a, q);
    }
}

#[inline(always)]
fn empty<R: Lanes>() -> Stencil<R> {
    let (lower, block) = ([R::zero(); 6], [R::zero(); 9]);
    Stencil {
        diagonal: [lower; 4],
        ba: block,
        ca: block,
        cb: block,
        da: block,
        db: block,
        dc: block,
        impulse: [zero3(); 4],
    }
}

/// A pair spring.
struct Stretch<R> {
    /// Unit vector along it.
    n: V3<R>,
    /// One over its length.
    inverse: R,
    /// At rest.
    l0: R,
    k: R,
    /// On its first particle; the second gets the opposite.
    impulse: V3<R>,
}

/// The spring of this order that ends in particle j.
#[inline(always)]
fn stretch<R: Lanes>(
    rest: &LaneRest<R>,
    p: &LaneParams<R>,
    s: &StepConstants<R>,
    x: &[V3<R>],
    (order, j): (usize, usize),
) -> Stretch<R> {
    let i = j - order;
    let k = rest.on[order - 1][i] * p.0[order - 1];
    let (n, length, inverse) = direction(x[i], x[j]);
    let l0 = rest.lengths[order - 1][i];
    Stretch { n, inverse, l0, k, impulse: scale(s.dt * k * (length - l0), n) }
}

/// Adds the spring of this order that ends in particle j = d.
#[inline(always)]
fn pair<R: Lanes>(
    rest: &LaneRest<R>,
    p: &LaneParams<R>,
    s: &StepConstants<R>,
    x: &[V3<R>],
    (order, j): (usize, usize),
    t: &mut Stencil<R>,
) {
    let Stretch { n, inverse, l0, k, impulse, .. } = stretch(rest, p, s, x, (order, j));
    let c = rest.on[order - 1][j - order] * p.0[order + 3];
    let slack = (R::splat(1.0) - l0 * inverse).at_least_zero() * s.transverse;
    let dt2k = s.dt * s.dt * k;
    let across = dt2k * slack;
    let an = scale(s.dt.mul_add(c, dt2k) - across, n);
    let b = [
        an[0].mul_add(n[0], across),
        an[1] * n[0],
        an[1].mul_add(n[1], across),
        an[2] * n[0],
        an[2] * n[1],
        an[2].mul_add(n[2], across),
    ];
    let other = 3 - order;
    for e in 0..6 {
        t.diagonal[3][e] += b[e];
        t.diagonal[other][e] += b[e];
    }
    let block = match order {
        1 => &mut t.dc,
        2 => &mut t.db,
        _ => &mut t.da,
    };
    let full = [b[0], b[1], b[3], b[1], b[2], b[4], b[3], b[4], b[5]];
    for e in 0..9 {
        block[e] -= full[e];
    }
    t.impulse[other] = add(t.impulse[other], impulse);
    t.impulse[3] = sub(t.impulse[3], impulse);
}

/// Gradients of the seven heights of particles i..i+4 by the three edges, and what their springs pull on b, c, d.
#[inline(always)]
fn pulls<R: Lanes>(
    rest: &LaneRest<R>,
    p: &LaneParams<R>,
    s: &StepConstants<R>,
    x: &[V3<R>],
    i: usize,
) -> ([[V3<R>; 3]; 7], [V3<R>; 3]) {
    let (h, g) = altitude_gradients([x[i], x[i + 1], x[i + 2], x[i + 3]], rest.epsilon2);
    let dtk = s.dt * (rest.on[2][i] * p.0[3]);
    let mut pull = [zero3::<R>(); 3];
    for t in 0..7 {
        let f = dtk * (h[t] - rest.altitudes[i][t]);
        pull[0] = axpy(f, g[t][0], pull[0]);
        pull[1] = axpy(f, g[t][1], pull[1]);
        pull[2] = axpy(f, g[t][2], pull[2]);
    }
    (g, pull)
}

/// The seven altitude springs of particles i..i+4.
#[inline(always)]
fn tetrahedron<R: Lanes>(
    rest: &LaneRest<R>,
    p: &LaneParams<R>,
    s: &StepConstants<R>,
    x: &[V3<R>],
    i: usize,
) -> Stencil<R> {
    let (g, pull) = pulls(rest, p, s, x, i);
    let on = rest.on[2][i];
    let (k, c) = (on * p.0[3], on * p.0[7]);
    let weight = s.dt.mul_add(s.dt * k, s.dt * c);
    let (m11, m22, m33) = (square(&g, 0, weight), square(&g, 1, weight), square(&g, 2, weight));
    let (m21, m31, m32) = (product(&g, 1, 0, weight), product(&g, 2, 0, weight), product(&g, 2, 1, weight));
    let mut t = empty();
    // Particle a carries minus the sum of the others.
    for r in 0..3 {
        for col in 0..3 {
            let (e, f, l) = (3 * r + col, 3 * col + r, LOWER[3 * r + col]);
            let ba = m11[l] + m21[f] + m31[f];
            let ca = m21[e] + m22[l] + m32[f];
            let da = m31[e] + m32[e] + m33[l];
            t.ba[e] = -ba;
            t.ca[e] = -ca;
            t.da[e] = -da;
            if col <= r {
                t.diagonal[0][l] = ba + ca + da;
            }
        }
    }
    (t.diagonal[1], t.diagonal[2], t.diagonal[3]) = (m11, m22, m33);
    (t.cb, t.db, t.dc) = (m21, m31, m32);
    t.impulse = [add(pull[0], add(pull[1], pull[2])), neg(pull[0]), neg(pull[1]), neg(pull[2])];
    t
}

/// Where an entry of a symmetric block is in its lower triangle.
const LOWER: [usize; 9] = [0, 1, 3, 1, 2, 4, 3, 4, 5];

#[inline(always)]
fn neg<R: Lanes>(a: V3<R>) -> V3<R> {
    [-a[0], -a[1], -a[2]]
}

/// w Σₜ gₜ gₜᵀ of one edge, lower triangle.
#[inline(always)]
fn square<R: Lanes>(g: &[[V3<R>; 3]; 7], edge: usize, w: R) -> Lower<R> {
    let mut m = [R::zero(); 6];
    for t in 0..7 {
        let v = g[t][edge];
        m[0] = v[0].mul_add(v[0], m[0]);
        m[1] = v[1].mul_add(v[0], m[1]);
        m[2] = v[1].mul_add(v[1], m[2]);
        m[3] = v[2].mul_add(v[0], m[3]);
        m[4] = v[2].mul_add(v[1], m[4]);
        m[5] = v[2].mul_add(v[2], m[5]);
    }
    for e in 0..6 {
        m[e] = w * m[e];
    }
    m
}

/// w Σₜ gₜ gₜᵀ of two edges.
#[inline(always)]
fn product<R: Lanes>(g: &[[V3<R>; 3]; 7], row: usize, col: usize, w: R) -> Block<R> {
    let mut m = [R::zero(); 9];
    for t in 0..7 {
        let (a, b) = (g[t][row], g[t][col]);
        for r in 0..3 {
            m[3 * r] = a[r].mul_add(b[0], m[3 * r]);
            m[3 * r + 1] = a[r].mul_add(b[1], m[3 * r + 1]);
            m[3 * r + 2] = a[r].mul_add(b[2], m[3 * r + 2]);
        }
    }
    for e in 0..9 {
        m[e] = w * m[e];
    }
    m
}

/// Entries of a lower triangle in a block.
const PLACES: [usize; 6] = [0, 3, 4, 6, 7, 8];

#[inline(always)]
fn add_lower<R: Lanes>(block: &mut Block<R>, l: &Lower<R>) {
    for e in 0..6 {
        block[PLACES[e]] += l[e];
    }
}

#[inline(always)]
fn add_block<R: Lanes>(block: &mut Block<R>, other: &Block<R>) {
    for e in 0..9 {
        block[e] += other[e];
    }
}

/// Begins row i with the identity and what its springs add.
#[inline(always)]
fn begin_row<R: Lanes>(t: &Stencil<R>, identity: R, row: &mut BlockRow<R>) {
    let d = &t.diagonal[3];
    row[0] = [identity + d[0], d[1], d[3], d[1], identity + d[2], d[4], d[3], d[4], identity + d[5]];
    (row[1], row[2], row[3]) = (t.dc, t.db, t.da);
}

#[inline(always)]
fn scatter<R: Lanes>(t: &Stencil<R>, identity: R, i: usize, a: &mut [BlockRow<R>], q: &mut [V3<R>]) {
    begin_row(t, identity, &mut a[i]);
    add_lower(&mut a[i - 1][0], &t.diagonal[2]);
    add_block(&mut a[i - 1][1], &t.cb);
    add_block(&mut a[i - 1][2], &t.ca);
    add_lower(&mut a[i - 2][0], &t.diagonal[1]);
    add_block(&mut a[i - 2][1], &t.ba);
    add_lower(&mut a[i - 3][0], &t.diagonal[0]);
    for k in 0..4 {
        q[i - k] = add(q[i - k], t.impulse[3 - k]);
    }
}

/// [`scatter`] for the first three particles, which end no tetrahedron.
#[inline(always)]
fn scatter_first<R: Lanes>(t: &Stencil<R>, identity: R, i: usize, a: &mut [BlockRow<R>], q: &mut [V3<R>]) {
    begin_row(t, identity, &mut a[i]);
    for k in 0..=i {
        if k > 0 {
            add_lower(&mut a[i - k][0], &t.diagonal[3 - k]);
        }
        q[i - k] = add(q[i - k], t.impulse[3 - k]);
    }
}

/// Factors row i and substitutes forward; kinematic rows take the velocity of their path.
#[inline(always)]
fn finish_row<R: Lanes>(
    s: &StepConstants<R>,
    per_step: R,
    path: &[V3<R>],
    x: &[V3<R>],
    i: usize,
    a: &mut [BlockRow<R>],
    y: &mut [V3<R>],
) {
    let first = s.kinematic;
    if i < first {
        y[i] = scale(per_step, sub(path[i], x[i]));
        return;
    }
    let (above, rest) = a.split_at_mut(i);
    let row = &mut rest[0];
    let mut b = y[i];
    let mut diagonal = row[0];
    if i >= first + 3 {
        solve_right(&mut row[3], &above[i - 3][0]);
        let mut block = row[2];
        subtract_product(&mut block, &row[3], &above[i - 2][1]);
        solve_right(&mut block, &above[i - 2][0]);
        row[2] = block;
        let mut block = row[1];
        subtract_product(&mut block, &row[3], &above[i - 1][2]);
        subtract_product(&mut block, &row[2], &above[i - 1][1]);
        solve_right(&mut block, &above[i - 1][0]);
        row[1] = block;
        subtract_square(&mut diagonal, &row[3]);
        subtract_square(&mut diagonal, &row[2]);
        subtract_square(&mut diagonal, &row[1]);
    } else {
        // Left of `first` are known velocities: their blocks stay as they are and act on the right-hand side alone.
        if i >= first + 2 {
            solve_right(&mut row[2], &above[i - 2][0]);
            subtract_square(&mut diagonal, &row[2]);
        }
        if i > first {
            let mut block = row[1];
            if i >= first + 2 {
                subtract_product(&mut block, &row[2], &above[i - 1][1]);
            }
            solve_right(&mut block, &above[i - 1][0]);
            row[1] = block;
            subtract_square(&mut diagonal, &row[1]);
        }
    }
    for d in 1..4 {
        if i >= d {
            let (block, w) = (&row[d], y[i - d]);
            for r in 0..3 {
                b[r] -= block[3 * r].mul_add(w[0], block[3 * r + 1].mul_add(w[1], block[3 * r + 2] * w[2]));
            }
        }
    }
    factor_diagonal(&mut diagonal);
    let t = &diagonal;
    b[0] = b[0] * t[0];
    b[1] = (b[1] - t[3] * b[0]) * t[4];
    b[2] = (b[2] - t[6] * b[0] - t[7] * b[1]) * t[8];
    row[0] = diagonal;
    y[i] = b;
}

/// `a −= b cᵀ`.
#[inline(always)]
fn subtract_product<R: Lanes>(a: &mut Block<R>, b: &Block<R>, c: &Block<R>) {
    for r in 0..3 {
        let (b0, b1, b2) = (-b[3 * r], -b[3 * r + 1], -b[3 * r + 2]);
        for s in 0..3 {
            a[3 * r + s] = b0.mul_add(c[3 * s], b1.mul_add(c[3 * s + 1], b2.mul_add(c[3 * s + 2], a[3 * r + s])));
        }
    }
}

/// `a −= b bᵀ`, lower triangle.
#[inline(always)]
fn subtract_square<R: Lanes>(a: &mut Block<R>, b: &Block<R>) {
    for r in 0..3 {
        let (b0, b1, b2) = (-b[3 * r], -b[3 * r + 1], -b[3 * r + 2]);
        for s in 0..=r {
            a[3 * r + s] = b0.mul_add(b[3 * s], b1.mul_add(b[3 * s + 1], b2.mul_add(b[3 * s + 2], a[3 * r + s])));
        }
    }
}

/// Cholesky factor of a diagonal block, lower triangle, reciprocal diagonal.
#[inline(always)]
fn factor_diagonal<R: Lanes>(a: &mut Block<R>) {
    let one = R::splat(1.0);
    a[0] = one / a[0].sqrt();
    a[3] = a[3] * a[0];
    a[6] = a[6] * a[0];
    a[4] = one / (-a[3]).mul_add(a[3], a[4]).sqrt();
    a[7] = (-a[6]).mul_add(a[3], a[7]) * a[4];
    a[8] = one / (-a[7]).mul_add(a[7], (-a[6]).mul_add(a[6], a[8])).sqrt();
}

/// Lᵀ y = y in place, entries before `first` left alone.
#[inline(always)]
fn back_substitute<R: Lanes>(l: &[BlockRow<R>], first: usize, y: &mut [V3<R>]) {
    let n = l.len();
    for i in (first..n).rev() {
        let mut b = y[i];
        for d in 1..4 {
            if i + d < n {
                let (block, x) = (&l[i + d][d], y[i + d]);
                for r in 0..3 {
                    b[r] -= block[r].mul_add(x[0], block[r + 3].mul_add(x[1], block[r + 6] * x[2]));
                }
            }
        }
        let t = &l[i][0];
        b[2] = b[2] * t[8];
        b[1] = (b[1] - t[7] * b[2]) * t[4];
        b[0] = (b[0] - t[3] * b[1] - t[6] * b[2]) * t[0];
        y[i] = b;
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::{Params, RestShape, band::zero_row, window};

    #[test]
    fn agrees_with_the_steps_one_after_the_other() {
        for n in [1usize, 2, 3, 4, 5, 7, 20] {
            for fixed in [0usize, 1, 2, 3] {
                let fixed = fixed.min(n);
                let at = |i: usize| DVec3::new(5.0 * i as f64, (1.3 * i as f64).sin(), (0.7 * i as f64).cos());
                let rest =
                    LaneRest::<f64>::new(&[&RestShape::from_positions(&(0..n).map(at).collect::<Vec<_>>(), 5.0)]);
                let noise =
                    |i: usize| DVec3::new((3.1 * i as f64).sin(), (5.7 * i as f64).sin(), (9.3 * i as f64).cos());
                let x: Vec<V3<f64>> = (0..n).map(|i| (at(i) + noise(i)).to_array()).collect();
                let v: Vec<V3<f64>> = (0..n).map(|i| (100.0 * noise(i + 9)).to_array()).collect();
                let path: Vec<V3<f64>> = (0..8).map(|i| (at(i) + 0.2 * noise(i + 3)).to_array()).collect();
                let s = StepConstants { dt: 2e-3, gravity: [0.0, 0.0, -9806.65], transverse: 1.0, kinematic: fixed };
                let params = LaneParams::splat(&Params::default());
                let run = |fuse: bool| {
                    let (mut a, mut x1, mut v1) = (vec![zero_row(); n], vec![zero3(); n], vec![zero3(); n]);
                    let out = (&mut x1[..], &mut v1[..]);
                    if fuse {
                        advance(&rest, &params, &s, (&x, &v), &path, &mut a, out);
                    } else {
                        window::advance(&rest, &params, &s, (&x, &v), &path, &mut a, out);
                    }
                    // The factor solves alike, too.
                    let mut y = v.clone();
                    crate::band::solve(&a, fixed, &mut y);
                    (x1, v1, y)
                };
                let (one, two) = (run(true), run(false));
                // The pieces that are timed: one after the other they are the step, and the forces are its right-hand side.
                let (mut a, mut q) = (vec![zero_row(); n], vec![zero3(); n]);
                let (mut pulled, mut wanted) = (vec![zero3(); n], vec![zero3(); n]);
                forces(&rest, &params, &s, (&x, &v), &mut pulled);
                crate::system::assemble(&rest, &params, &s, (&x, &v), &mut a.clone(), &mut wanted);
                assemble(&rest, &params, &s, (&x, &v), &mut a, &mut q);
                factor_and_solve(&s, &path, &x, &mut a, &mut q);
                for (a, b) in [(&one.0, &two.0), (&one.1, &two.1), (&one.2, &two.2), (&q, &two.1), (&pulled, &wanted)] {
                    for (a, b) in a.as_flattened().iter().zip(b.as_flattened()) {
                        assert!((a - b).abs() < 1e-9 * (1.0 + b.abs()), "{n} {fixed}: {a} {b}");
                    }
                }
            }
        }
    }
}
