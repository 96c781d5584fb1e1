//! Altitude springs: seven signed, regularised heights of each tetrahedron (a, b, c, d) of consecutive particles.
//!
//! | symbol | meaning |
//! |---|---|
//! | e₁ e₂ e₃ | b−a, c−a, d−a \[mm\] |
//! | V | e₁·(e₂×e₃), six times the volume \[mm³\] |
//! | N = P×Q | the face or edge-pair normal that the height stands on \[mm²\] |
//! | S | \|N\|² + ε² |
//! | h | V / √S \[mm\] |
//!
//! Heights depend on differences only, so gradients are kept for e₁ e₂ e₃; that of a is minus their sum.
//!
//! Reference: Selle, Lentine, Fedkiw 2008 (altitude springs of a hair tetrahedron).
//! Deviation: ε > 0 and the sign, where the original takes the least of unsigned heights. Straight strands fade out
//! smoothly instead of switching springs, and curls keep their handedness.

use crate::lanes::{Lanes, V3, add, axpy, cross, dot, scale, sub, zero3};

/// Runs a block for the seven normals N = P×Q, with P and Q as indices into (e₁, e₂, e₃, e₂−e₁, e₃−e₁, e₃−e₂): the faces
/// over a, b, c, d, then the edge pairs ab|cd, ac|bd, ad|bc. Written out, so that the indices are constants.
macro_rules! for_normals {
    (|$s:ident, $p:ident, $q:ident| $body:block) => {
        for_normals!(@ $s, $p, $q, $body, (0, 3, 4), (1, 1, 2), (2, 0, 2), (3, 0, 1), (4, 0, 5), (5, 1, 4), (6, 2, 3))
    };
    (@ $s:ident, $p:ident, $q:ident, $body:block, $(($i:literal, $a:literal, $b:literal)),*) => {
        $({ let ($s, $p, $q): (usize, usize, usize) = ($i, $a, $b); $body })*
    };
}

/// The six edges of a tetrahedron.
#[inline(always)]
fn edges<R: Lanes>(x: [V3<R>; 4]) -> [V3<R>; 6] {
    let (e1, e2, e3) = (sub(x[1], x[0]), sub(x[2], x[0]), sub(x[3], x[0]));
    [e1, e2, e3, sub(e2, e1), sub(e3, e1), sub(e3, e2)]
}

/// Adds a gradient by edge `i` of the six to one by e₁ e₂ e₃.
#[inline(always)]
fn fold<R: Lanes>(i: usize, g: V3<R>, out: &mut [V3<R>; 3]) {
    match i {
        0..=2 => out[i] = add(out[i], g),
        3 => (out[1], out[0]) = (add(out[1], g), sub(out[0], g)),
        4 => (out[2], out[0]) = (add(out[2], g), sub(out[0], g)),
        _ => (out[2], out[1]) = (add(out[2], g), sub(out[1], g)),
    }
}

/// The seven heights \[mm\].
#[inline(always)]
pub fn altitudes<R: Lanes>(x: [V3<R>; 4], epsilon2: R) -> [R; 7] {
    let e = edges(x);
    let volume = dot(e[0], cross(e[1], e[2]));
    let mut h = [R::zero(); 7];
    for_normals!(|s, p, q| {
        let normal = cross(e[p], e[q]);
        h[s] = volume / (dot(normal, normal) + epsilon2).sqrt();
    });
    h
}

/// The seven heights \[mm\] and their gradients by e₁ e₂ e₃.
#[inline(always)]
pub fn altitude_gradients<R: Lanes>(x: [V3<R>; 4], epsilon2: R) -> ([R; 7], [[V3<R>; 3]; 7]) {
    let e = edges(x);
    let dv = [cross(e[1], e[2]), cross(e[2], e[0]), cross(e[0], e[1])];
    let volume = dot(e[0], dv[0]);
    let one = R::splat(1.0);
    let mut h = [R::zero(); 7];
    let mut g = [[zero3(); 3]; 7];
    for_normals!(|s, p, q| {
        let normal = cross(e[p], e[q]);
        let inverse = one / (dot(normal, normal) + epsilon2).sqrt();
        h[s] = volume * inverse;
        // ∇h = S^-½ ∇V − h/S · ½∇S with ½∂S/∂P = Q×N, ½∂S/∂Q = N×P.
        let fall = -(h[s] * inverse * inverse);
        g[s] = [scale(inverse, dv[0]), scale(inverse, dv[1]), scale(inverse, dv[2])];
        fold(p, scale(fall, cross(e[q], normal)), &mut g[s]);
        fold(q, scale(fall, cross(normal, e[p])), &mut g[s]);
    });
    (h, g)
}

/// What the adjoint of one tetrahedron adds to the gradients by state and parameters.
pub struct AltitudeAdjoint<R> {
    /// ∂E/∂e₁, ∂e₂, ∂e₃.
    pub by_edges: [V3<R>; 3],
    /// ∂E/∂k, without the factor Δt.
    pub by_stiffness: R,
    /// ∂E/∂c, without the factor Δt.
    pub by_damping: R,
}

