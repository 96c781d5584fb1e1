//! Which reader a calibration is for: by its content first, by its name where content does not tell.

use std::path::{Path, PathBuf};

use super::{
    ReadOptions, colmap, easymocap, json_tree, krt_text, metashape, nerfstudio, nersemble, neus, opencv, opencv_json,
    own_toml, plain_json, settle::Described, xml_tree,
};
use crate::{
    IoError,
    error::{At, not_json},
};

/// No calibration is longer \[bytes\].
const MAX_TEXT: u64 = 16 << 20;

/// Nor one of COLMAP's files, which hold the points of all images: 24 bytes each \[bytes\].
const MAX_MODEL: u64 = 1 << 30;

/// Names under which calibrations are usually found in a capture, the likeliest first.
pub const KNOWN_NAMES: [&str; 18] = [
    "calibration.toml",
    "calibration.json",
    "calibration.yml",
    "calibration.yaml",
    "calibration.xml",
    "calibration",
    "colmap",
    "sparse",
    "transforms.json",
    "intri.yml",
    "camera_params.json",
    "cameras.json",
    "cameras.xml",
    "cameras.yml",
    "cameras_sphere.npz",
    "cameras.npz",
    "cameras",
    "cams",
];

/// What the calibration at a path says.
pub(super) fn described(path: &Path, options: &ReadOptions) -> Result<Described, IoError> {
    if path.is_dir() {
        return described_folder(path, options);
    }
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let parent = path.parent().unwrap_or(Path::new("."));
    if extension == "bin" || ["cameras.txt", "images.txt"].contains(&name.as_str()) && is_colmap(parent) {
        return colmap::described(parent);
    }
    let bytes = read_bounded(path)?;
    if bytes.starts_with(b"PK\x03\x04") {
        return neus::described(path, bytes);
    }
    let text = String::from_utf8(bytes)
        .map_err(|_| IoError::content(path, At::FILE, "is neither text nor an archive of NumPy", KNOWN_FORMATS))?;
    let text = text.trim_start_matches('\u{feff}');
    let start = text.trim_start();
    // A list of numbers may begin with a bracket, so that names go before it.
    match extension.as_str() {
        "toml" => return own_toml::described(path, text),
        "yml" | "yaml" => return yaml(path, text),
        _ => {}
    }
    if start.starts_with("%YAML") {
        return yaml(path, text);
    }
    if start.starts_with('{') || extension == "json" {
        return json(path, text, options);
    }
    if start.starts_with('<') || extension == "xml" {
        let root = xml_tree::parse(text).map_err(|(line, fact)| {
            IoError::content(path, At::line(line), fact, "give OpenCV's file storage, or cameras exported by Metashape")
        })?;
        return if root.find("opencv_storage").is_some() {
            opencv::described_xml(path, &root)
        } else {
            metashape::described(path, &root)
        };
    }
    if extension == "txt" || extension.is_empty() || extension == "cam" || extension == "krtd" {
        return krt_text::described(path, text);
    }
    Err(IoError::content(path, At::FILE, "is not a calibration of a known format", KNOWN_FORMATS))
}

const KNOWN_FORMATS: &str = "give a .json (K/R/t, OpenCV, Nerfstudio, NeRSemble), .toml (ours), .yml/.xml (OpenCV), \
                             EasyMocap's folder, Metashape's .xml, NeuS's .npz, .txt (K/R/t) or a COLMAP folder";

fn described_folder(folder: &Path, options: &ReadOptions) -> Result<Described, IoError> {
    if let Some(model) = colmap_model(folder) {
        return colmap::described(&model);
    }
    if easymocap::is_folder(folder) {
        return easymocap::described(folder);
    }
    let inside = ["transforms.json", "camera_params.json", "cameras_sphere.npz", "cameras.npz"];
    if let Some(file) = inside.iter().map(|name| folder.join(name)).find(|file| file.is_file()) {
        return described(&file, options);
    }
    let storage = files_of(folder, &["yml", "yaml", "xml"])?;
    if !storage.is_empty() {
        return all_of(storage, |file| described(file, options));
    }
    let texts = files_of(folder, &["txt", "cam", "krtd"])?;
    if !texts.is_empty() {
        return all_of(texts, |file| described(file, options));
    }
    Err(IoError::content(
        folder,
        At::FILE,
        "is a folder without a calibration",
        "give a folder with COLMAP's cameras and images, or with one OpenCV .yml or .xml or one K/R/t .txt a camera",
    ))
}

