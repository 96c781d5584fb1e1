//! OpenCV file storage (YAML or XML): K, distortion, and R or a rotation vector with T, one file a camera or several.
//!
//! OpenCV's first pixel centre is (0, 0): half a pixel is added to principal points. Names that are understood, each also
//! with a suffix that tells cameras of one file apart (`K_cam00`, `R_cam00`, …) or inside a node per camera:
//! K: `K`, `camera_matrix`, `cameraMatrix`, `M`, `intrinsic`; distortion: `D`, `dist`, `distortion_coefficients`, …;
//! rotation: `R`, `rvec`; translation: `T`, `t`, `tvec`; size: `image_width`/`image_height`, `image_size`.

use std::{collections::BTreeMap, path::Path};

use glam::DVec3;

use super::{
    convention::Unit,
    opencv_xml, opencv_yaml,
    parts::{CameraParts, Lens, rows_from_rotation_vector, rows_of},
    settle::Described,
    xml_tree::{Element, Fault},
};
use crate::{IoError, error::At};

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

/// Text that names the lens, beside a camera or at the top of a file.
const MODEL: &[&str] = &["distortion_model", "camera_model", "model_type", "model"];

/// What a YAML file of OpenCV says.
pub(super) fn described_yaml(path: &Path, text: &str) -> Result<Described, IoError> {
    described_nodes(path, &opencv_yaml::parse(text).map_err(fault(path))?)
}

/// What an XML file of OpenCV says.
pub(super) fn described_xml(path: &Path, document: &Element) -> Result<Described, IoError> {
    described_nodes(path, &opencv_xml::nodes(document).map_err(fault(path))?)
}

/// What an OpenCV file with one or more cameras says; a single camera without a name takes the file's.
pub(super) fn described_nodes(path: &Path, root: &Node) -> Result<Described, IoError> {
    Ok(Described::opencv("OpenCV", cameras_of(path, root)?, Unit::Unsaid, 0.0))
}

/// The located form of what is wrong with the text.
pub(super) fn fault(path: &Path) -> impl FnOnce(Fault) -> IoError + '_ {
    |(line, fact)| IoError::content(path, At::line(line), fact, "write the file with OpenCV's FileStorage")
}

fn cameras_of(path: &Path, root: &Node) -> Result<Vec<CameraParts>, IoError> {
    let Node::Map(entries) = root else { return Err(no_camera(path)) };
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let all = by_name(entries);
    if find(&all, K, "").is_some() {
        return Ok(vec![camera_of(path, &stem, &all, "")?]);
    }
    let mut cameras = Vec::new();
    for (key, node) in entries {
        match node {
            // A node a camera, or a node that holds such nodes.
            Node::Map(inner) if holds_camera(inner) => cameras.push(camera_of(path, key, &by_name(inner), "")?),
            Node::Map(inner) => {
                for (key, node) in inner {
                    if let Node::Map(innermost) = node
                        && holds_camera(innermost)
                    {
                        cameras.push(camera_of(path, key, &by_name(innermost), "")?);
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
                    cameras.push(camera_of(path, name, &all, suffix)?);
                }
            }
        }
    }
    if cameras.is_empty() { Err(no_camera(path)) } else { Ok(cameras) }
}

fn holds_camera(entries: &[(String, Node)]) -> bool {
    entries.iter().any(|(key, _)| K.contains(&key.as_str()))
}

fn no_camera(path: &Path) -> IoError {
    IoError::content(
        path,
        At::FILE,
        "holds no camera matrix",
        "name it K or camera_matrix, one node or suffix a camera",
    )
}

/// The entries of a node by name; of several of one name the first counts.
type Entries<'a> = BTreeMap<&'a str, &'a Node>;

fn by_name(entries: &[(String, Node)]) -> Entries<'_> {
    entries.iter().rev().map(|(key, node)| (key.as_str(), node)).collect()
}

fn find<'a>(entries: &Entries<'a>, aliases: &[&str], suffix: &str) -> Option<&'a Node> {
    aliases.iter().find_map(|alias| entries.get(format!("{alias}{suffix}").as_str()).copied())
}

fn camera_of(path: &Path, name: &str, map: &Entries<'_>, suffix: &str) -> Result<CameraParts, IoError> {
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
    let k = numbers(K, suffix).and_then(|v| rows_of(&v)).ok_or_else(|| missing("3x3 camera matrix", "name it K"))?;
    let size = match (either(SIZE), either(WIDTH), either(HEIGHT)) {
        (Some(size), _, _) if size.len() == 2 => Some([size[0], size[1]]),
        (_, Some(width), Some(height)) if width.len() == 1 && height.len() == 1 => Some([width[0], height[0]]),
        _ => None,
    };
    let extrinsics = "add R (3x3) or rvec (3) and T (3), world to camera, for every camera in one common world";
    let rotation = match numbers(ROTATION, suffix) {
        Some(v) if v.len() == 3 => rows_from_rotation_vector(DVec3::new(v[0], v[1], v[2])),
        Some(v) => rows_of(&v).ok_or_else(|| missing("3x3 rotation", extrinsics))?,
        None => return Err(missing("rotation", extrinsics)),
    };
    let translation = numbers(TRANSLATION, suffix)
        .and_then(|v| <[f64; 3]>::try_from(v).ok())
        .ok_or_else(|| missing("translation", extrinsics))?;
    let terms = numbers(DISTORTION, suffix).unwrap_or_default();
    Ok(CameraParts {
        lens: if is_fisheye(map, suffix) { Lens::Fisheye(terms) } else { Lens::OpenCv(terms) },
        name,
        size: size.map(|size| size.map(|side| side as usize)),
        k,
        rotation,
        translation,
    })
}

/// `fisheye_model: 1` as OpenCV's calibration program writes it, or a model of that name.
fn is_fisheye(map: &Entries<'_>, suffix: &str) -> bool {
    let flag = find(map, &["fisheye_model", "fisheye"], suffix);
    let is_named = find(map, MODEL, suffix).is_some_and(|node| match node {
        Node::Text(text) => ["fisheye", "equidistant"].iter().any(|word| text.to_ascii_lowercase().contains(word)),
        _ => false,
    });
    is_named || matches!(flag, Some(Node::Numbers(value)) if value.iter().any(|&x| x != 0.0))
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
