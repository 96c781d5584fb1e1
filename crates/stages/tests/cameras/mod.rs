//! Cameras around a small thing at the origin, z up.

use glam::{DMat3, DVec3};
use strandflow_core::{Camera, Distortion, RigidTransform};

/// A camera of 240 × 240 pixels that looks at the origin from 900 mm away; `height` is that of its place over the horizontal
/// distance from the axis, `focal` in pixels.
pub fn camera(name: String, azimuth_deg: f64, height: f64, focal: f64) -> Camera {
    let azimuth = azimuth_deg.to_radians();
    let centre = DVec3::new(azimuth.cos(), azimuth.sin(), height).normalize() * 900.0;
    let forward = -centre.normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    Camera {
        name,
        width: 240,
        height: 240,
        focal: [focal; 2],
        principal: [120.0; 2],
        distortion: Distortion::None,
        camera_from_world: RigidTransform { rotation, translation: -(rotation * centre) },
    }
}
