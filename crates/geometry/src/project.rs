//! Projection into images and back, with lens distortion.
//!
//! Reference: Brown 1966; the lenses are in `lens`.

use glam::{DVec2, DVec3};
use strandflow_core::Camera;

pub use crate::lens::{distort, undistort};

/// A half line in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start \[mm\].
    pub origin: DVec3,
    /// Unit direction.
    pub direction: DVec3,
}

/// The image point \[px\] of a world point \[mm\]; `None` behind the camera (depth below 1 µm).
#[inline]
pub fn project(camera: &Camera, point: DVec3) -> Option<DVec2> {
    project_with_depth(camera, point).map(|(pixel, _)| pixel)
}

/// The image point \[px\] of a world point \[mm\] and its [`depth`]; `None` behind the camera.
#[inline]
pub fn project_with_depth(camera: &Camera, point: DVec3) -> Option<(DVec2, f64)> {
    let p = camera.camera_from_world.point(point);
    (p.z > 1e-3)
        .then(|| (pixel_from_normalised(camera, distort(&camera.distortion, DVec2::new(p.x / p.z, p.y / p.z))), p.z))
}

/// Distance along the optical axis \[mm\].
#[inline]
pub fn depth(camera: &Camera, point: DVec3) -> f64 {
    camera.camera_from_world.rotation.row(2).dot(point) + camera.camera_from_world.translation.z
}

/// The ray through an image point \[px\].
pub fn ray(camera: &Camera, pixel: DVec2) -> Ray {
    let n = undistort(&camera.distortion, normalised_from_pixel(camera, pixel));
    let world_from_camera = camera.camera_from_world.inverse();
    Ray { origin: world_from_camera.translation, direction: world_from_camera.vector(n.extend(1.0)).normalize() }
}

/// Image direction (unit) of a world direction at a world point; `None` behind the camera or along the viewing ray.
pub fn project_direction(camera: &Camera, point: DVec3, direction: DVec3) -> Option<DVec2> {
    // A central difference over 0.2 mm: the projection is smooth, its error is below 1e-7 rad at any sane depth.
    let a = project(camera, point - direction * 0.1)?;
    let b = project(camera, point + direction * 0.1)?;
    (b - a).try_normalize()
}

/// Unit normal (world) of the plane through the camera centre that holds an image direction at an image point.
pub fn plane_normal(camera: &Camera, pixel: DVec2, direction: DVec2) -> DVec3 {
    let a = ray(camera, pixel - direction * 0.5).direction;
    let b = ray(camera, pixel + direction * 0.5).direction;
    a.cross(b).normalize_or_zero()
}

fn pixel_from_normalised(camera: &Camera, n: DVec2) -> DVec2 {
    DVec2::new(camera.focal[0] * n.x + camera.principal[0], camera.focal[1] * n.y + camera.principal[1])
}

fn normalised_from_pixel(camera: &Camera, pixel: DVec2) -> DVec2 {
    DVec2::new((pixel.x - camera.principal[0]) / camera.focal[0], (pixel.y - camera.principal[1]) / camera.focal[1])
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use strandflow_core::{Distortion, RigidTransform};

    /// A camera turned about the vertical by so much \[rad\].
    pub(crate) fn camera(turn: f64, distortion: Distortion) -> Camera {
        Camera {
            name: "c".into(),
            width: 640,
            height: 480,
            focal: [1400.0, 1390.0],
            principal: [322.0, 241.0],
            distortion,
            camera_from_world: RigidTransform {
                rotation: glam::DMat3::from_rotation_y(turn),
                translation: DVec3::new(10.0, -20.0, 1500.0),
            },
        }
    }

    #[test]
    fn a_ray_through_a_projection_meets_its_point() {
        for d in [Distortion::None, Distortion::BrownConrady([-0.3, 0.1, 1e-3, -2e-3, 0.02, 0.01, 0.0, 0.0])] {
            let camera = camera(0.4, d);
            let point = DVec3::new(60.0, -110.0, 40.0);
            let ray = ray(&camera, project(&camera, point).unwrap());
            let off = (point - ray.origin).reject_from_normalized(ray.direction).length();
            assert!(off < 1e-8, "{off}");
        }
    }

    #[test]
    fn the_plane_of_a_projected_direction_holds_the_direction() {
        let camera = camera(0.4, Distortion::BrownConrady([-0.3, 0.1, 1e-3, -2e-3, 0.0, 0.0, 0.0, 0.0]));
        let (point, direction) = (DVec3::new(30.0, 50.0, -20.0), DVec3::new(1.0, 2.0, -0.5).normalize());
        let image_direction = project_direction(&camera, point, direction).unwrap();
        let normal = plane_normal(&camera, project(&camera, point).unwrap(), image_direction);
        assert!(normal.dot(direction).abs() < 1e-6);
    }
}
