//! OpenCV file storage (YAML or XML): K, distortion, and R or a rotation vector with T, one file a camera or several.
//!
//! OpenCV's first pixel centre is (0, 0): half a pixel is added to principal points. Names that are understood, each also
//! with a suffix that tells cameras of one file apart (`K_cam00`, `R_cam00`, …) or inside a node per camera:
//! K: `K`, `camera_matrix`, `cameraMatrix`, `M`, `intrinsic`; distortion: `D`, `dist`, `distortion_coefficients`, …;
//! rotation: `R`, `rvec`; translation: `T`, `t`, `tvec`; size: `image_width`/`image_height`, `image_size`.

use std::path::{Path, PathBuf};

use glam::DVec3;
use strandflow_core::{Camera, Rig};

use super::{Calibration, CameraParts, opencv_xml, opencv_yaml, required_unit, rows_from_rotation_vector};
use crate::{
    IoError,
    error::{At, read_text},
};

/// A node of OpenCV's file storage.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Node {
    Map(Vec<(String, Node)>),
    Numbers(Vec<f64>),
    Text(String),
}

const K: &[&str] = &["camera_matrix", "cameraMatrix", "CameraMatrix", "intrinsic", "K", "M"];
const DISTORTION: &[&str] =
    &["distortion_coefficients", "distCoeffs", "dist_coeffs", "DistortionCoefficients", "distortion", "dist", "D"];
const ROTATION: &[&str] = &["rotation_matrix", "rotation_vector", "rotation", "Rotation", "rvec", "R"];
const TRANSLATION: &[&str] = &["translation_vector", "translation", "Translation", "tvec", "T", "t"];
const WIDTH: &[&str] = &["image_width", "imageWidth", "width"];
const HEIGHT: &[&str] = &["image_height", "imageHeight", "height"];
const SIZE: &[&str] = &["image_size", "imageSize", "ImageSize", "size"];
const NAME: &[&str] = &["camera_name", "cameraName", "name"];

/// Reads one OpenCV file with one or more cameras; a single camera without a name takes the file's.
///
/// # Errors
/// The file cannot be read or is not OpenCV's (with the line), a camera lacks a part, the unit is not given, or a camera
/// is not sound.
pub fn read_opencv(path: &Path, unit_mm: Option<f64>) -> Result<Calibration, IoError> {
    let text = read_text(path)?;
    let is_xml = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("xml"));
    let parsed = if is_xml { opencv_xml::parse(&text) } else { opencv_yaml::parse(&text) };
    let root = parsed.map_err(|(line, fact)| {
        IoError::content(path, At::line(line), fact, "write the file with OpenCV's FileStorage")
    })?;
    let cameras = cameras_of(path, &root, required_unit(path, unit_mm)?)?;
    let notes = vec!["OpenCV: first pixel centre (0, 0) moved to (0.5, 0.5)".to_owned()];
    Ok(Calibration { rig: Rig { cameras }, gravity: None, fps: None, notes })
}

/// Reads a folder of OpenCV files, one a camera, by name.
///
/// # Errors
/// As `read_opencv`; or the folder has no such file.
pub fn read_opencv_folder(folder: &Path, unit_mm: Option<f64>) -> Result<Calibration, IoError> {
    let mut files: Vec<PathBuf> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(IoError::reading(folder))? {
        let path = entry.map_err(IoError::reading(folder))?.path();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        if ["yml", "yaml", "xml"].contains(&extension.as_str()) {
            files.push(path);
        }
    }
    files.sort();
    if files.is_empty() {
        return Err(IoError::content(
            folder,
            At::FILE,
            "is a folder without a calibration",
            "give a folder with COLMAP's cameras and images, or with one OpenCV .yml or .xml a camera",
        ));
    }
    let mut all = Calibration::default();
    for file in files {
        let one = read_opencv(&file, unit_mm)?;
        all.rig.cameras.extend(one.rig.cameras);
        all.notes = one.notes;
    }
    Ok(all)
}

fn cameras_of(path: &Path, root: &Node, unit_mm: f64) -> Result<Vec<Camera>, IoError> {
    let Node::Map(entries) = root else { return Err(no_camera(path)) };
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    if find(entries, K, "").is_some() {
        return Ok(vec![camera_of(path, &stem, entries, "", unit_mm)?]);
    }
    let mut cameras = Vec::new();
    for (key, node) in entries {
        match node {
            // A node a camera, or a node that holds such nodes.
            Node::Map(inner) if find(inner, K, "").is_some() => {
                cameras.push(camera_of(path, key, inner, "", unit_mm)?);
            }
            Node::Map(inner) => {
                for (key, node) in inner {
                    if let Node::Map(innermost) = node
                        && find(innermost, K, "").is_some()
                    {
                        cameras.push(camera_of(path, key, innermost, "", unit_mm)?);
                    }
                }
            }
            // A suffix a camera.
            _ => {
                let suffix = K.iter().find_map(|alias| key.strip_prefix(alias)).filter(|suffix| !suffix.is_empty());
                if let Some(suffix) = suffix
                    && let Node::Numbers(numbers) = node
                    && numbers.len() == 9
                {
                    let name = suffix.trim_start_matches('_');
                    cameras.push(camera_of(path, name, entries, suffix, unit_mm)?);
                }
            }
        }
    }
    if cameras.is_empty() { Err(no_camera(path)) } else { Ok(cameras) }
}

