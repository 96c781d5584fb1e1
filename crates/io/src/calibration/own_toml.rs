//! Our own calibration: the vocabulary's `Rig` as TOML, with gravity and frame rate. Always millimetres.

use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use strandflow_core::{Camera, Distortion};

use super::{
    Calibration,
    convention::{Unit, unit_from_name},
    parts::{CameraParts, Lens, camera_matrix},
    settle::Described,
};
use crate::{IoError, error::At};

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RigFile {
    units: String,
    pixel_convention: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    fps: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    gravity: Option<[f64; 3]>,
    cameras: Vec<CameraEntry>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraEntry {
    name: String,
    width: usize,
    height: usize,
    focal: [f64; 2],
    principal: [f64; 2],
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    distortion: Vec<f64>,
    /// Lenses that are not OpenCV's of eight terms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    lens: Option<Distortion>,
    rotation: [[f64; 3]; 3],
    translation: [f64; 3],
}

/// What our TOML says.
pub(super) fn described(path: &Path, text: &str) -> Result<Described, IoError> {
    let file: RigFile = toml::from_str(text).map_err(|cause| {
        let line = cause.span().map(|span| text[..span.start.min(text.len())].matches('\n').count() + 1);
        IoError::content(
            path,
            At { line, ..At::FILE },
            format!("is not a calibration: {}", cause.message()),
            "every camera needs name, width, height, focal, principal, rotation and translation",
        )
    })?;
    let unit = Unit::Stated(unit_from_name(path, &file.units)?);
    let first_pixel = 0.5 - super::pixel_shift(path, Some(&file.pixel_convention))?;
    let camera = |entry: CameraEntry| CameraParts {
        name: entry.name,
        size: Some([entry.width, entry.height]),
        k: camera_matrix(entry.focal[0], entry.focal[1], entry.principal[0], entry.principal[1]),
        lens: entry.lens.map_or(Lens::OpenCv(entry.distortion), Lens::Known),
        rotation: entry.rotation,
        translation: entry.translation,
    };
    let cameras = file.cameras.into_iter().map(camera).collect();
    let described = Described::opencv("our own", cameras, unit, first_pixel);
    Ok(Described { gravity: file.gravity.map(DVec3::from), fps: file.fps, ..described })
}

/// The text of our TOML calibration; numbers come back exactly. Notes are not kept.
pub fn toml_text(calibration: &Calibration) -> String {
    let file = RigFile {
        units: "millimetres".into(),
        pixel_convention: "first pixel centre at (0.5, 0.5)".into(),
        fps: calibration.fps,
        gravity: calibration.gravity.map(|g| g.to_array()),
        cameras: calibration.rig.cameras.iter().map(entry_of).collect(),
    };
    // Serialising plain numbers and strings into a string cannot fail.
    toml::to_string(&file).unwrap_or_default()
}

fn entry_of(camera: &Camera) -> CameraEntry {
    CameraEntry {
        name: camera.name.clone(),
        width: camera.width,
        height: camera.height,
        focal: camera.focal,
        principal: camera.principal,
        distortion: match camera.distortion {
            Distortion::BrownConrady(terms) => terms.to_vec(),
            _ => Vec::new(),
        },
        lens: Some(camera.distortion).filter(|lens| !matches!(lens, Distortion::None | Distortion::BrownConrady(_))),
        rotation: camera.camera_from_world.rotation.transpose().to_cols_array_2d(),
        translation: camera.camera_from_world.translation.to_array(),
    }
}

/// Writes our TOML calibration.
///
/// # Errors
/// The file cannot be written.
pub fn write_toml(path: &Path, calibration: &Calibration) -> Result<(), IoError> {
    std::fs::write(path, toml_text(calibration)).map_err(IoError::writing(path))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{ReadOptions, settle::settle};
    use strandflow_core::{PolynomialLens, Rig, RigidTransform};

    fn calibration() -> Calibration {
        let rotation = glam::DMat3::from_rotation_x(0.1) * glam::DMat3::from_rotation_y(0.2);
        let camera = |(name, distortion): (&str, Distortion)| Camera {
            name: name.into(),
            width: 640,
            height: 480,
            focal: [1400.1, 1410.7],
            principal: [320.3, 240.9],
            distortion,
            camera_from_world: RigidTransform { rotation, translation: DVec3::new(100.0, 200.0, 1500.1) },
        };
        let lenses = [
            ("straight", Distortion::None),
            ("back", Distortion::BrownConrady([-0.2, 0.1, 1e-3, 2e-3, 0.01, 0.0, 0.0, 0.0])),
            ("tilted", Distortion::Tilted([0.01; 14])),
            ("wide", Distortion::Fov(0.9)),
            ("fish", Distortion::Polynomial(PolynomialLens { fisheye: true, radial: [0.1; 4], ..Default::default() })),
        ];
        let rig = Rig { cameras: lenses.map(camera).into() };
        Calibration { rig, gravity: Some(DVec3::new(0.0, -9810.0, 0.1)), fps: Some(59.94), ..Calibration::default() }
    }

    fn read(text: &str) -> Result<Calibration, IoError> {
        let path = Path::new("c.toml");
        settle(path, described(path, text)?, &ReadOptions::default())
    }

    #[test]
    fn numbers_come_back_exactly() {
        let written = toml_text(&calibration());
        let back = read(&written).unwrap();
        assert_eq!((back.gravity, back.fps, back.notes.len()), (calibration().gravity, Some(59.94), 0));
        for (camera, expected) in back.rig.cameras.iter().zip(calibration().rig.cameras) {
            let pose = camera.camera_from_world;
            assert!(
                (pose.rotation - expected.camera_from_world.rotation).to_cols_array().iter().all(|x| x.abs() < 1e-15)
            );
            assert_eq!(*camera, Camera { camera_from_world: pose, ..expected });
        }
        assert_eq!(toml_text(&read(&toml_text(&back)).unwrap()), toml_text(&back));
    }

    #[test]
    fn mistakes_name_the_line() {
        let text = toml_text(&calibration()).replace("focal", "focus");
        let error = read(&text).unwrap_err().to_string();
        assert!(error.starts_with("c.toml:") && error.contains("focus"), "{error}");
    }
}
