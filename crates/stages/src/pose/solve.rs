//! Rigid poses from markers: eq. 1, made robust and refined in the images.

use glam::{DMat3, DVec2, DVec3};
use nalgebra::{Matrix6, Vector6};
use strandflow_core::{Rig, RigidTransform};
use strandflow_geometry::{align::rigid_from_points, project::project};

/// A marker seen in a view.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub view: usize,
    pub marker: usize,
    pub point: DVec2,
    pub weight: f64,
}

/// Eq. 1 over all corresponding points.
pub(super) fn eq1(first: &[Option<DVec3>], now: &[Option<DVec3>]) -> Option<RigidTransform> {
    let (a, b): (Vec<DVec3>, Vec<DVec3>) = first.iter().zip(now).filter_map(|(a, b)| Some(((*a)?, (*b)?))).unzip();
    rigid_from_points(&a, &b, &vec![1.0; a.len()])
}

/// Eq. 1 over the largest set of markers that agree within `inlier_mm`, found over all triples.
pub(super) fn consensus(first: &[Option<DVec3>], now: &[Option<DVec3>], inlier_mm: f64) -> Option<RigidTransform> {
    let (a, b): (Vec<DVec3>, Vec<DVec3>) = first.iter().zip(now).filter_map(|(a, b)| Some(((*a)?, (*b)?))).unzip();
    let agreeing = |pose: &RigidTransform| -> Vec<f64> {
        a.iter().zip(&b).map(|(a, b)| f64::from(pose.point(*a).distance(*b) <= inlier_mm)).collect()
    };
    let mut best: Option<(f64, Vec<f64>)> = None;
    for i in 0..a.len() {
        for j in 0..i {
            for k in 0..j {
                let pick = |p: &[DVec3]| [p[i], p[j], p[k]];
                let Some(pose) = rigid_from_points(&pick(&a), &pick(&b), &[1.0; 3]) else { continue };
                let weights = agreeing(&pose);
                let count = weights.iter().sum::<f64>();
                if best.as_ref().is_none_or(|(c, _)| count > *c) {
                    best = Some((count, weights));
                }
            }
        }
    }
    let (_, weights) = best?;
    rigid_from_points(&a, &b, &weights)
}

/// Minimises the Huber loss of all reprojection errors over the six degrees of freedom (Gauss–Newton, 12 steps or
/// below 1e-7), turning about the markers' centre so that rotation and translation do not mix.
pub(super) fn refine(
    rig: &Rig,
    model: &[Option<DVec3>],
    seen: &[Seen],
    start: RigidTransform,
    huber_px: f64,
) -> RigidTransform {
    let known: Vec<DVec3> = model.iter().flatten().copied().collect();
    if known.is_empty() {
        return start;
    }
    let centre = known.iter().sum::<DVec3>() / known.len() as f64;
    let mut pose = start;
    for _ in 0..12 {
        let (mut h, mut g) = (Matrix6::<f64>::identity() * 1e-9, Vector6::<f64>::zeros());
        let pivot = pose.point(centre);
        for s in seen {
            let Some(x) = model[s.marker] else { continue };
            let camera = &rig.cameras[s.view];
            let x = pose.point(x);
            let Some(p) = project(camera, x) else { continue };
            let r = p - s.point;
            let w = s.weight * huber_px / r.length().max(huber_px);
            let along = |d: DVec3| match (project(camera, x + d * 1e-3), project(camera, x - d * 1e-3)) {
                (Some(a), Some(b)) => (a - b) / 2e-3,
                _ => DVec2::ZERO,
            };
            let axes = [DVec3::X, DVec3::Y, DVec3::Z];
            let j: Vec<DVec2> =
                axes.iter().map(|a| along(a.cross(x - pivot))).chain(axes.iter().map(|a| along(*a))).collect();
            for axis in 0..2 {
                let row = Vector6::from_fn(|k, _| j[k][axis]);
                h += w * row * row.transpose();
                g += w * row * r[axis];
            }
        }
        let Some(step) = h.cholesky().map(|c| c.solve(&g)) else { break };
        let (turn, shift) = (-DVec3::new(step[0], step[1], step[2]), -DVec3::new(step[3], step[4], step[5]));
        let rotation = match turn.try_normalize() {
            Some(axis) => DMat3::from_axis_angle(axis, turn.length()),
            None => DMat3::IDENTITY,
        };
        pose = RigidTransform {
            rotation: rotation * pose.rotation,
            translation: rotation * (pose.translation - pivot) + pivot + shift,
        };
        if turn.length() + shift.length() < 1e-7 {
            break;
        }
    }
    pose
}

