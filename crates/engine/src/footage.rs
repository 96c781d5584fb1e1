//! The files behind the frames of each view, for staleness; decoding is `strandflow_io`'s.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use strandflow_core::SourceError;
use strandflow_io::{ViewInput, image_file::is_image};

use crate::EngineError;

/// The files of one view.
pub struct ViewFiles {
    name: String,
    path: PathBuf,
    /// Images by frame, the lowest number being frame 0; `None` for a video.
    images: Option<BTreeMap<usize, PathBuf>>,
    first: usize,
}

impl ViewFiles {
    /// Lists the files of a view.
    ///
    /// # Errors
    /// `Input` where there is nothing at the path.
    pub fn open(name: &str, input: &ViewInput) -> Result<Self, EngineError> {
        let path = input.path().to_owned();
        let images = match input {
            ViewInput::Video(_) => None,
            ViewInput::Folder(folder) => Some(numbered_images(folder)?),
            ViewInput::Pattern(pattern) => Some(of_pattern(pattern)?),
        };
        let there = images.as_ref().map_or_else(|| path.is_file(), |images| !images.is_empty());
        if !there {
            let subject = format!("{}, view {name}", path.display());
            return Err(EngineError::input(
                subject,
                "there is no such video or folder of images",
                "check the path in the manifest",
            ));
        }
        let first = images.as_ref().and_then(|images| images.keys().next().copied()).unwrap_or(0);
        let images = images.map(|images| images.into_iter().map(|(number, file)| (number - first, file)).collect());
        Ok(Self { name: name.to_owned(), path, images, first })
    }

    /// The file that holds a frame.
    ///
    /// # Errors
    /// The frame is missing.
    pub fn file(&self, frame: usize) -> Result<&Path, SourceError> {
        let Some(images) = &self.images else { return Ok(&self.path) };
        images.get(&frame).map(PathBuf::as_path).ok_or_else(|| SourceError {
            file: self.path.display().to_string(),
            view: self.name.clone(),
            frame,
            fact: "the frame is missing".into(),
            hint: "copy the missing image into the folder, or give only frames that are there in the manifest".into(),
            is_shortage: false,
        })
    }

    /// The number in the name of frame 0; 0 for a video.
    pub fn first_number(&self) -> usize {
        self.first
    }

    /// The video or folder.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// The images of a pattern: those of its folder whose names begin like it.
fn of_pattern(pattern: &Path) -> Result<BTreeMap<usize, PathBuf>, EngineError> {
    let name = pattern.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let prefix: String = name.chars().take_while(|c| !matches!(c, '%' | '#')).collect();
    // Chosen before numbers are compared: images of all views may lie in the folder.
    numbered(pattern.parent().unwrap_or(Path::new(".")), |file| {
        is_image(file) && file.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&prefix))
    })
}

/// Where the number at the end of a name begins.
pub(crate) fn number_at_end(stem: &str) -> Option<usize> {
    let start = stem.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    (start < stem.len()).then_some(start)
}

/// The images of a folder by the number in their name; none where the folder does not exist.
///
/// # Errors
/// `Input` where two images have the same number or an image has none.
pub fn numbered_images(folder: &Path) -> Result<BTreeMap<usize, PathBuf>, EngineError> {
    numbered(folder, is_image)
}

/// The files of a folder that are `wanted`, by the number in their name; none where the folder does not exist.
///
/// # Errors
/// `Input` where two have the same number or one has none.
pub fn numbered(folder: &Path, wanted: impl Fn(&Path) -> bool) -> Result<BTreeMap<usize, PathBuf>, EngineError> {
    let mut files = BTreeMap::new();
    if !folder.is_dir() {
        return Ok(files);
    }
    for entry in std::fs::read_dir(folder).map_err(|e| EngineError::disk(folder, e))? {
        let path = entry.map_err(|e| EngineError::disk(folder, e))?.path();
        let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        if !wanted(&path) || stem.starts_with('.') {
            continue;
        }
        let Some(number) = number_at_end(&stem).and_then(|start| stem[start..].parse::<usize>().ok()) else {
            let hint = "end the name with the number of the frame, like 000012.png";
            return Err(EngineError::input(path.display().to_string(), "the name holds no frame number", hint));
        };
        if let Some(other) = files.insert(number, path.clone()) {
            let fact = format!("frame {number} is there twice, also as {}", other.display());
            return Err(EngineError::input(path.display().to_string(), fact, "leave one of them"));
        }
    }
    Ok(files)
}
