//! Scores of the head: pose, markers, scalp.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use strandflow_core::{Rig, RigidTransform, TriMesh};
use strandflow_geometry::mesh_distance::MeshDistance;
use strandflow_geometry::project::project;

use crate::statistics::Summary;
use crate::truth::Truth;

/// Errors of the head poses.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PoseScores {
    /// Rotation error per frame \[degrees\].
    pub degrees: Vec<f64>,
    /// Mean displacement of the marker positions by the pose error, per frame \[mm\] (of the head's origin where the truth
    /// has no markers).
    pub mm: Vec<f64>,
    /// Largest rotation error \[degrees\].
    pub worst_degrees: f64,
    /// Largest displacement \[mm\].
    pub worst_mm: f64,
}

/// Scores poses `world_from_head` (motion since the first frame) of these frame numbers.
///
/// The displacement is measured at the markers, not at the world's origin, which may be metres away.
pub fn evaluate_pose(frames: &[u32], world_from_head: &[RigidTransform], truth: &Truth) -> PoseScores {
    let mut scores = PoseScores::default();
    for (frame, found) in frames.iter().zip(world_from_head) {
        let Some(expected) = truth.world_from_head.get(*frame as usize) else { continue };
        let degrees = found.after(&expected.inverse()).angle().to_degrees().abs();
        let origin = [DVec3::ZERO];
        let places = if truth.markers.is_empty() { &origin[..] } else { &truth.markers };
        let moved = places.iter().map(|p| found.point(*p).distance(expected.point(*p)));
        let mm = moved.sum::<f64>() / places.len() as f64;
        scores.worst_degrees = scores.worst_degrees.max(degrees);
        scores.worst_mm = scores.worst_mm.max(mm);
        scores.degrees.push(degrees);
        scores.mm.push(mm);
    }
    scores
}

/// Distances \[px\] of projected triangulated markers (shape (T, M), the truth's order) to their true projections.
pub fn marker_reprojection(frames: &[u32], markers: &[Vec<Option<DVec3>>], rig: &Rig, truth: &Truth) -> Summary {
    let mut errors = Vec::new();
    for (frame, found) in frames.iter().zip(markers) {
        let Some(views) = truth.marker_views.get(*frame as usize) else { continue };
        for (camera, expected) in rig.cameras.iter().zip(views) {
            for (point, (pixel, visible)) in found.iter().zip(expected) {
                if let (true, Some(projected)) = (*visible >= 0.5, point.and_then(|p| project(camera, p))) {
                    errors.push(projected.distance(*pixel));
                }
            }
        }
    }
    Summary::of(errors)
}

/// Distances between the scalp and the true head where hair grows \[mm\].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ScalpScores {
    /// From the true roots to the found mesh.
    pub distance: Summary,
    /// The same, signed: positive where the found mesh lies inside the true head.
    pub signed: Summary,
    /// From the found roots to the true head.
    pub roots: Summary,
}

/// Scores a scalp mesh and its roots, both in the world of the first frame \[mm\].
pub fn evaluate_scalp(mesh: &TriMesh, roots: &[DVec3], truth: &Truth) -> ScalpScores {
    let true_roots = (0..truth.strand_count()).filter_map(|n| truth.strand(0, n).first()).map(|p| p.as_dvec3());
    let found = MeshDistance::new(mesh);
    let head = MeshDistance::new(&truth.head);
    let signed: Vec<f64> = true_roots.filter_map(|p| found.nearest(p)).map(|near| near.signed_distance).collect();
    let roots = roots.iter().filter_map(|p| head.nearest(*p)).map(|near| near.signed_distance.abs());
    ScalpScores {
        distance: Summary::of(signed.iter().map(|d| d.abs())),
        signed: Summary::of(signed.iter().copied()),
        roots: Summary::of(roots),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;
    use strandflow_geometry::primitives::icosphere;

    #[test]
    fn a_known_pose_error_is_measured_at_the_markers() {
        let pose = |degrees: f64, x: f64| RigidTransform {
            rotation: DMat3::from_rotation_z(degrees.to_radians()),
            translation: DVec3::new(x, 0.0, 0.0),
        };
        let truth = Truth {
            world_from_head: vec![RigidTransform::IDENTITY, pose(30.0, 0.0)],
            markers: vec![DVec3::ZERO],
            ..Truth::default()
        };
        let scores = evaluate_pose(&[0, 1], &[pose(0.0, 0.5), pose(32.0, 0.0)], &truth);
        assert!((scores.worst_degrees - 2.0).abs() < 1e-9 && (scores.worst_mm - 0.5).abs() < 1e-9);
        assert_eq!(scores.degrees.len(), 2);
    }

    #[test]
    fn a_sphere_too_small_lies_inside_by_the_difference() {
        let roots: Vec<DVec3> = icosphere(DVec3::ZERO, 100.0, 3).vertices;
        let truth = Truth {
            frames: vec![0],
            points: vec![roots.iter().map(|p| p.as_vec3()).collect()],
            offsets: (0..=roots.len() as u32).collect(),
            head: icosphere(DVec3::ZERO, 100.0, 4),
            ..Truth::default()
        };
        let scores = evaluate_scalp(&icosphere(DVec3::ZERO, 97.0, 4), &[DVec3::Z * 97.0], &truth);
        assert!((scores.signed.mean - 3.0).abs() < 0.2 && (scores.distance.mean - 3.0).abs() < 0.2);
        assert!((scores.roots.mean - 3.0).abs() < 0.2);
    }
}
