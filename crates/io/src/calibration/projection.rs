//! A 3×4 projection matrix taken apart: P = K \[R | t\].
//!
//! Reference: Hartley & Zisserman 2004, section 6.2.4 (RQ decomposition), here by Gram–Schmidt from the last row up.

use glam::DVec3;
use strandflow_core::{Distortion, PolynomialLens};

use super::parts::{CameraParts, Lens, camera_matrix};

/// Skew below this share of the focal length is rounding of single precision.
const ROUNDING: f64 = 2e-4;

/// The camera of a projection (12 numbers or more, row major, of any scale and sign); `None` where the first three columns
/// are singular, or not finite. Points in front of the camera have positive depth; skew goes into the lens.
pub(super) fn taken_apart(name: String, p: &[f64]) -> Option<CameraParts> {
    let row = |i: usize| DVec3::new(p[4 * i], p[4 * i + 1], p[4 * i + 2]);
    let (m1, m2, m3) = (row(0), row(1), row(2));
    let sign = m1.cross(m2).dot(m3).signum();
    let scale = m3.length() * sign;
    let (m1, m2, r3) = (m1 / scale, m2 / scale, m3 / scale);
    let cy = m2.dot(r3);
    let below = m2 - r3 * cy;
    let fy = below.length();
    let r2 = below / fy;
    let (cx, skew) = (m1.dot(r3), m1.dot(r2));
    let left = m1 - r3 * cx - r2 * skew;
    let fx = left.length();
    let r1 = left / fx;
    let skew = if skew.abs() < ROUNDING * fx { 0.0 } else { skew };
    let column = [p[3] / scale, p[7] / scale, p[11] / scale];
    let ty = (column[1] - cy * column[2]) / fy;
    let tx = (column[0] - cx * column[2] - skew * ty) / fx;
    let all = [fx, fy, cx, cy, skew, tx, ty, column[2]];
    let is_sound = r1.is_finite() && r2.is_finite() && r3.is_finite() && all.iter().all(|x| x.is_finite());
    let lens = PolynomialLens { skew: skew / fx, ..PolynomialLens::default() };
    is_sound.then(|| CameraParts {
        name,
        size: None,
        k: camera_matrix(fx, fy, cx, cy),
        lens: if skew == 0.0 { Lens::OpenCv(vec![]) } else { Lens::Known(Distortion::Polynomial(lens)) },
        rotation: [r1, r2, r3].map(|r| r.to_array()),
        translation: [tx, ty, column[2]],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    #[test]
    fn a_product_is_taken_apart_whatever_its_scale_and_sign() {
        let r = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(-0.4);
        let k = DMat3::from_cols_array_2d(&[[1400.0, 0.0, 0.0], [3.0, 1390.0, 0.0], [320.0, 250.0, 1.0]]);
        let t = DVec3::new(0.1, -0.2, 1.5);
        let m = (k * r).transpose().to_cols_array_2d();
        let p4 = k * t;
        for scale in [1.0, -0.01] {
            let p: Vec<f64> = (0..3).flat_map(|i| m[i].into_iter().chain([p4[i]])).map(|x: f64| x * scale).collect();
            let parts = taken_apart("a".into(), &p).unwrap();
            let matrix = |rows: [[f64; 3]; 3]| DMat3::from_cols_array_2d(&rows).transpose();
            let Lens::Known(Distortion::Polynomial(lens)) = parts.lens else { panic!("no skew") };
            let skewed = [[parts.k[0][0], lens.skew * parts.k[0][0], parts.k[0][2]], parts.k[1], parts.k[2]];
            assert!((matrix(skewed) - k).to_cols_array().iter().all(|x| x.abs() < 1e-9));
            assert!((matrix(parts.rotation) - r).to_cols_array().iter().all(|x| x.abs() < 1e-12));
            assert!((DVec3::from(parts.translation) - t).length() < 1e-12);
        }
        assert!(taken_apart("a".into(), &[0.0; 12]).is_none());
        assert!(taken_apart("a".into(), &[f64::NAN; 12]).is_none());
    }
}