/// Between two poses by slerp about a point of the head.
pub(super) fn between(a: &RigidTransform, b: &RigidTransform, t: f64, centre: DVec3) -> RigidTransform {
    let (qa, qb) = (glam::DQuat::from_mat3(&a.rotation), glam::DQuat::from_mat3(&b.rotation));
    let rotation = DMat3::from_quat(qa.slerp(qb, t));
    RigidTransform { rotation, translation: a.point(centre).lerp(b.point(centre), t) - rotation * centre }
}

#[cfg(test)]
mod tests {
    use super::*;
    use strandflow_core::{Camera, Distortion};

    fn rig() -> Rig {
        let cameras = (0..4)
            .map(|i| Camera {
                name: format!("c{i}"),
                width: 640,
                height: 480,
                focal: [1400.0; 2],
                principal: [320.0, 240.0],
                distortion: Distortion::None,
                camera_from_world: RigidTransform {
                    rotation: DMat3::from_rotation_y(i as f64 * 0.7),
                    translation: DVec3::new(0.0, 0.0, 1500.0),
                },
            })
            .collect();
        Rig { cameras }
    }

    fn markers() -> Vec<Option<DVec3>> {
        (0..8)
            .map(|i| {
                let a = f64::from(i) * 2.4;
                Some(DVec3::new(80.0 * a.cos(), -20.0 - 9.0 * f64::from(i), 80.0 * a.sin()))
            })
            .collect()
    }

    #[test]
    fn wrong_markers_and_wrong_points_do_not_move_the_pose() {
        let truth = RigidTransform {
            rotation: DMat3::from_axis_angle(DVec3::new(0.2, 1.0, 0.1).normalize(), 0.4),
            translation: DVec3::new(12.0, -3.0, 20.0),
        };
        let model = markers();
        let mut now: Vec<_> = model.iter().map(|m| m.map(|m| truth.point(m))).collect();
        now[2] = now[2].map(|m| m + DVec3::new(40.0, 0.0, 0.0));
        now[5] = now[5].map(|m| m + DVec3::new(0.0, 30.0, 10.0));
        let found = consensus(&model, &now, 3.0).unwrap();
        assert!(found.inverse().after(&truth).angle() < 1e-6);
        let rig = rig();
        let mut seen = Vec::new();
        for view in 0..4 {
            for (marker, at) in model.iter().enumerate() {
                let exact = project(&rig.cameras[view], truth.point(at.unwrap())).unwrap();
                let noise = DVec2::new(
                    (((view * 8 + marker) * 37) % 11) as f64 - 5.0,
                    ((view * 31 + marker * 17) % 11) as f64 - 5.0,
                );
                seen.push(Seen { view, marker, point: exact + 0.02 * noise, weight: 1.0 });
            }
        }
        seen[3].point.x += 20.0;
        let refined = refine(&rig, &model, &seen, RigidTransform::IDENTITY, 0.5);
        assert!(refined.inverse().after(&truth).angle().to_degrees() < 0.05);
        assert!((refined.point(DVec3::ZERO) - truth.point(DVec3::ZERO)).length() < 0.1);
    }

    #[test]
    fn halfway_is_halfway() {
        let b = RigidTransform { rotation: DMat3::from_rotation_y(0.6), translation: DVec3::new(10.0, 0.0, 0.0) };
        let half = between(&RigidTransform::IDENTITY, &b, 0.5, DVec3::ZERO);
        assert!((half.angle() - 0.3).abs() < 1e-12 && (half.translation.x - 5.0).abs() < 1e-12);
    }
}
