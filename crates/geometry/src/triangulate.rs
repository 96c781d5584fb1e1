//! Triangulation of points from several views.

use glam::{DMat3, DVec2, DVec3};
use strandflow_core::{Camera, Rig};

use crate::project::{project, ray};

/// A triangulated point.
#[derive(Clone, Debug, PartialEq)]
pub struct Triangulated {
    /// World position \[mm\].
    pub point: DVec3,
    /// Indices (into the observations) that agree.
    pub inliers: Vec<usize>,
    /// Root mean square reprojection error of the inliers \[px\].
    pub rms_px: f64,
}

/// Robust triangulation: the best pair of views by agreement, then Gauss–Newton on the reprojection error of the views
/// that agree within `inlier_px`.
///
/// `None` with fewer than two views that agree. Exhaustive over pairs, so deterministic.
pub fn triangulate(observations: &[(&Camera, DVec2)], inlier_px: f64) -> Option<Triangulated> {
    let error = |point: DVec3, i: usize| {
        project(observations[i].0, point).map_or(f64::INFINITY, |p| p.distance(observations[i].1))
    };
    let agreeing = |point| (0..observations.len()).filter(|&i| error(point, i) <= inlier_px).collect::<Vec<_>>();
    let mut best: Option<(Vec<usize>, f64, DVec3)> = None;
    for i in 0..observations.len() {
        for j in 0..i {
            let Some(point) = midpoint(&[observations[i], observations[j]]) else { continue };
            let inliers = agreeing(point);
            let cost = inliers.iter().map(|&k| error(point, k).powi(2)).sum::<f64>();
            let better = best
                .as_ref()
                .is_none_or(|(b, c, _)| inliers.len() > b.len() || (inliers.len() == b.len() && cost < *c));
            if inliers.len() >= 2 && better {
                best = Some((inliers, cost, point));
            }
        }
    }
    let (mut inliers, _, mut point) = best?;
    for _ in 0..2 {
        let chosen: Vec<_> = inliers.iter().map(|&i| observations[i]).collect();
        point = refine(&chosen, point);
        let again = agreeing(point);
        if again.len() < 2 {
            break;
        }
        inliers = again;
    }
    let mean = inliers.iter().map(|&i| error(point, i).powi(2)).sum::<f64>() / inliers.len() as f64;
    Some(Triangulated { point, inliers, rms_px: mean.sqrt() })
}

/// The point nearest to all rays in the least-squares sense; `None` where they are parallel.
pub fn midpoint(observations: &[(&Camera, DVec2)]) -> Option<DVec3> {
    let (mut a, mut b) = (DMat3::ZERO, DVec3::ZERO);
    for (camera, pixel) in observations {
        let r = ray(camera, *pixel);
        let d = r.direction;
        let m = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        a += m;
        b += m * r.origin;
    }
    (a.determinant().abs() > 1e-9).then(|| a.inverse() * b)
}

/// The point nearest to all optical axes of a rig in the least-squares sense \[mm\]; `None` where they are parallel.
pub fn meeting_of_axes(rig: &Rig) -> Option<DVec3> {
    let (mut a, mut b) = (DMat3::ZERO, DVec3::ZERO);
    for camera in &rig.cameras {
        let d = camera.camera_from_world.rotation.row(2);
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        a += across;
        b += across * camera.centre_in_world();
    }
    (a.determinant().abs() > 1e-6).then(|| a.inverse() * b)
}

/// Gauss–Newton on the squared reprojection error (10 steps or below 1e-9 mm).
fn refine(observations: &[(&Camera, DVec2)], start: DVec3) -> DVec3 {
    let mut x = start;
    for _ in 0..10 {
        let (mut h, mut g) = (DMat3::ZERO, DVec3::ZERO);
        for (camera, pixel) in observations {
            let Some(p) = project(camera, x) else { return start };
            let columns = [DVec3::X, DVec3::Y, DVec3::Z].map(|e| {
                let plus = project(camera, x + e * 1e-3).unwrap_or(p);
                let minus = project(camera, x - e * 1e-3).unwrap_or(p);
                (plus - minus) / 2e-3
            });
            let r = p - *pixel;
            for axis in 0..2 {
                let j = DVec3::new(columns[0][axis], columns[1][axis], columns[2][axis]);
                h += DMat3::from_cols(j * j.x, j * j.y, j * j.z);
                g += j * r[axis];
            }
        }
        let step = h.inverse() * g;
        if !step.is_finite() {
            return start;
        }
        x -= step;
        if step.length_squared() < 1e-18 {
            break;
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use strandflow_core::{Distortion, RigidTransform};

    #[test]
    fn one_wrong_view_of_four_is_left_out() {
        let cameras: Vec<Camera> = (0..4)
            .map(|i| Camera {
                name: format!("c{i}"),
                width: 640,
                height: 480,
                focal: [1400.0; 2],
                principal: [320.0, 240.0],
                distortion: Distortion::None,
                camera_from_world: RigidTransform {
                    rotation: glam::DMat3::from_rotation_y(i as f64 * 0.5),
                    translation: DVec3::new(0.0, 0.0, 1500.0),
                },
            })
            .collect();
        let truth = DVec3::new(12.0, -30.0, 21.0);
        let mut seen: Vec<_> = cameras.iter().map(|c| (c, project(c, truth).unwrap())).collect();
        seen[2].1 += DVec2::new(25.0, -10.0);
        let found = triangulate(&seen, 3.0).unwrap();
        assert_eq!(found.inliers, [0, 1, 3]);
        assert!(found.point.distance(truth) < 1e-6);
    }
}
