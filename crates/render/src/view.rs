//! Cameras of one's own: resized, looking at a point, around a subject.

use glam::{DMat3, DVec3};
use strandflow_core::{Camera, Distortion, RigidTransform};

/// The same view in another size \[px\]: as much of the scene as fits, in the middle.
pub fn resized(camera: &Camera, [width, height]: [usize; 2]) -> Camera {
    let scale = (width as f64 / camera.width as f64).min(height as f64 / camera.height as f64);
    let middle =
        [(width, camera.width), (height, camera.height)].map(|(new, old)| (new as f64 - scale * old as f64) / 2.0);
    Camera {
        width,
        height,
        focal: camera.focal.map(|f| f * scale),
        principal: [camera.principal[0] * scale + middle[0], camera.principal[1] * scale + middle[1]],
        ..camera.clone()
    }
}

/// A camera at `eye` that looks at `target`, `up` upwards, with an opening of `angle` rad along the shorter side.
pub fn look_at(eye: DVec3, target: DVec3, up: DVec3, angle: f64, [width, height]: [usize; 2]) -> Camera {
    let ahead = (target - eye).normalize_or(DVec3::Y);
    let right = ahead.cross(up).try_normalize().unwrap_or_else(|| ahead.any_orthonormal_vector());
    let rotation = DMat3::from_cols(right, ahead.cross(right), ahead).transpose();
    let focal = 0.5 * width.min(height) as f64 / (0.5 * angle).tan();
    Camera {
        name: "free".into(),
        width,
        height,
        focal: [focal; 2],
        principal: [0.5 * width as f64, 0.5 * height as f64],
        distortion: Distortion::None,
        camera_from_world: RigidTransform { rotation, translation: -(rotation * eye) },
    }
}

/// `count` cameras on a circle around points \[mm\], the first in the direction `from`; all points are in every picture.
pub fn turntable(points: &[DVec3], up: DVec3, from: DVec3, count: usize, size: [usize; 2]) -> Vec<Camera> {
    /// A portrait lens: about 24° along the shorter side. Wider ones give large noses.
    const ANGLE: f64 = 0.42;
    /// Room around the subject.
    const ROOM: f64 = 1.12;
    let up = up.normalize_or(DVec3::Z);
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = points.iter().fold(none, |(low, high), p| (low.min(*p), high.max(*p)));
    let middle = (low + high) * 0.5;
    // A cylinder about the axis: whatever side is seen, its radius and its height must fit.
    let (mut radius, mut half) = (1.0f64, 1.0f64);
    for p in points {
        let v = *p - middle;
        half = half.max(v.dot(up).abs());
        radius = radius.max((v - up * v.dot(up)).length());
    }
    let shorter = size[0].min(size[1]).max(1) as f64;
    let open = [size[0] as f64, size[1] as f64].map(|side| (0.5 * ANGLE).tan() * side / shorter);
    let distance = radius + ROOM * (radius / open[0]).max(half / open[1]);
    let level = (from - up * from.dot(up)).try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
    let side = up.cross(level);
    (0..count)
        .map(|k| {
            let (s, c) = (std::f64::consts::TAU * k as f64 / count as f64).sin_cos();
            // A little from above, as one looks at a person's hair.
            let eye = middle + ((level * c + side * s) * 0.985 + up * 0.17) * distance;
            look_at(eye, middle, up, ANGLE, size)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use strandflow_geometry::project::project;

    #[test]
    fn a_turntable_has_the_subject_in_every_picture() {
        let points: Vec<DVec3> =
            (0..200).map(|i| DVec3::new((i % 7) as f64 * 30.0, (i % 5) as f64 * 40.0, i as f64 * 2.0)).collect();
        for camera in turntable(&points, DVec3::Z, DVec3::Y, 12, [320, 240]) {
            for p in &points {
                let at = project(&camera, *p).unwrap();
                assert!(at.x > 0.0 && at.x < 320.0 && at.y > 0.0 && at.y < 240.0, "{at}");
            }
        }
    }

    #[test]
    fn a_resized_view_keeps_what_it_shows() {
        let camera = look_at(DVec3::new(0.0, -900.0, 40.0), DVec3::ZERO, DVec3::Z, 0.4, [640, 480]);
        let wide = resized(&camera, [1920, 1080]);
        let (a, b) = (project(&camera, DVec3::splat(30.0)).unwrap(), project(&wide, DVec3::splat(30.0)).unwrap());
        assert!((a.x * 2.25 + 240.0 - b.x).abs() < 1e-9 && (a.y * 2.25 - b.y).abs() < 1e-9);
        assert_eq!(resized(&camera, [640, 480]), camera);
    }
}
