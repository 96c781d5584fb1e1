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
    /// OpenCV's whole model: the eight of `BrownConrady`, thin prism s1, s2, s3, s4, and tilt of the sensor τx, τy \[rad\].
    Tilted([f64; 14]),
    /// Polynomials of the radius, or of the angle to the axis.
    Polynomial(PolynomialLens),
    /// The field-of-view model with its angle ω \[rad\] (Devernay & Faugeras 2001).
    Fov(f64),
}

/// A lens by polynomials without division: Metashape's frame cameras, and the fisheyes of OpenCV, COLMAP and Metashape.
///
/// With (x, y) = (X/Z, Y/Z), for a fisheye scaled to the length atan(|(x, y)|), and r = |(x, y)|:
/// x′ = x (1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + 2 p1 x y + p2 (r² + 2x²) + s1 r² + skew · y′, and
/// y′ = y (1 + …) + p1 (r² + 2y²) + 2 p2 x y + s2 r².
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PolynomialLens {
    /// Whether r is the angle to the axis (equidistant fisheye) rather than its tangent.
    pub fisheye: bool,
    /// k1, k2, k3, k4.
    pub radial: [f64; 4],
    /// p1, p2.
    pub tangential: [f64; 2],
    /// s1, s2.
    pub prism: [f64; 2],
    /// Share of y′ added to x′: where pixels are no rectangles.
    pub skew: f64,
}

impl Distortion {
    /// Whether all terms are finite.
    pub fn is_finite(&self) -> bool {
        match self {
            Self::None => true,
            Self::BrownConrady(terms) => terms.iter().all(|term| term.is_finite()),
            Self::Tilted(terms) => terms.iter().all(|term| term.is_finite()),
            Self::Fov(angle) => angle.is_finite(),
            Self::Polynomial(lens) => {
                let terms = lens.radial.iter().chain(&lens.tangential).chain(&lens.prism).chain([&lens.skew]);
                terms.into_iter().all(|term| term.is_finite())
            }
        }
    }
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
