//! Lights.

use glam::{DVec3, Vec3};
use strandflow_core::Camera;

/// A distant light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Unit direction towards the light, world.
    pub towards: Vec3,
    /// Irradiance of a surface that faces it, linear RGB.
    pub irradiance: Vec3,
}

/// All light of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct LightRig {
    /// Distant lights; each costs a shadow volume.
    pub lights: Vec<Light>,
    /// Radiance of the dome around the scene, linear RGB.
    pub dome: Vec3,
    /// Up: the dome is brightest there.
    pub up: Vec3,
}

impl LightRig {
    /// A photographer's studio around the camera: a key light from above at the left, a rim light from behind at the
    /// right, a weak fill. It stands where the camera stands, so that a turntable turns the head and not the lamps.
    pub fn studio(camera: &Camera, up: DVec3) -> Self {
        let up = up.normalize_or(DVec3::Z);
        let ahead = camera.camera_from_world.inverse().vector(DVec3::Z);
        let right = ahead.cross(up).try_normalize().unwrap_or(DVec3::X);
        let back = right.cross(up).normalize();
        // `back` points from the subject to the camera.
        let back = if back.dot(ahead) > 0.0 { -back } else { back };
        let light = |around_deg: f64, above_deg: f64, irradiance: Vec3| {
            let (s, c) = around_deg.to_radians().sin_cos();
            let (high, far) = above_deg.to_radians().sin_cos();
            let towards = ((back * c + right * s) * far + up * high).as_vec3().normalize();
            Light { towards, irradiance }
        };
        let lights = vec![
            light(-32.0, 38.0, Vec3::new(1.0, 0.97, 0.92) * 8.5),
            light(150.0, 40.0, Vec3::new(0.95, 0.98, 1.0) * 6.0),
            light(55.0, 12.0, Vec3::new(0.96, 0.98, 1.0) * 2.4),
        ];
        Self { lights, dome: Vec3::splat(0.5), up: up.as_vec3() }
    }
}
