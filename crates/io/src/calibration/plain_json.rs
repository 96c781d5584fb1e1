//! Plain K/R/t JSON: `{"units": "metres", "cameras": [{"name", "width", "height", "K", "distortion", "R", "t"}]}`.
//!
//! Optional: `convention` (names OpenCV's or OpenGL's camera axes), `pixel_convention`, `gravity_world` \[unit/s²\], `fps`.

use std::path::Path;

use glam::DVec3;
use serde::Deserialize;

use super::{
    convention::{Axes, Pose, Unit, unit_from_name},
    parts::{CameraParts, Lens},
    pixel_shift,
    settle::Described,
};
use crate::{
    IoError,
    error::{At, not_json},
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
    #[serde(default)]
    width: Option<usize>,
    #[serde(default)]
    height: Option<usize>,
    #[serde(alias = "k", alias = "intrinsics")]
    #[serde(rename = "K")]
    k: [[f64; 3]; 3],
    #[serde(default, alias = "dist", alias = "distCoeffs")]
    distortion: Vec<f64>,
    /// "fisheye": distortion is OpenCV's fisheye.
    #[serde(default, alias = "camera_model", alias = "distortion_model")]
    model: Option<String>,
    #[serde(rename = "R", alias = "rotation")]
    r: [[f64; 3]; 3],
    #[serde(alias = "T", alias = "translation")]
    t: [f64; 3],
}

/// What a plain K/R/t JSON file says.
pub(super) fn described(path: &Path, text: &str) -> Result<Described, IoError> {
    let file: RigFile = serde_json::from_str(text).map_err(|cause| {
        let hint = "every camera needs name, width, height, K (3x3), R (3x3), t (3) and optionally distortion";
        not_json(path, text, &cause, "a calibration", hint)
    })?;
    let Some(units) = file.units else {
        let hint = "add \"units\": \"metres\" (or millimetres) beside \"cameras\"";
        return Err(IoError::content(path, At::FILE, "does not name its unit of length", hint));
    };
    let unit = Unit::Stated(unit_from_name(path, &units)?);
    let shift = pixel_shift(path, file.pixel_convention.as_deref())?;
    let mut notes = Vec::new();
    if file.pixel_convention.is_none() {
        notes.push("no pixel_convention: the first pixel's centre is taken to be (0.5, 0.5)".to_owned());
    }
    let (pose, axes) = convention_in_words(file.convention.as_deref(), &mut notes);
    let cameras = file.cameras.into_iter().map(parts).collect();
    Ok(Described {
        pose,
        axes,
        fallback: Some((Pose::WorldToCamera, Axes::OpenCv)),
        gravity: file.gravity_world.map(DVec3::from),
        fps: file.fps,
        notes,
        ..Described::opencv("K/R/t", cameras, unit, 0.5 - shift)
    })
}

fn parts(entry: CameraEntry) -> CameraParts {
    let is_fisheye = entry.model.is_some_and(|model| {
        let model = model.to_ascii_lowercase();
        model.contains("fisheye") || model.contains("equidistant")
    });
    CameraParts {
        name: entry.name,
        size: entry.width.zip(entry.height).map(|(width, height)| [width, height]),
        k: entry.k,
        lens: if is_fisheye { Lens::Fisheye(entry.distortion) } else { Lens::OpenCv(entry.distortion) },
        rotation: entry.r,
        translation: entry.t,
    }
}

fn convention_in_words(convention: Option<&str>, notes: &mut Vec<String>) -> (Option<Pose>, Option<Axes>) {
    let Some(text) = convention else { return (None, None) };
    let plain = text.to_ascii_lowercase();
    let says = |words: &[&str]| words.iter().any(|word| plain.contains(word));
    let pose = if says(&["camera to world", "camera-to-world", "cam2world", "c2w"]) {
        Pose::CameraToWorld
    } else {
        Pose::WorldToCamera
    };
    let axes = if says(&["opengl", "blender"]) { Axes::OpenGl } else { Axes::OpenCv };
    if pose == Pose::WorldToCamera && axes == Axes::OpenCv && !says(&["opencv", "x_cam"]) {
        notes.push(format!("convention `{text}` is taken as world to camera with OpenCV axes"));
    }
    (Some(pose), Some(axes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{Calibration, ReadOptions, settle::settle};

    const GOOD: &str = include_str!("../../tests/data/rig.json");

    fn read(text: &str) -> Result<Calibration, IoError> {
        let path = Path::new("c.json");
        settle(path, described(path, text)?, &ReadOptions::default())
    }

    #[test]
    fn metres_become_millimetres_and_gravity_is_kept() {
        let calibration = read(GOOD).unwrap();
        assert_eq!(calibration.rig.view_count(), 2);
        assert_eq!(calibration.gravity, Some(DVec3::new(0.0, 0.0, -9810.0)));
        assert_eq!(calibration.fps, Some(100.0));
        assert!(calibration.rig.cameras[0].camera_from_world.translation.z > 1000.0);
        assert!(calibration.notes.is_empty(), "{:?}", calibration.notes);
    }

    #[test]
    fn a_file_without_units_or_with_holes_is_an_error() {
        let text = GOOD.replace("\"units\"", "\"unit\"");
        assert!(read(&text).unwrap_err().hint().contains("units"));
        let text = GOOD.replacen("\"R\"", "\"Q\"", 1);
        assert!(read(&text).unwrap_err().to_string().starts_with("c.json:"));
    }

    #[test]
    fn opengl_axes_and_poses_of_cameras_are_turned() {
        let camera = |text: &str| read(text).unwrap().rig.cameras.remove(0).camera_from_world;
        let (cv, gl) = (camera(GOOD), camera(&GOOD.replace("OpenCV", "OpenGL")));
        let p = DVec3::new(30.0, 40.0, 50.0);
        assert!((cv.point(p) - gl.point(p) * DVec3::new(1.0, -1.0, -1.0)).length() < 1e-9);
        let c2w = camera(&GOOD.replace("OpenCV: x_cam = R x_world + t", "OpenCV camera to world"));
        assert!((cv.point(c2w.point(p)) - p).length() < 1e-9);
    }
}
