//! The views of a capture: a video each, a folder of images each, or images of all views in one folder.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use strandflow_io::{SourceInfo, ViewInput, image_file::is_image, probe};

use super::extras::PLATES;
use crate::{EngineError, footage::number_at_end};

/// A view that was found.
#[derive(Clone, Debug)]
pub(super) struct View {
    pub name: String,
    /// A video, a folder of images, or a pattern.
    pub source: PathBuf,
    pub info: SourceInfo,
}

const VIDEOS: [&str; 12] = ["mp4", "mov", "avi", "mkv", "webm", "m4v", "mpg", "mpeg", "mts", "m2ts", "wmv", "mxf"];

/// Words in the names of folders and files that are no footage.
const NO_FOOTAGE: [&str; 21] = [
    "calib",
    "calibration",
    "checkerboard",
    "mask",
    "masks",
    "matte",
    "mattes",
    "alpha",
    "segmentation",
    "depth",
    "depths",
    "normals",
    "gt",
    "truth",
    "user",
    "export",
    "sparse",
    "colmap",
    "dense",
    "results",
    "chessboard",
];

/// How far below the capture footage is looked for.
const DEPTH: usize = 3;

/// The entries of a folder that are not hidden, by name; none where it cannot be read.
pub(super) fn entries(folder: &Path) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> =
        std::fs::read_dir(folder).map(|dir| dir.flatten().map(|entry| entry.path()).collect()).unwrap_or_default();
    all.retain(|path| path.file_name().is_some_and(|name| !name.to_string_lossy().starts_with('.')));
    all.sort();
    all
}

pub(super) fn stem(path: &Path) -> String {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Whether one of the words is a word of the name.
pub(super) fn has_word(name: &str, words: &[&str]) -> bool {
    name.to_lowercase().split(|c: char| !c.is_alphabetic()).any(|word| words.contains(&word))
}

pub(super) fn is_video(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    path.is_file() && VIDEOS.contains(&extension.as_str())
}

/// Finds the views, in the order of their names.
pub(super) fn find(capture: &Path, calibration: &Path, said: &mut Vec<String>) -> Result<Vec<View>, EngineError> {
    let (mut videos, mut folders) = (Vec::new(), Vec::new());
    walk(capture, calibration, 0, &mut videos, &mut folders);
    let place = || capture.display().to_string();
    let mut sources = if videos.len() >= 2 {
        if folders.len() >= 2 {
            said.push(format!(
                "{} videos are taken as views, {} folders of images are not",
                videos.len(),
                folders.len()
            ));
        }
        named_videos(&videos)
    } else if folders.len() >= 2 {
        named_folders(&folders)
    } else if let [folder] = folders.as_slice() {
        said.push(format!("{}: images of all views in one folder, told apart by their names", folder.display()));
        patterns(folder)
    } else {
        Vec::new()
    };
    if sources.len() < 2 {
        let hint = "give a folder with a video a view (NAME.mp4), with a folder of images a view (NAME/000000.png), or with \
                    images NAME_000000.png";
        let fact = if sources.is_empty() { "there are no views" } else { "there is one view; at least two are needed" };
        return Err(EngineError::input(place(), fact, hint));
    }
    for (name, _) in &mut sources {
        *name = name.replace(['.', '/', '\\'], "_");
    }
    sources.sort();
    let mut names = BTreeSet::new();
    if let Some((name, source)) = sources.iter().find(|(name, _)| !names.insert(name)) {
        let fact = format!("two views are named {name}");
        return Err(EngineError::input(source.display().to_string(), fact, "give files or folders names of their own"));
    }
    let probed = |(name, source): (String, PathBuf)| {
        let info = probe(&ViewInput::of(&source)).map_err(|error| error.in_view(&name))?;
        Ok(View { name, source, info })
    };
    let views: Vec<View> = sources.into_iter().map(probed).collect::<Result<_, EngineError>>()?;
    let names: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
    let size = |view: &View| format!("{}×{}", view.info.width, view.info.height);
    let sizes: BTreeSet<String> = views.iter().map(size).collect();
    said.push(format!("{} views: {}", views.len(), names.join(", ")));
    said.push(format!("image size: {}", sizes.into_iter().collect::<Vec<_>>().join(", ")));
    Ok(views)
}

fn walk(folder: &Path, calibration: &Path, depth: usize, videos: &mut Vec<PathBuf>, folders: &mut Vec<PathBuf>) {
    let mut has_images = false;
    for path in entries(folder) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if has_word(&name, &NO_FOOTAGE) || has_word(&name, &PLATES) {
            continue;
        }
        if path.is_dir() {
            // A calibration may be a folder that holds its pictures.
            if depth < DEPTH && path != calibration && !path.join("zarr.json").exists() {
                walk(&path, calibration, depth + 1, videos, folders);
            }
        } else if is_video(&path) {
            videos.push(path);
        } else if is_image(&path) {
            has_images |= number_at_end(&stem(&path)).is_some();
        }
    }
    if has_images {
        folders.push(folder.to_owned());
    }
}

/// A video is named by itself where all lie in one folder, or by its folder where it is the only one there.
fn named_videos(videos: &[PathBuf]) -> Vec<(String, PathBuf)> {
    let parents: BTreeSet<&Path> = videos.iter().filter_map(|video| video.parent()).collect();
    let by_folder = parents.len() == videos.len();
    let name = |video: &PathBuf| match video.parent().filter(|_| by_folder) {
        Some(parent) => (last_name(parent), video.clone()),
        None => (stem(video), video.clone()),
    };
    videos.iter().map(name).collect()
}

/// A folder is named by itself, or, where all have one name (`cam00/images`), by the folder around it.
fn named_folders(folders: &[PathBuf]) -> Vec<(String, PathBuf)> {
    let own: BTreeSet<String> = folders.iter().map(|folder| last_name(folder)).collect();
    let name = |folder: &PathBuf| match folder.parent().filter(|_| own.len() == 1) {
        Some(parent) => (last_name(parent), folder.clone()),
        None => (last_name(folder), folder.clone()),
    };
    folders.iter().map(name).collect()
}

pub(super) fn last_name(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Images `NAME_000000.png` of one folder as one pattern a name.
fn patterns(folder: &Path) -> Vec<(String, PathBuf)> {
    let mut found = BTreeMap::new();
    for path in entries(folder).into_iter().filter(|path| is_image(path)) {
        let stem = stem(&path);
        let Some(start) = number_at_end(&stem) else { continue };
        let name = stem[..start].trim_end_matches(['_', '-', '.', ' ']).to_owned();
        let extension = path.extension().unwrap_or_default().to_string_lossy().into_owned();
        let pattern = folder.join(format!("{}%0{}d.{extension}", &stem[..start], stem.len() - start));
        found.entry(name).or_insert(pattern);
    }
    found.into_iter().collect()
}
