//! The true derivative of the forces: K = −∂f/∂x with nothing dropped, and the step that it gives.
//!
//! | spring | block of K by the spring's own ends |
//! |---|---|
//! | pair | k n nᵀ + F/l (I − n nᵀ) + c n (P w)ᵀ/l |
//! | altitude | k ∇h ∇hᵀ + F H + c ∇h (H v)ᵀ |
//!
//! with F = k (C − C₀) + c ∇C·v, w = vⱼ − vᵢ, P = I − n nᵀ and H the Hessian of h. It is neither symmetric nor definite, so
//! the system is solved by LU with pivots, in scalar doubles only.
//!
//! This is the reference to which the clamped and the rank-1 Jacobian are simplifications. It is not the default: from
//! a state with 1 mm of noise 7 of 12 runs of 25 steps end bad, with the clamped one none (METHOD §3). The adjoint of
//! [`crate::window`] belongs to the clamped and rank-1 steps; there is none of this step.
//!
//! Reference: Zhang, Wu, Zhang et al. 2012, eq. 3; Baraff, Witkin 1998.

use crate::{
    altitude::altitude_adjoint,
    band::{BlockRow, zero_row},
    lanes::{V3, axpy, dot, sub, zero3},
    lu::BandMatrix,
    params::LaneParams,
    rest::LaneRest,
    system::{StepConstants, assemble, direction},
};

/// Half-bandwidth of a strand's matrices: springs reach three particles.
pub const HALF_WIDTH: usize = 11;

/// Adds a block to those of particles (i, j).
fn add_block(m: &mut BandMatrix, (i, j): (usize, usize), sign: f64, block: &[V3<f64>; 3]) {
    for r in 0..3 {
        for c in 0..3 {
            m[(3 * i + r, 3 * j + c)] += sign * block[r][c];
        }
    }
}

/// K = −∂f/∂x \[1/s²\] of the springs in the state (x, v) \[mm, mm/s\], all particles free; `k` is 3n × 3n with
/// [`HALF_WIDTH`], entry 3 · particle + axis. Gravity and drag have no part in it.
pub fn stiffness(rest: &LaneRest<f64>, p: &LaneParams<f64>, (x, v): (&[V3<f64>], &[V3<f64>]), k: &mut BandMatrix) {
    k.clear();
    for order in 1..4 {
        for j in order..rest.n {
            let i = j - order;
            let block = pair(rest, p, order, (x[i], x[j]), sub(v[j], v[i]), i);
            for (at, sign) in [((i, i), 1.0), ((j, j), 1.0), ((i, j), -1.0), ((j, i), -1.0)] {
                add_block(k, at, sign, &block);
            }
        }
    }
    for i in 0..rest.n.saturating_sub(3) {
        tetrahedron(rest, p, (x, v), i, k);
    }
}

/// The block of a pair spring of this order from particle i, with relative velocity `w`.
fn pair(
    rest: &LaneRest<f64>,
    p: &LaneParams<f64>,
    order: usize,
    (a, b): (V3<f64>, V3<f64>),
    w: V3<f64>,
    i: usize,
) -> [V3<f64>; 3] {
    let on = rest.on[order - 1][i];
    let (k, c) = (on * p.0[order - 1], on * p.0[order + 3]);
    let (n, length, inverse) = direction(a, b);
    let closing = dot(n, w);
    let across = (k * (length - rest.lengths[order - 1][i]) + c * closing) * inverse;
    let turning = axpy(-closing, n, w);
    let mut block = [zero3(); 3];
    for r in 0..3 {
        for s in 0..3 {
            block[r][s] = n[r] * ((k - across) * n[s] + c * inverse * turning[s]);
        }
        block[r][r] += across;
    }
    block
}

/// Adds the seven altitude springs of particles i..i+4. Contracted with a unit vector, the closed form of the adjoint
/// without a step's own terms (Δt = 0) is a row of K.
fn tetrahedron(
    rest: &LaneRest<f64>,
    p: &LaneParams<f64>,
    (x, v): (&[V3<f64>], &[V3<f64>]),
    i: usize,
    m: &mut BandMatrix,
) {
    let four = |y: &[V3<f64>]| [y[i], y[i + 1], y[i + 2], y[i + 3]];
    let on = rest.on[2][i];
    let (k, c) = (on * p.0[3], on * p.0[7]);
    for row in 0..12 {
        let mut unit = [zero3(); 4];
        unit[row / 3][row % 3] = 1.0;
        let e = altitude_adjoint(four(x), unit, four(v), &rest.altitudes[i], rest.epsilon2, k, c, 0.0).by_edges;
        #[expect(clippy::needless_range_loop, reason = "one index through several arrays reads as the formula")]
        for axis in 0..3 {
            let at = |corner: usize| (3 * i + row, 3 * (i + corner) + axis);
            m[at(0)] -= e[0][axis] + e[1][axis] + e[2][axis];
            for corner in 1..4 {
                m[at(corner)] += e[corner - 1][axis];
            }
        }
    }
}

