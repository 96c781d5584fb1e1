//! Our own calibration: the vocabulary's `Rig` as TOML, with gravity and frame rate. Always millimetres.

use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use strandflow_core::{Camera, Distortion, Rig};

use super::{Calibration, CameraParts, plain_json::check_numbers};
use crate::{
    IoError,
    error::{At, read_text},
};

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
    rotation: [[f64; 3]; 3],
    translation: [f64; 3],
}

/// Reads our TOML calibration.
///
/// # Errors
/// The file cannot be read, is not of this form (with the line), or a camera is not sound.
pub fn read_toml(path: &Path) -> Result<Calibration, IoError> {
    toml_from_text(path, &read_text(path)?)
}

fn toml_from_text(path: &Path, text: &str) -> Result<Calibration, IoError> {
    let file: RigFile = toml::from_str(text).map_err(|cause| {
        let line = cause.span().map(|span| text[..span.start.min(text.len())].matches('\n').count() + 1);
        IoError::content(
            path,
            At { line, ..At::FILE },
            format!("is not a calibration: {}", cause.message()),
            "every camera needs name, width, height, focal, principal, rotation and translation",
        )
    })?;
    let unit_mm = super::unit_from_name(path, &file.units)?;
    let pixel_shift = super::pixel_shift(path, Some(&file.pixel_convention))?;
    let camera = |entry: CameraEntry| {
        let ([fx, fy], [cx, cy]) = (entry.focal, entry.principal);
        CameraParts {
            name: entry.name,
            size: [entry.width, entry.height],
            k: [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]],
            distortion: entry.distortion,
            rotation: entry.rotation,
            translation: entry.translation,
            unit_mm,
            pixel_shift,
        }
        .build(path)
    };
    let cameras = file.cameras.into_iter().map(camera).collect::<Result<_, _>>()?;
    let gravity = file.gravity.map(|g| DVec3::from(g) * unit_mm);
    check_numbers(path, gravity, file.fps)?;
    Ok(Calibration { rig: Rig { cameras }, gravity, fps: file.fps, notes: Vec::new() })
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
            Distortion::None => Vec::new(),
            Distortion::BrownConrady(terms) => terms.to_vec(),
        },
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
    use proptest::prelude::*;

    fn calibration() -> Calibration {
        let parts = CameraParts {
            name: "back".into(),
            size: [640, 480],
            k: [[1400.1, 0.0, 320.3], [0.0, 1410.7, 240.9], [0.0, 0.0, 1.0]],
            distortion: vec![-0.2, 0.1, 1e-3, 2e-3, 0.01],
            rotation: crate::calibration::rows_from_rotation_vector(DVec3::new(0.1, 0.2, 0.3)),
            translation: [0.1, 0.2, 1.5],
            unit_mm: 1000.0,
            pixel_shift: 0.0,
        };
        let rig = Rig { cameras: vec![parts.build(Path::new("c")).unwrap()] };
        Calibration { rig, gravity: Some(DVec3::new(0.0, -9810.0, 0.1)), fps: Some(59.94), notes: vec![] }
    }

    #[test]
    fn numbers_come_back_exactly() {
        let text = toml_text(&calibration());
        assert_eq!(toml_from_text(Path::new("c.toml"), &text).unwrap(), calibration());
    }

    #[test]
    fn mistakes_name_the_line() {
        let text = toml_text(&calibration()).replace("focal", "focus");
        let error = toml_from_text(Path::new("c.toml"), &text).unwrap_err().to_string();
        assert!(error.starts_with("c.toml:") && error.contains("focus"), "{error}");
    }

    proptest! {
        #[test]
        fn cut_and_changed_text_is_safe(cut in 0usize..900, at in 0usize..900, byte in 32u8..127) {
            let mut text = toml_text(&calibration()).into_bytes();
            let n = text.len();
            text[at % n] = byte;
            text.truncate(cut);
            let _ = toml_from_text(Path::new("c"), &String::from_utf8_lossy(&text));
        }
    }
}
