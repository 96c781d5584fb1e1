//! A groomed strand that hangs still: its springs, and what holds it against gravity.

use glam::DVec3;
use strandflow_core::RigidTransform;

use super::CLAMPED;
use crate::{Params, RestShape};

/// A strand whose given shape is the balance of its springs with gravity.
///
/// Along the strand the edges carry the weight below them: their rest lengths are shorter by what it stretches them. Across,
/// nothing but the shape itself can hold a strand whose bending springs rest as given; that part of the balance is a force
/// that turns with the strand.
#[derive(Clone, Debug, PartialEq)]
pub struct Hung {
    /// Rest shape.
    pub rest: RestShape,
    /// Parameters.
    pub params: Params,
    /// The groomed positions in head space \[mm\].
    pub in_head: Vec<DVec3>,
    /// Directions of the groomed strand, head space.
    tangents: Vec<DVec3>,
    /// Per unit mass, what holds each particle across its direction \[mm/s²\], head space.
    holding: Vec<DVec3>,
}

impl Hung {
    /// A strand that hangs still as groomed (head space, root first, two particles or more) under `gravity` (head space,
    /// \[mm/s²\]). `edge_mm` is its typical particle distance.
    pub fn new(in_head: Vec<DVec3>, params: Params, gravity: DVec3, edge_mm: f64) -> Self {
        let n = in_head.len();
        let mut rest = RestShape::from_positions(&in_head, edge_mm);
        let edges: Vec<DVec3> = in_head.windows(2).map(|p| (p[1] - p[0]).normalize_or_zero()).collect();
        let tension = tensions(&edges, gravity);
        for (k, (length, tension)) in rest.lengths[0].iter_mut().zip(&tension).enumerate() {
            if k + 1 >= CLAMPED {
                *length -= (tension / params.stiffness[0]).clamp(-MOST_STRAIN * *length, MOST_STRAIN * *length);
            }
        }
        let pull = |k: usize| edges.get(k).map_or(DVec3::ZERO, |edge| tension[k] * *edge);
        let holding = (0..n).map(|i| if i < CLAMPED { DVec3::ZERO } else { pull(i - 1) - pull(i) - gravity }).collect();
        let tangents =
            (0..n).map(|i| (in_head[(i + 1).min(n - 1)] - in_head[i.saturating_sub(1)]).normalize_or_zero()).collect();
        Self { rest, params, in_head, tangents, holding }
    }

    /// n.
    pub fn particle_count(&self) -> usize {
        self.in_head.len()
    }

    /// The acceleration that holds particle `i`, turned with the head and from the groomed to the present direction \[mm/s²\].
    pub(super) fn holding(&self, i: usize, tangent: DVec3, world_from_head: &RigidTransform) -> DVec3 {
        let (was, held) = (world_from_head.vector(self.tangents[i]), world_from_head.vector(self.holding[i]));
        let cosine = was.dot(tangent);
        if cosine < OPPOSITE {
            return held;
        }
        let axis = was.cross(tangent);
        held * cosine + axis.cross(held) + axis * (axis.dot(held) / (1.0 + cosine))
    }
}

/// Weight never stretches or compresses an edge by more than this share; past it the stiffness is no hair's.
const MOST_STRAIN: f64 = 0.2;
/// Cosine below which the turn from one direction to another has no axis.
const OPPOSITE: f64 = -0.999;

/// Tensions per unit mass of the edges (unit vectors, root first) that come nearest to balancing gravity at every free particle:
/// minimises Σ |Tᵢ eᵢ − Tᵢ₋₁ eᵢ₋₁ + g|², a tridiagonal system.
fn tensions(edges: &[DVec3], gravity: DVec3) -> Vec<f64> {
    let mut tension = vec![0.0; edges.len()];
    let first = CLAMPED - 1;
    if edges.len() <= first {
        return tension;
    }
    let count = edges.len() - first;
    // Forward elimination of rows with the diagonal d and the off-diagonal −eₖ·eₖ₊₁.
    let (mut upper, mut value) = (vec![0.0; count], vec![0.0; count]);
    for k in 0..count {
        let edge = edges[first + k];
        let diagonal = if k == 0 { 1.0 } else { 2.0 };
        let right = if k == 0 { edge.dot(gravity) } else { 0.0 };
        let lower = if k == 0 { 0.0 } else { -edges[first + k - 1].dot(edge) };
        let above = if k == 0 { (0.0, 0.0) } else { (upper[k - 1], value[k - 1]) };
        let pivot = (diagonal - lower * above.0).max(1e-9);
        upper[k] = edges.get(first + k + 1).map_or(0.0, |next| -edge.dot(*next)) / pivot;
        value[k] = (right - lower * above.1) / pivot;
    }
    for k in (0..count).rev() {
        let below = if k + 1 < count { tension[first + k + 1] } else { 0.0 };
        tension[first + k] = value[k] - upper[k] * below;
    }
    tension
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plumb_line_carries_the_weight_below_every_edge() {
        let tension = tensions(&[DVec3::NEG_Z; 6], DVec3::NEG_Z * 9810.0);
        let below: Vec<f64> = tension.iter().map(|t| t / 9810.0).collect();
        for (k, expected) in [0.0, 0.0, 4.0, 3.0, 2.0, 1.0].iter().enumerate() {
            assert!((below[k] - expected).abs() < 1e-9, "{below:?}");
        }
        assert_eq!(tensions(&[DVec3::X; 2], DVec3::NEG_Z), [0.0; 2]);
    }

    #[test]
    fn the_holding_force_balances_gravity_and_turns_with_the_strand() {
        let points: Vec<DVec3> = (0..8).map(|i| DVec3::new(5.0 * f64::from(i), 0.0, 0.0)).collect();
        let gravity = DVec3::NEG_Z * 9810.0;
        let strand = Hung::new(points, Params::default(), gravity, 5.0);
        let still = strand.holding(5, DVec3::X, &RigidTransform::IDENTITY);
        assert!((still + gravity).length() < 1e-9);
        let turned = strand.holding(5, DVec3::NEG_Z, &RigidTransform::IDENTITY);
        assert!((turned - DVec3::X * 9810.0).length() < 1e-6, "{turned}");
    }
}
