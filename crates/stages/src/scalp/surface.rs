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

/// The head's surface; faces about 3 mm wide.
pub fn head_surface(head: &FittedHead, evidence: &Evidence, markers: &[DVec3]) -> TriMesh {
    let centre = head.placement.centre;
    let correction = Correction::new(head, markers);
    let mut mesh = icosphere(DVec3::ZERO, 1.0, 5);
    for vertex in &mut mesh.vertices {
        let on_head = centre + *vertex * head.shape.reach(centre, *vertex);
        let moved = on_head + *vertex * correction.at(on_head);
        *vertex = inside_hull(evidence, centre, moved);
    }
    mesh
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
