//! Where pictures go: a PNG, a folder of PNGs, a video. Whole or not at all.

use std::path::{Path, PathBuf};

use strandflow_core::{Plane, RgbImage};
use strandflow_io::{
    FolderError, IoError, VIDEO_EXTENSIONS, VideoWriter, image_file::is_image, write_rgb_png, write_rgba_png,
};

use crate::failure::Failed;

/// A finished picture.
pub enum Finished {
    /// Over a backdrop.
    Opaque(RgbImage),
    /// With coverage.
    CutOut(Plane<[u8; 4]>),
}

/// What kind of output a path is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// One PNG.
    Still,
    /// A folder of PNGs.
    Folder,
    /// A video.
    Video,
}

impl Kind {
    /// By the ending of a path.
    pub fn of(path: &Path) -> Self {
        let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        match ending.as_str() {
            "png" => Self::Still,
            video if VIDEO_EXTENSIONS.contains(&video) => Self::Video,
            _ => Self::Folder,
        }
    }
}

/// An output that is being written.
pub enum Output {
    /// One PNG; written by the first picture.
    Still(PathBuf),
    /// A folder that gets its name at the end: (now, then, pictures).
    Folder(PathBuf, PathBuf, usize),
    /// A video.
    Video(VideoWriter),
}

impl Output {
    /// Opens an output before anything is rendered, so that hours of work do not come before the error.
    ///
    /// # Errors
    /// It cannot be written; the folder holds something.
    pub fn open(path: &Path, size: [usize; 2], fps: f64) -> Result<Self, Failed> {
        let refused = |error: std::io::Error| {
            Failed::input(format!("{}: {error}", path.display()), "give a path that you may write to")
        };
        if let Some(parent) = path.parent().filter(|parent| !parent.as_os_str().is_empty()) {
            std::fs::create_dir_all(parent).map_err(refused)?;
        }
        match Kind::of(path) {
            Kind::Still => {
                let probe = hidden(path);
                std::fs::write(&probe, []).and_then(|()| std::fs::remove_file(&probe)).map_err(refused)?;
                Ok(Self::Still(path.to_owned()))
            }
            Kind::Folder
                if is_image(path) || path.extension().is_some_and(|e| e == "avi" || e == "mkv" || e == "gif") =>
            {
                let fact = format!("{}: is of no format that is written", path.display());
                Err(Failed::input(fact, "end it in .png, .mp4, .mov or .webm, or name a folder"))
            }
            Kind::Folder => {
                let taken = match std::fs::read_dir(path) {
                    Ok(mut entries) => entries.next().is_some(),
                    Err(error) => error.kind() != std::io::ErrorKind::NotFound,
                };
                if taken {
                    let fact = format!("{}: is there and not an empty folder", path.display());
                    return Err(Failed::input(
                        fact,
                        "give a new folder, or a name that ends in .png, .mp4, .mov or .webm",
                    ));
                }
                let now = hidden(path);
                // What a killed program left.
                let _ = std::fs::remove_dir_all(&now);
                std::fs::create_dir(&now).map_err(refused)?;
                Ok(Self::Folder(now, path.to_owned(), 0))
            }
            Kind::Video => match VideoWriter::create(path, size, fps) {
                Ok(video) => Ok(Self::Video(video)),
                Err(IoError::Program { program, .. }) => {
                    let fact =
                        format!("{}: the program `{program}`, which writes videos, was not found", path.display());
                    Err(Failed::input(fact, "install ffmpeg and put it on the PATH, or name a folder for PNGs instead"))
                }
                Err(error) => Err(error.into()),
            },
        }
    }

    /// Adds a picture.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn push(&mut self, picture: &Finished) -> Result<(), Failed> {
        match (self, picture) {
            (Self::Still(path), picture) => write_png(path, picture),
            (Self::Folder(now, path, count), picture) => {
                let file = now.join(format!("{count:06}.png"));
                *count += 1;
                write_png(&file, picture).map_err(|failed| failed.moved(now, path))
            }
            (Self::Video(video), Finished::Opaque(image)) => Ok(video.push(image)?),
            (Self::Video(_), Finished::CutOut(_)) => {
                Err(Failed::input("a video has no transparency", "give a --background, or write a folder of PNGs"))
            }
        }
    }

    /// Gives the output its name.
    ///
    /// # Errors
    /// The file system or ffmpeg refuses.
    pub fn finish(self) -> Result<(), Failed> {
        match self {
            Self::Still(_) => Ok(()),
            Self::Folder(now, path, _) => {
                // An empty folder of that name is replaced.
                let _ = std::fs::remove_dir(&path);
                std::fs::rename(&now, &path).map_err(|error| {
                    let _ = std::fs::remove_dir_all(&now);
                    Failed::input(format!("{}: {error}", path.display()), "give a path that you may write to")
                })
            }
            Self::Video(video) => Ok(video.finish()?),
        }
    }

    /// Takes away what was begun.
    pub fn abandon(self) {
        if let Self::Folder(now, _, _) = self {
            let _ = std::fs::remove_dir_all(now);
        }
    }
}

fn write_png(path: &Path, picture: &Finished) -> Result<(), Failed> {
    match picture {
        Finished::Opaque(image) => write_rgb_png(path, image)?,
        Finished::CutOut(image) => write_rgba_png(path, image)?,
    }
    Ok(())
}

/// A name beside a path that no one looks at.
fn hidden(path: &Path) -> PathBuf {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    path.with_file_name(format!(".{name}.tmp"))
}
