//! Cameras as files describe them, and what makes a sound camera of them.

use std::path::Path;

use glam::{DMat3, DVec3};
use strandflow_core::{Camera, Distortion, PolynomialLens, RigidTransform};

use super::convention::{Axes, Pose};
use crate::{IoError, error::At};

/// Distortion as files give it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Lens {
    /// OpenCV's order, 0 to 14 numbers: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 τx τy.
    OpenCv(Vec<f64>),
    /// OpenCV's fisheye, 0 to 4 numbers; more only if they are zero.
    Fisheye(Vec<f64>),
    /// Known already.
    Known(Distortion),
}

/// A camera as files describe it, before it is checked.
#[derive(Clone, Debug)]
pub(crate) struct CameraParts {
    /// View name.
    pub name: String,
    /// Image size \[px\], where the file has it.
    pub size: Option<[usize; 2]>,
    /// The matrix K, row major.
    pub k: [[f64; 3]; 3],
    /// Distortion.
    pub lens: Lens,
    /// R, row major, in the file's direction and axes.
    pub rotation: [[f64; 3]; 3],
    /// t, in the file's unit.
    pub translation: [f64; 3],
}

impl CameraParts {
    fn wrong<T>(&self, file: &Path, fact: String, hint: &str) -> Result<T, IoError> {
        Err(IoError::content(file, At::view(&self.name), fact, hint))
    }

    /// World to camera with OpenCV's axes, in the file's unit. A rotation off by less than 1e-3 (rounded text) is made
    /// orthonormal.
    ///
    /// # Errors
    /// Non-finite numbers, or a rotation that is none.
    pub fn pose(&self, file: &Path, pose: Pose, axes: Axes) -> Result<RigidTransform, IoError> {
        let numbers = self.rotation.iter().flatten().chain(&self.translation);
        if let Some(bad) = numbers.copied().find(|x| !x.is_finite()) {
            return self.wrong(file, format!("holds the non-finite number {bad}"), CALIBRATE);
        }
        let Some(rotation) = rotation_from_rows(&self.rotation) else {
            let flipped = rotation_from_rows(&self.rotation.map(|row| row.map(|x| -x))).is_some();
            let hint = if flipped {
                "its axes are mirrored (determinant -1): export with right-handed axes"
            } else {
                "check R and its row/column order"
            };
            return self.wrong(file, "R is not a rotation (orthonormal, determinant +1)".into(), hint);
        };
        let given = RigidTransform { rotation, translation: DVec3::from(self.translation) };
        let turned = match pose {
            Pose::WorldToCamera => given,
            Pose::CameraToWorld => given.inverse(),
        };
        let flip = match axes {
            Axes::OpenCv => DVec3::ONE,
            Axes::OpenGl => DVec3::new(1.0, -1.0, -1.0),
        };
        let flip = RigidTransform { rotation: DMat3::from_diagonal(flip), translation: DVec3::ZERO };
        Ok(flip.after(&turned))
    }

    /// Checks and converts. `pixel_shift` is added to the principal point: 0.5 where the file's first pixel centre is (0, 0).
    ///
    /// # Errors
    /// Non-finite numbers, no image size, a focal length that is not positive, skew, more distortion terms than the model
    /// has. All name the file and the camera.
    pub fn build(self, file: &Path, camera_from_world: RigidTransform, pixel_shift: f64) -> Result<Camera, IoError> {
        let k = self.k;
        if let Some(bad) = k.iter().flatten().copied().find(|x| !x.is_finite()) {
            return self.wrong(file, format!("holds the non-finite number {bad}"), CALIBRATE);
        }
        let Some(size) = self.size else {
            let hint = "give the size beside the camera, or make the take with `strandflow new`, which takes it from the footage";
            return self.wrong(file, "the calibration does not state the image size".into(), hint);
        };
        if size.contains(&0) || size.iter().any(|&side| side > 100_000) {
            let fact = format!("has the image size {} x {}", size[0], size[1]);
            return self.wrong(file, fact, "give width and height in pixels");
        }
        if !(k[2][2].abs() > 1e-12 && k[0][0] / k[2][2] > 0.0 && k[1][1] / k[2][2] > 0.0) {
            return self.wrong(file, format!("has the focal lengths {} and {}", k[0][0], k[1][1]), CALIBRATE);
        }
        if k[0][1].abs() > 1e-6 * k[0][0].abs() || k[1][0] != 0.0 || k[2][0] != 0.0 || k[2][1] != 0.0 {
            let hint = "calibrate without skew: K = [fx 0 cx; 0 fy cy; 0 0 1]";
            return self.wrong(file, "K has skew or is not a camera matrix".into(), hint);
        }
        let distortion = self.distortion(file)?;
        let scale = k[2][2];
        Ok(Camera {
            name: self.name,
            width: size[0],
            height: size[1],
            focal: [k[0][0] / scale, k[1][1] / scale],
            principal: [k[0][2] / scale + pixel_shift, k[1][2] / scale + pixel_shift],
            distortion,
            camera_from_world,
        })
    }