fn no_camera(path: &Path) -> IoError {
    IoError::content(
        path,
        At::FILE,
        "holds no camera matrix",
        "name it K or camera_matrix, one node or suffix a camera",
    )
}

fn find<'a>(entries: &'a [(String, Node)], aliases: &[&str], suffix: &str) -> Option<&'a Node> {
    let key = |alias: &&str| entries.iter().find(|(key, _)| key.strip_prefix(*alias) == Some(suffix));
    aliases.iter().find_map(key).map(|(_, node)| node)
}

fn camera_of(path: &Path, name: &str, map: &[(String, Node)], suffix: &str, unit: f64) -> Result<Camera, IoError> {
    let name = match find(map, NAME, suffix) {
        Some(Node::Text(text)) => text.clone(),
        _ => name.to_owned(),
    };
    let missing = |what: &str, hint: &str| IoError::content(path, At::view(&name), format!("has no {what}"), hint);
    let numbers = |aliases: &[&str], suffix: &str| match find(map, aliases, suffix) {
        Some(Node::Numbers(values)) => Some(values.clone()),
        _ => None,
    };
    let either = |aliases: &[&str]| numbers(aliases, suffix).or_else(|| numbers(aliases, ""));
    let k = numbers(K, suffix).and_then(|v| rows(&v)).ok_or_else(|| missing("3x3 camera matrix", "name it K"))?;
    let size = match (either(SIZE), either(WIDTH), either(HEIGHT)) {
        (Some(size), _, _) if size.len() == 2 => [size[0], size[1]],
        (_, Some(width), Some(height)) if width.len() == 1 && height.len() == 1 => [width[0], height[0]],
        _ => return Err(missing("image size", "add image_width and image_height")),
    };
    let extrinsics = "add R (3x3) or rvec (3) and T (3), world to camera, for every camera in one common world";
    let rotation = match numbers(ROTATION, suffix) {
        Some(v) if v.len() == 3 => rows_from_rotation_vector(DVec3::new(v[0], v[1], v[2])),
        Some(v) => rows(&v).ok_or_else(|| missing("3x3 rotation", extrinsics))?,
        None => return Err(missing("rotation", extrinsics)),
    };
    let translation = numbers(TRANSLATION, suffix)
        .and_then(|v| <[f64; 3]>::try_from(v).ok())
        .ok_or_else(|| missing("translation", extrinsics))?;
    CameraParts {
        name: name.clone(),
        size: size.map(|side| side as usize),
        k,
        distortion: numbers(DISTORTION, suffix).unwrap_or_default(),
        rotation,
        translation,
        unit_mm: unit,
        pixel_shift: 0.5,
    }
    .build(path)
}

fn rows(v: &[f64]) -> Option<[[f64; 3]; 3]> {
    let v: &[f64; 9] = v.try_into().ok()?;
    Some([[v[0], v[1], v[2]], [v[3], v[4], v[5]], [v[6], v[7], v[8]]])
}

/// A map that describes an `opencv-matrix` becomes its numbers.
pub(super) fn matrix_from_map(map: Vec<(String, Node)>) -> Result<Node, String> {
    let number = |key: &str| match map.iter().find(|(name, _)| name == key) {
        Some((_, Node::Numbers(v))) if v.len() == 1 => Some(v[0]),
        _ => None,
    };
    let count = match map.iter().find(|(name, _)| name == "sizes") {
        Some((_, Node::Numbers(sizes))) => sizes.iter().product(),
        _ => number("rows").zip(number("cols")).map(|(r, c)| r * c).ok_or("a matrix without rows and cols")?,
    };
    match map.into_iter().find(|(name, _)| name == "data") {
        Some((_, Node::Numbers(data))) if data.len() as f64 == count => Ok(Node::Numbers(data)),
        Some((_, Node::Numbers(data))) => Err(format!("a matrix of {count} numbers has {}", data.len())),
        _ => Err("a matrix without data".into()),
    }
}

/// A number as OpenCV writes it (`1.`, `.Nan`, `-.Inf`).
pub(super) fn number(word: &str) -> Option<f64> {
    match word.to_ascii_lowercase().as_str() {
        ".nan" => Some(f64::NAN),
        ".inf" => Some(f64::INFINITY),
        "-.inf" => Some(f64::NEG_INFINITY),
        plain => plain.parse().ok(),
    }
}

#[cfg(test)]
#[path = "opencv_tests.rs"]
mod tests;
