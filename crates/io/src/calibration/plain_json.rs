//! Plain K/R/t JSON: `{"units": "metres", "cameras": [{"name", "width", "height", "K", "distortion", "R", "t"}]}`.
//!
//! Optional: `convention` (names OpenCV's or OpenGL's camera axes), `pixel_convention`, `gravity_world` \[unit/s²\], `fps`.

use std::path::Path;

use glam::DVec3;
use serde::Deserialize;
use strandflow_core::Rig;

use super::{Calibration, CameraParts, pixel_shift, unit_from_name};
use crate::{
    IoError,
    error::{At, not_json, read_text},
};

#[derive(Deserialize)]
struct RigFile {
    #[serde(default)]
    units: Option<String>,
    #[serde(default)]
    convention: Option<String>,
    #[serde(default)]
    pixel_convention: Option<String>,
    #[serde(default)]
    gravity_world: Option<[f64; 3]>,
    #[serde(default)]
    fps: Option<f64>,
    cameras: Vec<CameraEntry>,
}

#[derive(Deserialize)]
struct CameraEntry {
    name: String,
    width: usize,
    height: usize,
    #[serde(alias = "k", alias = "intrinsics")]
    #[serde(rename = "K")]
    k: [[f64; 3]; 3],
    #[serde(default, alias = "dist", alias = "distCoeffs")]
    distortion: Vec<f64>,
    #[serde(rename = "R", alias = "rotation")]
    r: [[f64; 3]; 3],
    #[serde(alias = "T", alias = "translation")]
    t: [f64; 3],
}

/// Reads a plain K/R/t JSON file.
///
/// # Errors
/// The file cannot be read, is not of this form (with the line), does not name its unit, or a camera is not sound.
pub fn read_plain_json(path: &Path) -> Result<Calibration, IoError> {
    plain_json_from_text(path, &read_text(path)?)
}

fn plain_json_from_text(path: &Path, text: &str) -> Result<Calibration, IoError> {
    let file: RigFile = serde_json::from_str(text).map_err(|cause| {
        let hint = "every camera needs name, width, height, K (3x3), R (3x3), t (3) and optionally distortion";
        not_json(path, text, &cause, "a calibration", hint)
    })?;
    let Some(units) = file.units else {
        let hint = "add \"units\": \"metres\" (or millimetres) beside \"cameras\"";
        return Err(IoError::content(path, At::FILE, "does not name its unit of length", hint));
    };
    let unit_mm = unit_from_name(path, &units)?;
    let shift = pixel_shift(path, file.pixel_convention.as_deref())?;
    let mut notes = Vec::new();
    if file.pixel_convention.is_none() {
        notes.push("no pixel_convention: the first pixel's centre is taken to be (0.5, 0.5)".to_owned());
    }
    let flip = axes_are_opengl(path, file.convention.as_deref(), &mut notes)?;
    let mut cameras = Vec::new();
    for entry in file.cameras {
        let (mut rotation, mut translation) = (entry.r, entry.t);
        if flip {
            for row in 1..3 {
                rotation[row] = rotation[row].map(|x| -x);
                translation[row] = -translation[row];
            }
        }
        let parts = CameraParts {
            name: entry.name,
            size: [entry.width, entry.height],
            k: entry.k,
            distortion: entry.distortion,
            rotation,
            translation,
            unit_mm,
            pixel_shift: shift,
        };
        cameras.push(parts.build(path)?);
    }
    let gravity = file.gravity_world.map(|g| DVec3::from(g) * unit_mm);
    check_numbers(path, gravity, file.fps)?;
    Ok(Calibration { rig: Rig { cameras }, gravity, fps: file.fps, notes })
}

/// Gravity must be a direction, the frame rate positive.
pub(super) fn check_numbers(path: &Path, gravity: Option<DVec3>, fps: Option<f64>) -> Result<(), IoError> {
    if let Some(g) = gravity.filter(|g| !g.is_finite() || g.length() < 1e-9) {
        let fact = format!("gravity {g} mm/s² is no direction");
        return Err(IoError::content(
            path,
            At::FILE,
            fact,
            "give gravity in the world, for example [0, 0, -9.81] m/s²",
        ));
    }
    if let Some(fps) = fps.filter(|fps| !fps.is_finite() || *fps <= 0.0) {
        let fact = format!("{fps} frames per second is no frame rate");
        return Err(IoError::content(path, At::FILE, fact, "give the frame rate of the videos"));
    }
    Ok(())
}

fn axes_are_opengl(path: &Path, convention: Option<&str>, notes: &mut Vec<String>) -> Result<bool, IoError> {
    let Some(text) = convention else {
        notes.push("no convention: R and t are taken as world to camera with OpenCV axes".into());
        return Ok(false);
    };
    let plain = text.to_ascii_lowercase();
    if ["camera to world", "camera-to-world", "cam2world", "c2w"].iter().any(|words| plain.contains(words)) {
        return Err(IoError::content(
            path,
            At::FILE,
            format!("the convention `{text}` is camera to world"),
            "invert the poses: x_cam = R x_world + t",
        ));
    }
    if plain.contains("opengl") || plain.contains("blender") {
        return Ok(true);
    }
    if !plain.contains("opencv") && !plain.contains("x_cam") {
        notes.push(format!("convention `{text}` is taken as world to camera with OpenCV axes"));
    }
    Ok(false)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const GOOD: &str = include_str!("../../tests/data/rig.json");

    #[test]
    fn metres_become_millimetres_and_gravity_is_kept() {
        let calibration = plain_json_from_text(Path::new("c.json"), GOOD).unwrap();
        assert_eq!(calibration.rig.view_count(), 2);
        assert_eq!(calibration.gravity, Some(DVec3::new(0.0, 0.0, -9810.0)));
        assert_eq!(calibration.fps, Some(100.0));
        assert!(calibration.rig.cameras[0].camera_from_world.translation.z > 1000.0);
        assert!(calibration.notes.is_empty());
    }

    #[test]
    fn a_file_without_units_or_with_holes_is_an_error() {
        let text = GOOD.replace("\"units\"", "\"unit\"");
        assert!(plain_json_from_text(Path::new("c"), &text).unwrap_err().hint().contains("units"));
        let text = GOOD.replacen("\"R\"", "\"Q\"", 1);
        assert!(plain_json_from_text(Path::new("c.json"), &text).unwrap_err().to_string().starts_with("c.json:"));
    }

    #[test]
    fn opengl_axes_are_turned() {
        let cv = plain_json_from_text(Path::new("c"), GOOD).unwrap().rig.cameras.remove(0);
        let gl = plain_json_from_text(Path::new("c"), &GOOD.replace("OpenCV", "OpenGL")).unwrap().rig.cameras.remove(0);
        let p = DVec3::new(30.0, 40.0, 50.0);
        let (a, b) = (cv.camera_from_world.point(p), gl.camera_from_world.point(p));
        assert!((a - DVec3::new(b.x, -b.y, -b.z)).length() < 1e-9);
    }

    proptest! {
        #[test]
        fn cut_and_changed_text_is_safe(cut in 0usize..3000, at in 0usize..3000, byte in 32u8..127) {
            let mut text = GOOD.as_bytes().to_vec();
            let n = text.len();
            text[at % n] = byte;
            text.truncate(cut);
            let _ = plain_json_from_text(Path::new("c"), &String::from_utf8_lossy(&text));
        }
    }
}