    fn distortion(&self, file: &Path) -> Result<Distortion, IoError> {
        let distortion = match &self.lens {
            Lens::Known(distortion) => *distortion,
            Lens::OpenCv(terms) => {
                if terms.iter().skip(14).any(|&x| x != 0.0) {
                    let fact = format!("has {} distortion numbers", terms.len());
                    let hint = "calibrate with at most fourteen (k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tx ty)";
                    return self.wrong(file, fact, hint);
                }
                opencv_distortion(terms)
            }
            Lens::Fisheye(terms) => {
                if terms.iter().skip(4).any(|&x| x != 0.0) {
                    let fact = format!("has {} distortion numbers for a fisheye", terms.len());
                    return self.wrong(file, fact, "a fisheye has k1 k2 k3 k4");
                }
                let mut radial = [0.0; 4];
                radial.iter_mut().zip(terms).for_each(|(to, from)| *to = *from);
                Distortion::Polynomial(PolynomialLens { fisheye: true, radial, ..PolynomialLens::default() })
            }
        };
        if !distortion.is_finite() {
            return self.wrong(file, "holds a non-finite number in its distortion".into(), CALIBRATE);
        }
        Ok(distortion)
    }
}

const CALIBRATE: &str = "calibrate the camera again or correct the number";

/// The smallest of OpenCV's models that has these terms.
fn opencv_distortion(terms: &[f64]) -> Distortion {
    let mut all = [0.0; 14];
    all.iter_mut().zip(terms).for_each(|(to, from)| *to = *from);
    let (plain, special) = all.split_at(8);
    if special.iter().any(|&term| term != 0.0) {
        return Distortion::Tilted(all);
    }
    match <[f64; 8]>::try_from(plain) {
        Ok(plain) if plain != [0.0; 8] => Distortion::BrownConrady(plain),
        _ => Distortion::None,
    }
}

/// The matrix K.
pub(crate) fn camera_matrix(fx: f64, fy: f64, cx: f64, cy: f64) -> [[f64; 3]; 3] {
    [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
}

/// The nearest rotation, if the rows are one within 1e-3 (Higham 1986, Newton's iteration for the polar factor).
pub(crate) fn rotation_from_rows(rows: &[[f64; 3]; 3]) -> Option<DMat3> {
    let mut r = DMat3::from_cols_array_2d(rows).transpose();
    let off = (r * r.transpose() - DMat3::IDENTITY).to_cols_array().iter().fold(0.0f64, |a, x| a.max(x.abs()));
    // `max` passes over what is not a number.
    if !r.is_finite() || off.is_nan() || off > 1e-3 || r.determinant() < 0.5 {
        return None;
    }
    if off < 1e-13 {
        return Some(r);
    }
    for _ in 0..4 {
        r = (r + r.inverse().transpose()) * 0.5;
    }
    Some(r)
}

/// The rotation by the angle |v| about v (Rodrigues), row major; not a number where v is not.
pub(crate) fn rows_from_rotation_vector(v: DVec3) -> [[f64; 3]; 3] {
    let (axis, angle) = (v.normalize_or_zero(), v.length());
    if !v.is_finite() || !angle.is_finite() {
        return [[f64::NAN; 3]; 3];
    }
    let r = if axis == DVec3::ZERO { DMat3::IDENTITY } else { DMat3::from_axis_angle(axis, angle) };
    r.transpose().to_cols_array_2d()
}

/// The rotation of a unit quaternion (w, x, y, z), row major; not a number where the quaternion is zero.
pub(crate) fn rows_from_quaternion([w, x, y, z]: [f64; 4]) -> [[f64; 3]; 3] {
    let n = (w * w + x * x + y * y + z * z).sqrt();
    let q = glam::DQuat::from_xyzw(x / n, y / n, z / n, w / n);
    if !q.is_finite() {
        return [[f64::NAN; 3]; 3];
    }
    DMat3::from_quat(q).transpose().to_cols_array_2d()
}

/// Nine numbers as rows.
pub(crate) fn rows_of(v: &[f64]) -> Option<[[f64; 3]; 3]> {
    let v: &[f64; 9] = v.try_into().ok()?;
    Some([[v[0], v[1], v[2]], [v[3], v[4], v[5]], [v[6], v[7], v[8]]])
}

/// Rotation rows and translation of a 3×4 or 4×4 matrix, row major.
pub(crate) fn pose_of(v: &[f64]) -> Option<([[f64; 3]; 3], [f64; 3])> {
    if v.len() != 12 && v.len() != 16 {
        return None;
    }
    Some(([[v[0], v[1], v[2]], [v[4], v[5], v[6]], [v[8], v[9], v[10]]], [v[3], v[7], v[11]]))
}

#[cfg(test)]
#[path = "parts_tests.rs"]
mod tests;
