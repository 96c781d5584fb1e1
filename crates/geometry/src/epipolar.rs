//! How far two image points are from showing one place.
//!
//! Reference: Hartley & Zisserman 2004, section 9.2 and 11.4.3.

use glam::{DVec2, DVec3};
use strandflow_core::Camera;

use crate::project::{Ray, ray};

/// Symmetric epipolar distance of two image points \[px\]: the mean, over both images, of the distance between the point and
/// the line on which the other view's point lies. Distances are those of the images without the lenses' distortion.
///
/// It says nothing of a displacement along that line. `None` where the cameras stand in one place, or a camera looks along the
/// line between them at the point.
pub fn epipolar_distance(a: (&Camera, DVec2), b: (&Camera, DVec2)) -> Option<f64> {
    let (from_a, from_b) = (ray(a.0, a.1), ray(b.0, b.1));
    let between = from_b.origin - from_a.origin;
    // The plane through both centres and the other view's point cuts each image in its epipolar line.
    let in_b = off_plane(b.0, &from_b, between.cross(from_a.direction))?;
    let in_a = off_plane(a.0, &from_a, between.cross(from_b.direction))?;
    Some(0.5 * (in_a + in_b))
}

/// Distance \[px\] of the image point of a ray from the line in which a plane through the camera's centre cuts the image.
fn off_plane(camera: &Camera, of: &Ray, normal: DVec3) -> Option<f64> {
    let rotation = camera.camera_from_world.rotation;
    let (line, point) = (rotation * normal.try_normalize()?, rotation * of.direction);
    let slope = DVec2::new(line.x / camera.focal[0], line.y / camera.focal[1]).length();
    let off = (line.dot(point) / point.z).abs() / slope;
    off.is_finite().then_some(off)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::project::{project, tests::camera};
    use strandflow_core::Distortion;

    #[test]
    fn points_of_one_place_lie_on_each_other_s_lines() {
        let lens = Distortion::BrownConrady([-0.3, 0.1, 1e-3, -2e-3, 0.02, 0.01, 0.0, 0.0]);
        let (a, b) = (camera(0.0, lens), camera(0.6, Distortion::None));
        for place in [DVec3::new(60.0, -110.0, 40.0), DVec3::new(-20.0, 70.0, -30.0)] {
            let off = epipolar_distance((&a, project(&a, place).unwrap()), (&b, project(&b, place).unwrap()));
            assert!(off.unwrap() < 1e-6, "{off:?}");
        }
    }

    #[test]
    fn a_step_across_the_line_is_measured_in_pixels_and_one_along_it_is_not() {
        // Cameras side by side: lines are rows of the image.
        let a = camera(0.0, Distortion::None);
        let mut b = a.clone();
        b.camera_from_world.translation.x -= 300.0;
        let place = DVec3::new(15.0, 30.0, -20.0);
        let (at, other) = (project(&a, place).unwrap(), project(&b, place).unwrap());
        let off = |step: DVec2| epipolar_distance((&a, at), (&b, other + step)).unwrap();
        assert!((off(DVec2::new(0.0, 3.0)) - 3.0).abs() < 1e-9, "{}", off(DVec2::new(0.0, 3.0)));
        assert!(off(DVec2::new(12.0, 0.0)) < 1e-9);
        assert_eq!(epipolar_distance((&a, at), (&a, at)), None);
    }
}