/// Derivatives of E = Σₛ (∇hₛ·μ)·\[k (hₛ−h₀ₛ) + (c + Δt k) ∇hₛ·v\] with `mu` and `v` held: the residual of one step
/// contracted with the adjoint, over Δt. Closed form: with F the bracket and β = c + Δt k,
/// ∂E = H(F μ + β (∇h·μ) v) + k (∇h·μ) ∇h, where H is the Hessian of h.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // the arguments of one formula
pub fn altitude_adjoint<R: Lanes>(
    x: [V3<R>; 4],
    mu: [V3<R>; 4],
    v: [V3<R>; 4],
    rest: &[R; 7],
    epsilon2: R,
    k: R,
    c: R,
    dt: R,
) -> AltitudeAdjoint<R> {
    let (e, m, w) = (edges(x), edges(mu), edges(v));
    let dv = [cross(e[1], e[2]), cross(e[2], e[0]), cross(e[0], e[1])];
    let volume = dot(e[0], dv[0]);
    let volume_mu = dot(dv[0], m[0]) + dot(dv[1], m[1]) + dot(dv[2], m[2]);
    let volume_v = dot(dv[0], w[0]) + dot(dv[1], w[1]) + dot(dv[2], w[2]);
    let (one, three) = (R::splat(1.0), R::splat(3.0));
    let beta = dt.mul_add(k, c);
    // Gradients by the six edges; by ∇V; and the vector Σ S^-½ u that ∇V' is linear in.
    let mut by_edge = [zero3::<R>(); 6];
    let mut by_volume = R::zero();
    let (mut sum_mu, mut sum_v) = (R::zero(), R::zero());
    let (mut by_stiffness, mut by_damping) = (R::zero(), R::zero());
    for_normals!(|s, p, q| {
        let n = cross(e[p], e[q]);
        let r = one / (dot(n, n) + epsilon2).sqrt();
        let r2 = r * r;
        let h = volume * r;
        let (sp, sq) = (cross(e[q], n), cross(n, e[p]));
        // Slopes of h along μ and v.
        let fall = h * r2;
        let g_mu = r.mul_add(volume_mu, -(fall * (dot(sp, m[p]) + dot(sq, m[q]))));
        let g_v = r.mul_add(volume_v, -(fall * (dot(sp, w[p]) + dot(sq, w[q]))));
        let stretch = h - rest[s];
        let force = k.mul_add(stretch, beta * g_v);
        let lean = beta * g_mu;
        by_stiffness += g_mu * dt.mul_add(g_v, stretch);
        by_damping += g_mu * g_v;
        // The direction u = F μ + β (∇h·μ) v, and the change of N, S/2 and V along it.
        let pu = axpy(force, m[p], scale(lean, w[p]));
        let qu = axpy(force, m[q], scale(lean, w[q]));
        let nu = add(cross(pu, e[q]), cross(e[p], qu));
        let half_s_u = dot(n, nu);
        let volume_u = force.mul_add(volume_mu, lean * volume_v);
        let r3 = r2 * r;
        // H u + k (∇h·μ) ∇h, by ∇V, by ½∇S and by the change of ½∇S.
        let pull = k * g_mu;
        by_volume += r.mul_add(pull, -(r3 * half_s_u));
        let on_s = (three * r2 * r3 * volume).mul_add(half_s_u, -(r3 * volume_u)) - pull * fall;
        let on_su = -(r3 * volume);
        let spu = add(cross(qu, n), cross(e[q], nu));
        let squ = add(cross(nu, e[p]), cross(n, pu));
        by_edge[p] = axpy(on_s, sp, axpy(on_su, spu, by_edge[p]));
        by_edge[q] = axpy(on_s, sq, axpy(on_su, squ, by_edge[q]));
        sum_mu += r * force;
        sum_v += r * lean;
    });
    // Written out: a closure would be compiled without the vector instructions of its caller.
    let mut u = [zero3(); 3];
    for i in 0..3 {
        u[i] = axpy(sum_mu, m[i], scale(sum_v, w[i]));
    }
    let mut out = [
        axpy(by_volume, dv[0], add(cross(u[1], e[2]), cross(e[1], u[2]))),
        axpy(by_volume, dv[1], add(cross(u[2], e[0]), cross(e[2], u[0]))),
        axpy(by_volume, dv[2], add(cross(u[0], e[1]), cross(e[0], u[1]))),
    ];
    fold(0, by_edge[0], &mut out);
    fold(1, by_edge[1], &mut out);
    fold(2, by_edge[2], &mut out);
    fold(3, by_edge[3], &mut out);
    fold(4, by_edge[4], &mut out);
    fold(5, by_edge[5], &mut out);
    AltitudeAdjoint { by_edges: out, by_stiffness, by_damping }
}
