//! Calibrated rigs from the formats people have; always millimetres, OpenCV axes, first pixel centre at (0.5, 0.5).
//!
//! | file | format |
//! |---|---|
//! | `*.json` | plain K/R/t (`plain_json`) |
//! | `*.toml` | our own (`own_toml`) |
//! | `*.yml`, `*.yaml`, `*.xml`, or a folder of them | OpenCV file storage (`opencv`) |
//! | a folder with `cameras.txt`/`.bin` and `images.txt`/`.bin` | COLMAP (`colmap_text`, `colmap_binary`) |

use std::path::Path;

use glam::{DMat3, DVec3};
use strandflow_core::{Camera, Distortion, Rig, RigidTransform};

use crate::{IoError, error::At};

pub mod colmap;
pub mod colmap_binary;
pub mod colmap_text;
pub mod opencv;
mod opencv_xml;
mod opencv_yaml;
pub mod own_toml;
pub mod plain_json;

/// A calibration, in millimetres and seconds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Calibration {
    /// The cameras, in the order of the file.
    pub rig: Rig,
    /// Gravity in the world \[mm/s²\], where the file has it.
    pub gravity: Option<DVec3>,
    /// Frames per second, where the file has it.
    pub fps: Option<f64>,
    /// What had to be assumed.
    pub notes: Vec<String>,
}

/// Reads a calibration of any known format. `unit_mm` is the length of one unit of the file in millimetres for formats
/// that do not say (COLMAP, OpenCV); `None` there is an error with a hint.
///
/// # Errors
/// The file cannot be read, its format is not known, or a camera is not sound (see [`CameraParts::build`]).
pub fn read_calibration(path: &Path, unit_mm: Option<f64>) -> Result<Calibration, IoError> {
    if let Err(cause) = std::fs::metadata(path) {
        return Err(IoError::reading(path)(cause));
    }
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    let calibration = if path.is_dir() {
        if path.join("images.bin").exists() || path.join("images.txt").exists() {
            colmap::read_colmap(path, unit_mm)?
        } else {
            opencv::read_opencv_folder(path, unit_mm)?
        }
    } else {
        match extension.as_str() {
            "json" => plain_json::read_plain_json(path)?,
            "toml" => own_toml::read_toml(path)?,
            "yml" | "yaml" | "xml" => opencv::read_opencv(path, unit_mm)?,
            "txt" | "bin" => colmap::read_colmap(path.parent().unwrap_or(Path::new(".")), unit_mm)?,
            _ => {
                return Err(IoError::content(
                    path,
                    At::FILE,
                    "is not a calibration of a known format",
                    "give a .json (K/R/t), .toml (ours), .yml/.xml (OpenCV) or a COLMAP folder with cameras and images",
                ));
            }
        }
    };
    check_names(path, &calibration.rig)?;
    Ok(calibration)
}

fn check_names(path: &Path, rig: &Rig) -> Result<(), IoError> {
    if rig.cameras.is_empty() {
        return Err(IoError::content(path, At::FILE, "holds no camera", "check that it is the right file"));
    }
    for (i, camera) in rig.cameras.iter().enumerate() {
        if rig.cameras[..i].iter().any(|other| other.name == camera.name) {
            let fact = "the camera is listed twice";
            return Err(IoError::content(path, At::view(&camera.name), fact, "give every camera a name of its own"));
        }
    }
    Ok(())
}

/// The cameras of the named views, in their order.
///
/// # Errors
/// A view has no camera.
pub fn rig_for_views(path: &Path, rig: &Rig, views: &[String]) -> Result<Rig, IoError> {
    let camera = |view: &String| {
        rig.view_named(view).map(|at| rig.cameras[at].clone()).ok_or_else(|| {
            let known: Vec<&str> = rig.cameras.iter().map(|camera| camera.name.as_str()).collect();
            IoError::content(
                path,
                At::view(view),
                "the view has no calibration",
                format!("add a camera named `{view}` or leave the view out; the calibration has {}", known.join(", ")),
            )
        })
    };
    Ok(Rig { cameras: views.iter().map(camera).collect::<Result<_, _>>()? })
}

/// A camera as files describe it, before it is checked.
#[derive(Clone, Debug, Default)]
pub struct CameraParts {
    /// View name.
    pub name: String,
    /// Image size \[px\].
    pub size: [usize; 2],
    /// The matrix K, row major.
    pub k: [[f64; 3]; 3],
    /// Distortion in OpenCV's order, 0 to 8 numbers (more only if they are zero).
    pub distortion: Vec<f64>,
    /// World to camera, row major.
    pub rotation: [[f64; 3]; 3],
    /// World to camera, in the file's unit.
    pub translation: [f64; 3],
    /// Millimetres per unit of the file.
    pub unit_mm: f64,
    /// Added to the principal point: 0.5 where the file's first pixel centre is (0, 0).
    pub pixel_shift: f64,
}

