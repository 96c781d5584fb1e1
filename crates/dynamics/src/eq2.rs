//! Spatial smoothing of one strand (eq. 2): a data term against a smoothness term, one banded solve.
//!
//! | symbol | name | unit |
//! |---|---|---|
//! | x̃ | given points, root first | mm |
//! | w_s | smoothness, 0 (data only) to below 1 | – |
//! | D₁, D₂ | first and second difference operators along the strand | – |
//!
//! Reference: Zhang et al. 2012 eq. 2. *Deviation*: as printed, the smoothness term compares the edges of x with the edges
//! of x̃, so that x = x̃ minimises it and nothing is smoothed. [`Reading`] holds the printed form and three that smooth;
//! `Curvature` is the default because it leaves straight, evenly sampled strands and their lengths alone.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// What the smoothness term of eq. 2 penalises.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reading {
    /// Edges of x against edges of x̃, as printed: returns x̃.
    Literal,
    /// |D₁x|²: shortens strands.
    Membrane,
    /// Edges of x against edges of x̃ whose directions were averaged (¼, ½, ¼) and whose lengths were kept.
    Edge,
    /// |D₂x|².
    #[default]
    Curvature,
}

/// Minimises (1 − w_s)|x − x̃|² + w_s · smoothness. `pin_root` holds the first point exactly.
///
/// `points`: shape (n, 3), root first \[mm\]; the result has the same shape. With w_s = 1 the problem is singular; w_s is
/// limited to 1 − 1e-9. Cost O(n).
pub fn smooth(points: &[DVec3], w_s: f64, reading: Reading, pin_root: bool) -> Vec<DVec3> {
    let n = points.len();
    let w_s = w_s.clamp(0.0, 1.0 - 1e-9);
    if reading == Reading::Literal || n < 3 || w_s == 0.0 {
        return points.to_vec();
    }
    // Normal equations: (1 − w_s) I + w_s DᵀD, and the right-hand side.
    let mut system = Pentadiagonal::scaled_identity(n, 1.0 - w_s);
    let mut b: Vec<DVec3> = points.iter().map(|p| *p * (1.0 - w_s)).collect();
    match reading {
        Reading::Curvature => (0..n - 2).for_each(|i| system.add_square(i, &[1.0, -2.0, 1.0], w_s)),
        Reading::Membrane => (0..n - 1).for_each(|i| system.add_square(i, &[-1.0, 1.0], w_s)),
        Reading::Edge => {
            for (i, target) in averaged_edges(points).into_iter().enumerate() {
                system.add_square(i, &[-1.0, 1.0], w_s);
                b[i] -= target * w_s;
                b[i + 1] += target * w_s;
            }
        }
        Reading::Literal => {}
    }
    if pin_root {
        system.pin_first(&mut b, points[0]);
    }
    system.solve(&mut b);
    b
}

/// Edges with directions averaged over (¼, ½, ¼) neighbours (ends repeated) and lengths kept.
fn averaged_edges(points: &[DVec3]) -> Vec<DVec3> {
    let edges: Vec<DVec3> = points.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let last = edges.len() - 1;
    (0..=last)
        .map(|i| {
            let mean = edges[i.saturating_sub(1)] + edges[i] * 2.0 + edges[(i + 1).min(last)];
            mean.normalize_or_zero() * edges[i].length()
        })
        .collect()
}

/// A symmetric positive definite matrix of half-bandwidth 2; `bands[k][i]` is the entry (i, i + k).
struct Pentadiagonal {
    bands: [Vec<f64>; 3],
}

impl Pentadiagonal {
    fn scaled_identity(n: usize, value: f64) -> Self {
        Self { bands: [vec![value; n], vec![0.0; n], vec![0.0; n]] }
    }

    /// Adds weight · rᵀr for the row r that holds `stencil` from column `at` on.
    fn add_square(&mut self, at: usize, stencil: &[f64], weight: f64) {
        for (i, a) in stencil.iter().enumerate() {
            for (k, b) in stencil[i..].iter().enumerate() {
                self.bands[k][at + i] += weight * a * b;
            }
        }
    }

    /// Replaces the first equation by x₀ = value and moves its column to the right-hand side.
    fn pin_first(&mut self, b: &mut [DVec3], value: DVec3) {
        b[1] -= value * self.bands[1][0];
        b[2] -= value * self.bands[2][0];
        b[0] = value;
        (self.bands[0][0], self.bands[1][0], self.bands[2][0]) = (1.0, 0.0, 0.0);
    }

    /// LDLᵀ, forward and backward substitution, in place.
    fn solve(mut self, b: &mut [DVec3]) {
        let n = b.len();
        let [d, l1, l2] = &mut self.bands;
        for i in 0..n {
            let (a1, a2) = (l1[i], l2[i]);
            (l1[i], l2[i]) = (a1 / d[i], a2 / d[i]);
            if i + 1 < n {
                d[i + 1] -= l1[i] * a1;
                l1[i + 1] -= l1[i] * a2;
                let step = b[i] * l1[i];
                b[i + 1] -= step;
            }
            if i + 2 < n {
                d[i + 2] -= l2[i] * a2;
                let step = b[i] * l2[i];
                b[i + 2] -= step;
            }
        }
        for i in (0..n).rev() {
            b[i] /= d[i];
            if i + 1 < n {
                let step = b[i + 1] * l1[i];
                b[i] -= step;
            }
            if i + 2 < n {
                let step = b[i + 2] * l2[i];
                b[i] -= step;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_even_strand_is_left_alone_by_the_default_reading() {
        let line: Vec<DVec3> = (0..20).map(|i| DVec3::new(1.0, 2.0, -5.0 * i as f64)).collect();
        let smoothed = smooth(&line, 0.5, Reading::Curvature, true);
        assert!(line.iter().zip(&smoothed).all(|(a, b)| a.distance(*b) < 1e-10));
    }

    #[test]
    fn two_points_and_none_pass_through() {
        assert!(smooth(&[], 0.5, Reading::Curvature, true).is_empty());
        let pair = [DVec3::ZERO, DVec3::X];
        assert_eq!(smooth(&pair, 0.5, Reading::Membrane, true), pair);
    }
}
