//! A folder of numbered images as a source of frames.

use std::{
    collections::{BTreeMap, VecDeque},
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
};

use strandflow_core::{RgbImage, SourceError};

use super::{SourceInfo, ViewInput, located};
use crate::{
    IoError,
    error::At,
    image_file::{images_in, read_rgb},
};

/// Decoded images kept per view; neighbouring frames are asked for twice.
const KEPT_FRAMES: usize = 4;

/// One view's images. Frame 0 is the lowest number in the folder.
pub struct FolderSource {
    view: String,
    path: PathBuf,
    files: BTreeMap<u64, PathBuf>,
    info: SourceInfo,
    kept: Mutex<VecDeque<(usize, Arc<RgbImage>)>>,
}

impl FolderSource {
    /// Lists a folder, or the files of a pattern, and reads the first image's size.
    ///
    /// # Errors
    /// The folder cannot be read, holds no image, an image has no number, or two have the same.
    pub fn open(view: &str, input: &ViewInput) -> Result<Self, IoError> {
        let path = input.path();
        let (folder, pattern) = match input {
            ViewInput::Pattern(_) => (path.parent().unwrap_or(Path::new(".")), NamePattern::of(path)),
            _ => (path, None),
        };
        let mut files = BTreeMap::new();
        for file in images_in(folder)? {
            let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let number = match &pattern {
                Some(pattern) => match pattern.number_in(&name) {
                    Some(number) => number,
                    None => continue,
                },
                None => last_number(&file).ok_or_else(|| unnumbered(&file, view))?,
            };
            if let Some(other) = files.insert(number, file.clone()) {
                let fact = format!("has the same frame number as {}", other.display());
                return Err(IoError::content(&file, At::view(view), fact, "keep one kind of image per folder"));
            }
        }
        let Some((first, first_file)) = files.first_key_value() else {
            let hint = "put PNG, JPEG, TIFF or EXR images there, named by their frame (000000.png)";
            return Err(IoError::content(path, At::view(view), "holds no images", hint));
        };
        let image = read_rgb(first_file)?;
        let frame_count = files.last_key_value().map_or(0, |(last, _)| (last - first) as usize + 1);
        let info = SourceInfo { width: image.width, height: image.height, frame_count, fps: None };
        let (view, path) = (view.to_owned(), path.to_owned());
        Ok(Self { view, path, files, info, kept: Mutex::default() })
    }

    /// What it holds; the size is the first image's.
    pub fn info(&self) -> SourceInfo {
        self.info
    }

    /// The folder or pattern.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The number of the first image.
    pub fn first_number(&self) -> u64 {
        self.files.first_key_value().map_or(0, |(first, _)| *first)
    }

    /// Missing files, when the take's numbering starts at `first`; at most the first missing frame of each gap.
    pub fn gaps(&self, first: u64) -> Vec<SourceError> {
        let mut findings = Vec::new();
        let mut expected = first;
        for &number in self.files.keys() {
            if number > expected {
                let frame = (expected - first) as usize;
                let count = number - expected;
                let what = if expected == first { "the first images are" } else { "there is a gap:" };
                findings.push(self.missing(frame, &format!("{what} {count} missing, from number {expected} on")));
            }
            expected = number + 1;
        }
        findings
    }

    fn missing(&self, frame: usize, fact: &str) -> SourceError {
        SourceError {
            file: self.path.display().to_string(),
            view: self.view.clone(),
            frame,
            fact: fact.to_owned(),
            hint: "copy the missing images into the folder, or run the frames around the gap (`--frames A..B`)".into(),
            is_shortage: false,
        }
    }

    /// A frame.
    ///
    /// # Errors
    /// The file is missing, cannot be read, or has another size than the first one; located.
    pub fn image(&self, frame: usize) -> Result<Arc<RgbImage>, SourceError> {
        if let Some((_, image)) = self.lock().iter().find(|(kept, _)| *kept == frame) {
            return Ok(image.clone());
        }
        let number = self.first_number().saturating_add(frame as u64);
        let Some(file) = self.files.get(&number) else {
            return Err(self.missing(frame, &format!("the image with number {number} is missing")));
        };
        let image = read_rgb(file).map_err(|error| located(&error, &self.view, frame))?;
        if (image.width, image.height) != (self.info.width, self.info.height) {
            return Err(SourceError {
                file: file.display().to_string(),
                view: self.view.clone(),
                frame,
                fact: format!(
                    "the image is {}x{}, the first one {}x{}",
                    image.width, image.height, self.info.width, self.info.height
                ),
                hint: "export all images of a view in one size".into(),
                is_shortage: false,
            });
        }
        let image = Arc::new(image);
        let mut kept = self.lock();
        kept.push_back((frame, image.clone()));
        while kept.len() > KEPT_FRAMES {
            kept.pop_front();
        }
        Ok(image)
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, VecDeque<(usize, Arc<RgbImage>)>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn unnumbered(file: &Path, view: &str) -> IoError {
    IoError::content(file, At::view(view), "has no frame number in its name", "name images by their frame: 000000.png")
}

/// The last run of digits in a file's name without ending.
fn last_number(file: &Path) -> Option<u64> {
    let stem = file.file_stem()?.to_str()?;
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = stem[..end]
        .rfind(|c: char| !c.is_ascii_digit())
        .map_or(0, |at| at + stem[at..].chars().next().map_or(1, char::len_utf8));
    stem[start..end].parse().ok().filter(|number| *number < 1 << 40)
}

/// A file name with a hole for the number: `%d`, `%06d` or `####`.
struct NamePattern {
    before: String,
    after: String,
}

impl NamePattern {
    fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?;
        let start = name.find(['%', '#'])?;
        let rest = &name[start..];
        let length =
            if rest.starts_with('%') { rest.find('d')? + 1 } else { rest.len() - rest.trim_start_matches('#').len() };
        Some(Self { before: name[..start].to_owned(), after: rest[length..].to_owned() })
    }

    fn number_in(&self, name: &str) -> Option<u64> {
        let digits = name.strip_prefix(&self.before)?.strip_suffix(&self.after)?;
        digits.parse().ok().filter(|number| *number < 1 << 40)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names() {
        let number = |name: &str| last_number(Path::new(name));
        assert_eq!(number("cam03/frame_0012.png"), Some(12));
        assert_eq!(number("cam2_take7é0005b.png"), Some(5));
        assert_eq!((number("plate.png"), number("99999999999999999999.png")), (None, None));
        let pattern = NamePattern::of(Path::new("x/shot-%04d.tif")).unwrap();
        assert_eq!((pattern.number_in("shot-0042.tif"), pattern.number_in("shut-0042.tif")), (Some(42), None));
        assert_eq!(NamePattern::of(Path::new("a.####.png")).unwrap().number_in("a.0007.png"), Some(7));
    }
}
