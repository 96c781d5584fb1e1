//! The fitted head as a closed mesh: corrected smoothly towards the markers, kept inside the hull.

use glam::DVec3;
use nalgebra::{DMatrix, DVector};
use strandflow_core::TriMesh;
use strandflow_geometry::primitives::icosphere;

use super::evidence::Evidence;
use super::fit::FittedHead;

/// Reach of a marker's correction over the scalp \[mm\]: heads differ from the template over a hand's breadth.
const REACH_MM: f64 = 45.0;
/// Standard deviations of the template's local error and of a marker's lift \[mm\].
const TEMPLATE_SD_MM: f64 = 3.0;
const LIFT_SD_MM: f64 = 2.0;
/// Least hair and slack between the scalp and the hull \[mm\].
const LEAST_HAIR_MM: f64 = 2.0;

/// Where the back of the head begins to be hidden, and from where on it is wholly, in template proportions: downwards from the
/// plane of greatest breadth, and backwards from the middle.
const HIDDEN_BELOW: [f64; 2] = [0.1, 0.6];
const HIDDEN_BEHIND: [f64; 2] = [0.0, 0.3];

/// The head's surface; faces about 3 mm wide. `nape_margin_mm`: how far inside the fitted head it lies at the nape.
pub fn head_surface(head: &FittedHead, evidence: &Evidence, markers: &[DVec3], nape_margin_mm: f64) -> TriMesh {
    let centre = head.placement.centre;
    let correction = Correction::new(head, markers);
    let mut mesh = icosphere(DVec3::ZERO, 1.0, 5);
    for vertex in &mut mesh.vertices {
        let on_head = centre + *vertex * head.shape.reach(centre, *vertex);
        let moved = on_head + *vertex * correction.at(on_head);
        let margin = nape_margin_mm * hidden_share(head.shape.proportions(on_head));
        *vertex = inside_hull(evidence, centre, moved) - level(head, *vertex) * margin;
    }
    mesh
}

/// How much of what tells about the head is missing at a place: all of it at the nape, which hair hides in every view,
/// nothing above the plane of greatest breadth and in front of the ears.
fn hidden_share(p: DVec3) -> f64 {
    let ramp = |[from, to]: [f64; 2], at: f64| ((at - from) / (to - from)).clamp(0.0, 1.0);
    ramp(HIDDEN_BELOW, -p.z) * ramp(HIDDEN_BEHIND, -p.y)
}

/// The part of a direction that is level in the head, of unit length.
fn level(head: &FittedHead, direction: DVec3) -> DVec3 {
    direction.reject_from_normalized(head.shape.direction(DVec3::Z)).normalize_or_zero()
}

/// The point moved towards the centre until it is `LEAST_HAIR_MM` inside the hull.
fn inside_hull(evidence: &Evidence, centre: DVec3, point: DVec3) -> DVec3 {
    let mut point = point;
    for _ in 0..40 {
        let over = evidence.hull_distance.distance(point) + LEAST_HAIR_MM;
        if over <= 0.0 || point.distance(centre) < 40.0 {
            break;
        }
        point -= (point - centre).normalize_or_zero() * over.clamp(0.2, 4.0);
    }
    point
}

/// A smooth field of offsets that brings the surface to where the markers say it is (kriging of their residuals).
struct Correction {
    at: Vec<DVec3>,
    weights: DVector<f64>,
}

impl Correction {
    fn new(head: &FittedHead, markers: &[DVec3]) -> Self {
        let offsets: Vec<f64> = markers.iter().map(|m| head.shape.distance(*m) - head.lift_mm).collect();
        // A marker that is far off is lost or mislabelled: it gets no say.
        let usable: Vec<usize> = (0..markers.len()).filter(|&i| offsets[i].abs() < 12.0).collect();
        let n = usable.len();
        let kernel = DMatrix::from_fn(n, n, |i, j| {
            let same = if i == j { LIFT_SD_MM.powi(2) } else { 0.0 };
            covariance(markers[usable[i]], markers[usable[j]]) + same
        });
        let values = DVector::from_fn(n, |i, _| offsets[usable[i]]);
        let weights = kernel.cholesky().map_or_else(|| DVector::zeros(n), |c| c.solve(&values));
        Self { at: usable.iter().map(|&i| markers[i]).collect(), weights }
    }

    fn at(&self, point: DVec3) -> f64 {
        self.at.iter().zip(self.weights.iter()).map(|(m, w)| covariance(*m, point) * w).sum()
    }
}

fn covariance(a: DVec3, b: DVec3) -> f64 {
    TEMPLATE_SD_MM.powi(2) * (-0.5 * a.distance_squared(b) / (REACH_MM * REACH_MM)).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_nape_is_hidden() {
        let at = |y: f64, z: f64| hidden_share(DVec3::new(0.2, y, z));
        for (y, z) in [(0.0, 1.0), (-1.0, 0.0), (-0.9, -0.1), (0.9, -0.7), (0.0, -1.2)] {
            assert_eq!(at(y, z), 0.0, "{y} {z}");
        }
        assert_eq!([at(-0.8, -0.7), at(-0.7, -1.5)], [1.0, 1.0]);
        assert!((at(-0.9, -0.35) - 0.5).abs() < 1e-12);
    }
}
