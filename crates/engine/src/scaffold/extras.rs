//! What belongs to the footage: views without the subject, markers and masks that a person made.

use std::path::{Path, PathBuf};

use strandflow_io::{calibration::match_views, image_file::is_image};

use super::footage::{View, entries, has_word, is_video, last_name, stem};
use crate::EngineError;

pub(super) const PLATES: [&str; 9] =
    ["clean", "plate", "plates", "background", "backgrounds", "empty", "bg", "blank", "cleanplates"];

/// The clean plate of each view: an image of its name in a folder named for plates, the first image of such a folder's folder,
/// or an image beside the footage whose name says so (`cam00_clean.png`).
pub(super) fn plates(capture: &Path, views: &[View], said: &mut Vec<String>) -> Result<Vec<PathBuf>, EngineError> {
    let mut candidates: Vec<(String, PathBuf)> = Vec::new();
    look(capture, 0, &mut candidates);
    let names: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
    let own = |view: &str| candidates.iter().find(|(name, _)| name == view).map(|(_, path)| path.clone());
    if let Some(plates) = names.iter().map(|view| own(view)).collect::<Option<Vec<_>>>() {
        return still(plates, views);
    }
    let plates: Vec<&str> = candidates.iter().map(|(name, _)| name.as_str()).collect();
    let Some(matched) = match_views(&names, &plates) else {
        let lacking = names.iter().find(|name| own(name).is_none()).copied().unwrap_or_default();
        let hint = format!("put the view without the subject into clean/{lacking}.png");
        let place = format!("{}, view {lacking}", capture.display());
        return Err(EngineError::input(place, "there is no clean plate", hint));
    };
    let plates: Vec<PathBuf> = matched.cameras.iter().map(|&at| candidates[at].1.clone()).collect();
    let pairs: Vec<String> =
        names.iter().zip(&plates).map(|(name, plate)| format!("{name} = {}", last_name(plate))).collect();
    said.push(format!("clean plates by {}: {}", super::calibrated::in_words(matched.by), pairs.join(", ")));
    still(plates, views)
}

/// A plate is a still image.
fn still(plates: Vec<PathBuf>, views: &[View]) -> Result<Vec<PathBuf>, EngineError> {
    match plates.iter().zip(views).find(|(plate, _)| is_video(plate)) {
        None => Ok(plates),
        Some((plate, view)) => {
            let place = format!("{}, view {}", plate.display(), view.name);
            let hint = format!("take an image of it: ffmpeg -i {} -frames:v 1 {}.png", last_name(plate), stem(plate));
            Err(EngineError::input(place, "the clean plate is a video", hint))
        }
    }
}

fn look(folder: &Path, depth: usize, found: &mut Vec<(String, PathBuf)>) {
    for path in entries(folder) {
        let name = last_name(&path);
        if path.is_dir() && has_word(&name, &PLATES) {
            inside(&path, found);
        } else if path.is_dir() && depth < 2 {
            look(&path, depth + 1, found);
        } else if is_image(&path) && has_word(&stem(&path), &PLATES) {
            found.push((without_plate(&path), path));
        }
    }
}

/// `cam00_clean.png` is of `cam00`; `cam00/clean.png` too.
fn without_plate(path: &Path) -> String {
    let stem = stem(path);
    let words = stem.split(['_', '-', ' ', '.']).filter(|word| !PLATES.contains(&word.to_lowercase().as_str()));
    let name = words.collect::<Vec<_>>().join("_");
    if name.is_empty() { path.parent().map(last_name).unwrap_or_default() } else { name }
}

fn inside(folder: &Path, found: &mut Vec<(String, PathBuf)>) {
    for path in entries(folder) {
        if is_image(&path) || is_video(&path) {
            found.push((stem(&path), path));
        } else if let Some(first) = entries(&path).into_iter().find(|path| is_image(path)) {
            found.push((last_name(&path), first));
        }
    }
}

/// Where the user's labels and masks are, or will be.
pub(super) struct Labels {
    pub markers: PathBuf,
    pub hair_masks: PathBuf,
    pub subject_masks: Option<PathBuf>,
    /// What is not there yet.
    pub missing: Vec<String>,
}

/// Looks into `user/` of the capture and into the capture itself; what is nowhere will be in `user/` of the take.
pub(super) fn labels(capture: &Path, views: &[View], said: &mut Vec<String>) -> Labels {
    let there = |name: &str| {
        let places = [capture.join("user").join(name), capture.join(name)];
        places.into_iter().find(|path| path.exists())
    };
    let mut missing = Vec::new();
    let mut or_later = |found: Option<PathBuf>, name: &str, what: &str| {
        found.unwrap_or_else(|| {
            let place = Path::new("user").join(name);
            missing.push(format!("{what}: {} of the take", place.display()));
            place
        })
    };
    let markers = or_later(there("marker_labels.json"), "marker_labels.json", "marker labels");
    let hair_masks =
        or_later(there("hair_masks"), "hair_masks", "a hair mask of the first frame, VIEW/000000.png each");
    let subject_masks = there("subject_masks");
    if let Some(folder) = &subject_masks {
        said.push(format!("subject masks given by hand: {}", folder.display()));
    }
    let without = views.iter().filter(|view| hair_masks.is_absolute() && !hair_masks.join(&view.name).is_dir());
    let without: Vec<&str> = without.map(|view| view.name.as_str()).collect();
    if !without.is_empty() {
        missing.push(format!("hair masks of {}: in {}", without.join(", "), hair_masks.display()));
    }
    Labels { markers, hair_masks, subject_masks, missing }
}
