//! Lenses: normalised image coordinates through the lens and back.
//!
//! Reference: Brown 1966; OpenCV's calib3d for the rational, thin-prism, tilted and fisheye models (Kannala & Brandt 2006);
//! Devernay & Faugeras 2001 for the field-of-view model; COLMAP's and Metashape's documentation for the order of terms.

use glam::{DMat2, DMat3, DVec2, DVec3};
use strandflow_core::{Distortion, PolynomialLens};

/// Beyond this angle to the axis a fisheye's ray has no place in the plane of normalised coordinates \[rad\].
const WIDEST: f64 = std::f64::consts::FRAC_PI_2 - 1e-4;

/// Distorted normalised coordinates.
pub fn distort(distortion: &Distortion, n: DVec2) -> DVec2 {
    match distortion {
        Distortion::None => n,
        Distortion::BrownConrady(terms) => rational(terms, n),
        Distortion::Tilted(terms) => tilted(terms, n),
        Distortion::Polynomial(lens) => polynomial(lens, if lens.fisheye { bent(n) } else { n }),
        Distortion::Fov(angle) => n * fov_scale(*angle, n.length()),
    }
}

/// Undistorted normalised coordinates: where `distort` leads to the given ones. Newton steps, at most 20, converged below
/// 1e-13; a fisheye's ray at 90° from the axis or beyond comes back just inside 90°.
pub fn undistort(distortion: &Distortion, distorted: DVec2) -> DVec2 {
    match distortion {
        Distortion::None => distorted,
        Distortion::Fov(angle) => {
            let r = distorted.length();
            let scale = 2.0 * (angle * 0.5).tan();
            let straight = (r * angle).min(WIDEST).tan() / scale;
            if r * scale.abs() < 1e-9 || *angle == 0.0 { distorted } else { distorted * (straight / r) }
        }
        // In the plane of angles, where the steps are even: tangents grow without bound.
        Distortion::Polynomial(lens) if lens.fisheye => unbent(solve(|at| polynomial(lens, at), distorted)),
        Distortion::BrownConrady(_) | Distortion::Tilted(_) | Distortion::Polynomial(_) => {
            solve(|at| distort(distortion, at), distorted)
        }
    }
}

fn solve(lens: impl Fn(DVec2) -> DVec2, target: DVec2) -> DVec2 {
    let mut n = target;
    for _ in 0..20 {
        let error = lens(n) - target;
        if error.length_squared() < 1e-26 {
            break;
        }
        const H: f64 = 1e-6;
        let dx = (lens(n + DVec2::X * H) - lens(n - DVec2::X * H)) / (2.0 * H);
        let dy = (lens(n + DVec2::Y * H) - lens(n - DVec2::Y * H)) / (2.0 * H);
        let step = DMat2::from_cols(dx, dy).inverse() * error;
        if !step.is_finite() {
            break;
        }
        n -= step;
    }
    n
}

fn rational(terms: &[f64; 8], n: DVec2) -> DVec2 {
    let [k1, k2, p1, p2, k3, k4, k5, k6] = *terms;
    let r2 = n.length_squared();
    let radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)));
    n * radial + tangential([p1, p2], n)
}

fn tangential([p1, p2]: [f64; 2], n: DVec2) -> DVec2 {
    let (r2, xy) = (n.length_squared(), 2.0 * n.x * n.y);
    DVec2::new(p1 * xy + p2 * (r2 + 2.0 * n.x * n.x), p1 * (r2 + 2.0 * n.y * n.y) + p2 * xy)
}

fn tilted(terms: &[f64; 14], n: DVec2) -> DVec2 {
    let [k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tilt_x, tilt_y] = *terms;
    let r2 = n.length_squared();
    let prism = DVec2::new(r2 * (s1 + r2 * s2), r2 * (s3 + r2 * s4));
    let flat = rational(&[k1, k2, p1, p2, k3, k4, k5, k6], n) + prism;
    // The plane of the sensor, turned about x and then about y, seen along the axis.
    let turn = DMat3::from_rotation_y(-tilt_y) * DMat3::from_rotation_x(-tilt_x);
    let axis = turn.z_axis;
    let seen =
        DMat3::from_cols(DVec3::new(axis.z, 0.0, 0.0), DVec3::new(0.0, axis.z, 0.0), DVec3::new(-axis.x, -axis.y, 1.0))
            * (turn * flat.extend(1.0));
    DVec2::new(seen.x / seen.z, seen.y / seen.z)
}

fn polynomial(lens: &PolynomialLens, n: DVec2) -> DVec2 {
    let [k1, k2, k3, k4] = lens.radial;
    let r2 = n.length_squared();
    let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)));
    let seen = n * radial + tangential(lens.tangential, n) + DVec2::from(lens.prism) * r2;
    DVec2::new(seen.x + lens.skew * seen.y, seen.y)
}

/// The point at the angle of the ray rather than its tangent.
fn bent(n: DVec2) -> DVec2 {
    let r = n.length();
    if r < 1e-9 { n } else { n * (r.atan() / r) }
}

fn unbent(n: DVec2) -> DVec2 {
    let angle = n.length();
    if angle < 1e-9 { n } else { n * (angle.min(WIDEST).tan() / angle) }
}

fn fov_scale(angle: f64, r: f64) -> f64 {
    let scale = 2.0 * (angle * 0.5).tan();
    // Towards the axis, and for no angle, the model is the pinhole times scale / angle, and the pinhole.
    if angle == 0.0 {
        1.0
    } else if r * scale.abs() < 1e-9 {
        scale / angle
    } else {
        (r * scale).atan() / (r * angle)
    }
}

#[cfg(test)]
#[path = "lens_tests.rs"]
mod tests;