/// The cameras of several files as those of one.
fn all_of(files: Vec<PathBuf>, read: impl Fn(&Path) -> Result<Described, IoError>) -> Result<Described, IoError> {
    let mut all: Option<Described> = None;
    for file in files {
        let one = read(&file)?;
        match &mut all {
            None => all = Some(one),
            Some(all)
                if all.dialect == one.dialect
                    && all.unit == one.unit
                    && all.pose == one.pose
                    && all.axes == one.axes =>
            {
                all.cameras.extend(one.cameras);
                let news = one.notes.into_iter().filter(|note| !all.notes.contains(note)).collect::<Vec<_>>();
                all.notes.extend(news);
            }
            Some(all) => {
                let fact = format!("is of another kind ({}) than the files before it ({})", one.dialect, all.dialect);
                return Err(IoError::content(&file, At::FILE, fact, "give one file, or a folder of files of one kind"));
            }
        }
    }
    all.ok_or_else(|| IoError::content(Path::new(""), At::FILE, "there is no file", KNOWN_FORMATS))
}

/// COLMAP numbers its models below `sparse`.
fn colmap_model(folder: &Path) -> Option<PathBuf> {
    ["", "0", "sparse/0", "sparse"].map(|below| folder.join(below)).into_iter().find(|folder| is_colmap(folder))
}

fn is_colmap(folder: &Path) -> bool {
    let pair =
        |ending: &str| ["cameras", "images"].iter().all(|part| folder.join(format!("{part}.{ending}")).is_file());
    pair("bin") || pair("txt")
}

fn files_of(folder: &Path, endings: &[&str]) -> Result<Vec<PathBuf>, IoError> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(IoError::reading(folder))? {
        let path = entry.map_err(IoError::reading(folder))?.path();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        if endings.contains(&extension.as_str()) && path.is_file() {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

fn yaml(path: &Path, text: &str) -> Result<Described, IoError> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let parent = path.parent().unwrap_or(Path::new("."));
    let is_part = ["intri.yml", "extri.yml"].iter().any(|part| name.eq_ignore_ascii_case(part));
    if is_part && easymocap::is_folder(parent) {
        return easymocap::described(parent);
    }
    opencv::described_yaml(path, text)
}

fn json(path: &Path, text: &str, options: &ReadOptions) -> Result<Described, IoError> {
    let value: serde_json::Value = serde_json::from_str(text).map_err(|cause| {
        not_json(path, text, &cause, "a calibration", "check the file's commas and brackets, or export it again")
    })?;
    let has = |key: &str| value.get(key).is_some();
    if has("frames") || has("camera_angle_x") {
        nerfstudio::described(path, &value, options)
    } else if has("world_2_cam") {
        nersemble::described(path, &value)
    } else if json_tree::holds_opencv_matrix(&value)
        || !value.get("cameras").is_some_and(|c| c.is_array()) && !has("units")
    {
        opencv_json::described(path, &value)
    } else {
        plain_json::described(path, text)
    }
}

/// The bytes of a file that is no longer than a calibration is.
pub(super) fn read_bounded(path: &Path) -> Result<Vec<u8>, IoError> {
    read_up_to(path, MAX_TEXT)
}

/// The bytes of one of COLMAP's files.
pub(super) fn read_model(path: &Path) -> Result<Vec<u8>, IoError> {
    read_up_to(path, MAX_MODEL)
}

fn read_up_to(path: &Path, most: u64) -> Result<Vec<u8>, IoError> {
    let length = std::fs::metadata(path).map_err(IoError::reading(path))?.len();
    if length > most {
        let fact = format!("is {} MB long: no calibration", length >> 20);
        return Err(IoError::content(path, At::FILE, fact, "check that it is the right file"));
    }
    std::fs::read(path).map_err(IoError::reading(path))
}

/// Bytes as text.
pub(super) fn text_of(path: &Path, bytes: Vec<u8>) -> Result<String, IoError> {
    String::from_utf8(bytes)
        .map_err(|_| IoError::content(path, At::FILE, "is not a text file (UTF-8)", "check that it is the right file"))
}

/// Whether a file or folder seems to be a calibration by its name and place, without reading it.
pub fn looks_like_calibration(path: &Path) -> bool {
    if path.is_dir() {
        return colmap_model(path).is_some() || easymocap::is_folder(path) || {
            let kinds: &[&[&str]] = &[&["yml", "yaml", "xml"], &["txt", "cam", "krtd"]];
            let is_named =
                KNOWN_NAMES.iter().any(|name| path.file_name().is_some_and(|n| n.eq_ignore_ascii_case(name)));
            is_named && kinds.iter().any(|endings| files_of(path, endings).is_ok_and(|files| !files.is_empty()))
        };
    }
    path.is_file()
}