impl CameraParts {
    /// Checks and converts. A rotation off by less than 1e-3 (rounded text) is made orthonormal.
    ///
    /// # Errors
    /// Non-finite numbers, no image size, a focal length that is not positive, skew, unsupported distortion terms, a
    /// rotation that is none. All name the file and the camera.
    pub fn build(self, file: &Path) -> Result<Camera, IoError> {
        let wrong = |fact: String, hint: &str| Err(IoError::content(file, At::view(&self.name), fact, hint));
        let calibrate = "calibrate the camera again or correct the number";
        let k = self.k;
        let numbers = k.iter().chain(&self.rotation).flatten().chain(&self.translation).chain(&self.distortion);
        if let Some(bad) = numbers.copied().find(|x| !x.is_finite()) {
            return wrong(format!("holds the non-finite number {bad}"), calibrate);
        }
        if self.size.contains(&0) || self.size.iter().any(|&side| side > 100_000) {
            return wrong(
                format!("has the image size {} x {}", self.size[0], self.size[1]),
                "give width and height in pixels",
            );
        }
        if !(k[2][2].abs() > 1e-12 && k[0][0] / k[2][2] > 0.0 && k[1][1] / k[2][2] > 0.0) {
            return wrong(format!("has the focal lengths {} and {}", k[0][0], k[1][1]), calibrate);
        }
        if k[0][1].abs() > 1e-6 * k[0][0].abs() || k[1][0] != 0.0 || k[2][0] != 0.0 || k[2][1] != 0.0 {
            return wrong(
                "K has skew or is not a camera matrix".into(),
                "calibrate without skew: K = [fx 0 cx; 0 fy cy; 0 0 1]",
            );
        }
        if self.distortion.iter().skip(8).any(|&x| x != 0.0) {
            let fact = format!("has {} distortion numbers", self.distortion.len());
            return wrong(fact, "calibrate with at most eight (k1 k2 p1 p2 k3 k4 k5 k6): no thin prism, no tilt");
        }
        let Some(rotation) = rotation_from_rows(&self.rotation) else {
            return wrong(
                "R is not a rotation (orthonormal, determinant +1)".into(),
                "check R and its row/column order",
            );
        };
        let mut terms = [0.0; 8];
        terms.iter_mut().zip(&self.distortion).for_each(|(to, from)| *to = *from);
        let distortion = if terms == [0.0; 8] { Distortion::None } else { Distortion::BrownConrady(terms) };
        let scale = k[2][2];
        Ok(Camera {
            name: self.name,
            width: self.size[0],
            height: self.size[1],
            focal: [k[0][0] / scale, k[1][1] / scale],
            principal: [k[0][2] / scale + self.pixel_shift, k[1][2] / scale + self.pixel_shift],
            distortion,
            camera_from_world: RigidTransform { rotation, translation: DVec3::from(self.translation) * self.unit_mm },
        })
    }
}