/// Scratch of exact steps; grows at the first.
#[derive(Clone, Debug, Default)]
pub struct ExactWorkspace {
    stiffness: BandMatrix,
    rows: Vec<BlockRow<f64>>,
    system: BandMatrix,
    given: Vec<V3<f64>>,
    y: Vec<f64>,
}

/// Writes A = I + Δt D + Δt² K into `a` (3n × 3n with [`HALF_WIDTH`]) and the right-hand side of A v₁ = q into `q`, all
/// particles free. K v and the damping force cancel as in [`crate::system`], so that q is the same for every Jacobian.
pub fn assemble_exact(
    rest: &LaneRest<f64>,
    p: &LaneParams<f64>,
    s: &StepConstants<f64>,
    (x, v): (&[V3<f64>], &[V3<f64>]),
    rows: &mut [BlockRow<f64>],
    a: &mut BandMatrix,
    q: &mut [V3<f64>],
) {
    stiffness(rest, p, (x, v), a);
    // I + Δt D: the same springs without stiffness. Then q from the springs as they are.
    let mut soft = *p;
    soft.0[..4].fill(0.0);
    assemble(rest, &soft, s, (x, v), rows, q);
    let dt2 = s.dt * s.dt;
    for i in 0..rest.n {
        for j in i.saturating_sub(3)..(i + 4).min(rest.n) {
            for (r, c) in (0..9).map(|e| (e / 3, e % 3)) {
                let rigid = if i >= j { rows[i][i - j][3 * r + c] } else { rows[j][j - i][3 * c + r] };
                let entry = &mut a[(3 * i + r, 3 * j + c)];
                *entry = rigid + dt2 * *entry;
            }
        }
    }
    assemble(rest, p, s, (x, v), rows, q);
}

/// Solves one exact step in place: `q` brings the velocities of the kinematic particles and what forces beyond springs,
/// gravity and drag add to the right-hand side of the others (Δt · acceleration), and leaves with all v₁ \[mm/s\].
/// A singular system, which takes a coincidence, leaves NaN.
pub fn solve_exact(
    rest: &LaneRest<f64>,
    p: &LaneParams<f64>,
    s: &StepConstants<f64>,
    (x, v): (&[V3<f64>], &[V3<f64>]),
    w: &mut ExactWorkspace,
    q: &mut [V3<f64>],
) {
    let (n, fixed) = (rest.n, s.kinematic);
    if w.stiffness.size() != 3 * n || w.system.size() != 3 * (n - fixed) {
        w.stiffness = BandMatrix::zeros(3 * n, HALF_WIDTH);
        w.system = BandMatrix::zeros(3 * (n - fixed), HALF_WIDTH);
        w.rows = vec![zero_row(); n];
    }
    w.given.clear();
    w.given.extend_from_slice(q);
    let given = &w.given;
    assemble_exact(rest, p, s, (x, v), &mut w.rows, &mut w.stiffness, q);
    w.system.clear();
    w.y.clear();
    for row in 3 * fixed..3 * n {
        let mut right = q[row / 3][row % 3] + given[row / 3][row % 3];
        for col in row.saturating_sub(HALF_WIDTH)..(row + HALF_WIDTH + 1).min(3 * n) {
            let entry = w.stiffness[(row, col)];
            if col < 3 * fixed {
                right -= entry * given[col / 3][col % 3];
            } else {
                w.system[(row - 3 * fixed, col - 3 * fixed)] = entry;
            }
        }
        w.y.push(right);
    }
    if w.system.factor() {
        w.system.solve(&mut w.y);
    } else {
        w.y.fill(f64::NAN);
    }
    q[..fixed].copy_from_slice(&given[..fixed]);
    for (i, y) in w.y.chunks_exact(3).enumerate() {
        q[fixed + i].copy_from_slice(y);
    }
}
