//! Calibrated cameras. Axes are OpenCV's (x right, y down, z forward); the first pixel's centre is (0.5, 0.5).

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::RigidTransform;

/// Lens distortion of normalised image coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Distortion {
    /// An ideal pinhole.
    #[default]
    None,
    /// Brown–Conrady in OpenCV's order: k1, k2, p1, p2, k3, k4, k5, k6 (k4–k6 divide; unused terms are zero).
    BrownConrady([f64; 8]),
}

/// One calibrated view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// The name of the view; sources and masks are found by it.
    pub name: String,
    /// Image width \[px\].
    pub width: usize,
    /// Image height \[px\].
    pub height: usize,
    /// Focal lengths (fx, fy) \[px\].
    pub focal: [f64; 2],
    /// Principal point (cx, cy) \[px\].
    pub principal: [f64; 2],
    /// Lens distortion.
    #[serde(default)]
    pub distortion: Distortion,
    /// World (mm) to camera (mm).
    pub camera_from_world: RigidTransform,
}

impl Camera {
    /// The centre of projection in world coordinates \[mm\].
    pub fn centre_in_world(&self) -> DVec3 {
        self.camera_from_world.inverse().translation
    }
}

/// All views of a take, in the order in which every per-view array is stored.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Rig {
    /// The views.
    pub cameras: Vec<Camera>,
}

impl Rig {
    /// Number of views.
    pub fn view_count(&self) -> usize {
        self.cameras.len()
    }

    /// The index of the view with this name.
    pub fn view_named(&self, name: &str) -> Option<usize> {
        self.cameras.iter().position(|camera| camera.name == name)
    }
}