/// The nearest rotation, if the rows are one within 1e-3 (Higham 1986, Newton's iteration for the polar factor).
pub fn rotation_from_rows(rows: &[[f64; 3]; 3]) -> Option<DMat3> {
    let mut r = DMat3::from_cols_array_2d(rows).transpose();
    let off = (r * r.transpose() - DMat3::IDENTITY).to_cols_array().iter().fold(0.0f64, |a, x| a.max(x.abs()));
    if off.is_nan() || off > 1e-3 || r.determinant() < 0.5 {
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

/// The rotation by the angle |v| about v (Rodrigues), row major.
pub fn rows_from_rotation_vector(v: DVec3) -> [[f64; 3]; 3] {
    let r = if v.length() < 1e-300 { DMat3::IDENTITY } else { DMat3::from_axis_angle(v.normalize(), v.length()) };
    r.transpose().to_cols_array_2d()
}

/// The rotation of a unit quaternion (w, x, y, z), row major; not a number where the quaternion is zero.
pub fn rows_from_quaternion([w, x, y, z]: [f64; 4]) -> [[f64; 3]; 3] {
    let n = (w * w + x * x + y * y + z * z).sqrt();
    let q = glam::DQuat::from_xyzw(x / n, y / n, z / n, w / n);
    if !q.is_finite() {
        return [[f64::NAN; 3]; 3];
    }
    DMat3::from_quat(q).transpose().to_cols_array_2d()
}

/// Millimetres per named unit.
pub(crate) fn unit_from_name(file: &Path, name: &str) -> Result<f64, IoError> {
    match name.trim().to_ascii_lowercase().as_str() {
        "m" | "metre" | "metres" | "meter" | "meters" => Ok(1000.0),
        "cm" | "centimetre" | "centimetres" | "centimeter" | "centimeters" => Ok(10.0),
        "mm" | "millimetre" | "millimetres" | "millimeter" | "millimeters" => Ok(1.0),
        other => Err(IoError::content(
            file,
            At::FILE,
            format!("the unit `{other}` is not known"),
            "write metres, centimetres or millimetres",
        )),
    }
}

/// What to add to image coordinates so that the first pixel's centre is (0.5, 0.5), from a convention in words.
pub(crate) fn pixel_shift(file: &Path, convention: Option<&str>) -> Result<f64, IoError> {
    let Some(text) = convention else { return Ok(0.0) };
    let plain: String = text.to_ascii_lowercase().replace(' ', "");
    if plain.contains("0.5") {
        return Ok(0.0);
    }
    if (plain.contains("centre") || plain.contains("center")) && (plain.contains("(0,0)") || plain.contains("[0,0]")) {
        return Ok(0.5);
    }
    if plain.contains("corner") {
        return Ok(0.0);
    }
    Err(IoError::content(
        file,
        At::FILE,
        format!("the pixel convention `{text}` is not understood"),
        "write \"first pixel centre at (0.5, 0.5)\" or \"first pixel centre at (0, 0)\"",
    ))
}

/// The unit of a format that has none.
pub(crate) fn required_unit(file: &Path, unit_mm: Option<f64>) -> Result<f64, IoError> {
    match unit_mm {
        Some(unit) if unit.is_finite() && unit > 0.0 => Ok(unit),
        Some(unit) => Err(IoError::content(
            file,
            At::FILE,
            format!("{unit} mm is not a length of a unit"),
            "give the length of one unit of the calibration in millimetres (1000 for metres)",
        )),
        None => Err(IoError::content(
            file,
            At::FILE,
            "the format does not say its unit of length",
            "give the length of one unit of the calibration in millimetres (`unit_mm`; 1000 for metres, 1 for mm)",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parts() -> CameraParts {
        CameraParts {
            name: "camA".into(),
            size: [640, 480],
            k: [[1400.0, 0.0, 320.0], [0.0, 1410.0, 240.0], [0.0, 0.0, 1.0]],
            distortion: vec![],
            rotation: rows_from_rotation_vector(DVec3::new(0.1, 0.2, 0.3)),
            translation: [0.1, 0.2, 1.5],
            unit_mm: 1000.0,
            pixel_shift: 0.5,
        }
    }

    #[test]
    fn units_and_pixels_are_converted() {
        let camera = parts().build(Path::new("c")).unwrap();
        assert_eq!(camera.principal, [320.5, 240.5]);
        assert!((camera.camera_from_world.translation - DVec3::new(100.0, 200.0, 1500.0)).length() < 1e-9);
        assert_eq!(camera.distortion, Distortion::None);
    }

    #[test]
    fn unsound_cameras_are_named() {
        type Damage = fn(&mut CameraParts);
        let broken: [(&str, Damage); 7] = [
            ("non-finite", |p| p.translation[1] = f64::NAN),
            ("image size", |p| p.size[0] = 0),
            ("focal", |p| p.k[1][1] = -3.0),
            ("skew", |p| p.k[0][1] = 3.0),
            ("not a rotation", |p| p.rotation[0][0] += 0.05),
            ("not a rotation", |p| p.rotation[0] = p.rotation[0].map(|x| -x)),
            ("distortion", |p| p.distortion = vec![0.1; 12]),
        ];
        for (fact, damage) in broken {
            let mut p = parts();
            damage(&mut p);
            let error = p.build(Path::new("rig.json")).unwrap_err();
            let text = error.to_string();
            assert!(text.contains(fact) && text.contains("rig.json") && text.contains("camA"), "{text}");
            assert!(!error.hint().is_empty());
        }
    }

    #[test]
    fn rounded_rotations_become_exact() {
        let mut p = parts();
        p.rotation.iter_mut().flatten().for_each(|x| *x = (*x * 1e5).round() / 1e5);
        let r = p.build(Path::new("c")).unwrap().camera_from_world.rotation;
        assert!((r * r.transpose() - DMat3::IDENTITY).to_cols_array().iter().all(|x| x.abs() < 1e-14));
    }

    #[test]
    fn pixel_conventions_in_words() {
        let shift = |text| pixel_shift(Path::new("c"), Some(text)).ok();
        assert_eq!(shift("top-left image corner is (0,0); the centre of the first pixel is (0.5,0.5)"), Some(0.0));
        assert_eq!(shift("the center of the first pixel is (0, 0)"), Some(0.5));
        assert_eq!(shift("whatever"), None);
    }
}
