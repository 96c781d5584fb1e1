//! Where a take's images come from: per view a video or a folder of images, behind `core::ImageSource`.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use strandflow_core::{ImageSource, RgbImage, Rig, SourceError};

use crate::IoError;

pub mod decoder;
pub mod folder;
pub mod probe;
pub mod video;

pub use folder::FolderSource;
pub use video::VideoSource;

/// The files of one view.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ViewInput {
    /// A video that ffmpeg can read.
    Video(PathBuf),
    /// A folder of images, numbered by the last digits of their names.
    Folder(PathBuf),
    /// Images by pattern: `%06d` or `######` stands for the frame's number.
    Pattern(PathBuf),
}

impl ViewInput {
    /// What a path means: a folder, a pattern (with `%d`, `%0Nd` or `#` in the file name), or else a video.
    pub fn of(path: &Path) -> Self {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        if name.contains('%') || name.contains('#') {
            Self::Pattern(path.to_owned())
        } else if path.is_dir() {
            Self::Folder(path.to_owned())
        } else {
            Self::Video(path.to_owned())
        }
    }

    /// The path it was made of.
    pub fn path(&self) -> &Path {
        match self {
            Self::Video(path) | Self::Folder(path) | Self::Pattern(path) => path,
        }
    }
}

/// What a view's files hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SourceInfo {
    /// Image width \[px\].
    pub width: usize,
    /// Image height \[px\].
    pub height: usize,
    /// Number of frames, gaps included.
    pub frame_count: usize,
    /// Frames per second; folders do not know.
    pub fps: Option<f64>,
}

/// What a view's files hold.
///
/// # Errors
/// The files are missing or unreadable, or ffmpeg is (with the install hint).
pub fn probe(input: &ViewInput) -> Result<SourceInfo, IoError> {
    match input {
        ViewInput::Video(path) => probe::probe_video(path),
        ViewInput::Folder(_) | ViewInput::Pattern(_) => Ok(FolderSource::open("", input)?.info()),
    }
}

/// The frame rate of videos that agree on one within 0.1 %.
pub fn agreed_fps(rates: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut rates = rates.into_iter();
    let first = rates.next()?;
    rates.all(|fps| (fps - first).abs() <= 1e-3 * first).then_some(first)
}

enum ViewSource {
    Video(VideoSource),
    Folder(FolderSource),
}

/// The images of all views of a take. Memory is bounded: per view a few decoded frames are kept (see [`VideoSource`]).
pub struct TakeSource {
    names: Vec<String>,
    views: Vec<ViewSource>,
}

impl TakeSource {
    /// Opens every view, in the order of the rig.
    ///
    /// # Errors
    /// A view's files cannot be read at all, or ffmpeg is missing. Gaps and mismatches are told by [`TakeSource::check`].
    pub fn open(views: &[(String, ViewInput)]) -> Result<Self, IoError> {
        let open = |(name, input): &(String, ViewInput)| {
            let view = match input {
                ViewInput::Video(path) => VideoSource::open(name, path).map(ViewSource::Video),
                ViewInput::Folder(_) | ViewInput::Pattern(_) => FolderSource::open(name, input).map(ViewSource::Folder),
            };
            view.map_err(|error| error.in_view(name))
        };
        let names = views.iter().map(|(name, _)| name.clone()).collect();
        Ok(Self { names, views: views.iter().map(open).collect::<Result<_, _>>()? })
    }

    /// What each view holds.
    pub fn infos(&self) -> Vec<SourceInfo> {
        let info = |view: &ViewSource| match view {
            ViewSource::Video(video) => video.info(),
            ViewSource::Folder(folder) => folder.info(),
        };
        self.views.iter().map(info).collect()
    }

    /// The number of frames that every view has.
    pub fn frame_count(&self) -> usize {
        self.infos().iter().map(|info| info.frame_count).min().unwrap_or(0)
    }

    /// The frame rate of the videos, if they agree on one within 0.1 %.
    pub fn fps(&self) -> Option<f64> {
        agreed_fps(self.infos().iter().filter_map(|info| info.fps))
    }

    /// Everything that does not fit: an image size other than the calibration's, a clip of another length or frame rate
    /// than the first one's, images numbered from elsewhere, gaps in the numbering. Empty when all is well.
    pub fn check(&self, rig: &Rig) -> Vec<SourceError> {
        let infos = self.infos();
        let mut findings = Vec::new();
        let (first_count, first_fps) = infos.first().map_or((0, None), |info| (info.frame_count, info.fps));
        for (v, info) in infos.iter().enumerate() {
            let mut find = |frame: usize, fact: String, hint: &str| {
                let (file, view) = (self.file(v), self.names[v].clone());
                findings.push(SourceError { file, view, frame, fact, hint: hint.to_owned(), is_shortage: false });
            };
            let camera = rig.view_named(&self.names[v]).map(|at| &rig.cameras[at]);
            match camera {
                None => find(0, "the view has no calibration".into(), "add a camera of this name to the calibration"),
                Some(c) if (c.width, c.height) != (info.width, info.height) => find(
                    0,
                    format!("is {}x{}, its calibration {}x{}", info.width, info.height, c.width, c.height),
                    "calibrate at the size of the footage, or scale one to the other",
                ),
                _ => {}
            }
            if info.frame_count != first_count {
                let fact = format!("has {} frames, view {} has {first_count}", info.frame_count, self.names[0]);
                find(first_count.min(info.frame_count), fact, "cut all clips to the same, synchronous length");
            }
            if let (Some(fps), Some(first)) = (info.fps, first_fps)
                && (fps - first).abs() > 1e-3 * first
            {
                let fact = format!("runs at {fps} frames per second, view {} at {first}", self.names[0]);
                find(0, fact, "record all views at one frame rate, or convert the clips");
            }
        }
        findings.extend(self.folder_findings());
        findings
    }

    fn folder_findings(&self) -> Vec<SourceError> {
        let folders = self.views.iter().filter_map(|view| match view {
            ViewSource::Folder(folder) => Some(folder),
            ViewSource::Video(_) => None,
        });
        let first = folders.clone().map(FolderSource::first_number).min().unwrap_or(0);
        folders.flat_map(|folder| folder.gaps(first)).collect()
    }

    fn file(&self, view: usize) -> String {
        match &self.views[view] {
            ViewSource::Video(video) => video.path().display().to_string(),
            ViewSource::Folder(folder) => folder.path().display().to_string(),
        }
    }
}

impl ImageSource for TakeSource {
    fn image(&self, view: usize, frame: usize) -> Result<Arc<RgbImage>, SourceError> {
        match self.views.get(view) {
            Some(ViewSource::Video(video)) => video.image(frame),
            Some(ViewSource::Folder(folder)) => folder.image(frame),
            None => Err(SourceError {
                file: String::new(),
                view: view.to_string(),
                frame,
                fact: format!("there are {} views", self.views.len()),
                hint: "run `strandflow status`; the manifest and the calibration name different views".into(),
                is_shortage: false,
            }),
        }
    }
}

/// The located form of a file's error.
pub(crate) fn located(error: &IoError, view: &str, frame: usize) -> SourceError {
    let file = error.file().display().to_string();
    SourceError {
        file,
        view: view.to_owned(),
        frame,
        fact: error.fact(),
        hint: error.hint(),
        is_shortage: error.is_shortage(),
    }
}

#[cfg(test)]
#[path = "source/tests.rs"]
mod tests;
