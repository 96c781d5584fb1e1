//! Videos out, through the program `ffmpeg`.

use std::{
    io::{Read, Write},
    path::{Path, PathBuf},
    process::{Child, ChildStdin, Command, Stdio},
};

use strandflow_core::RgbImage;

use crate::{IoError, error::At};

/// File name endings that are written as videos.
pub const VIDEO_EXTENSIONS: [&str; 3] = ["mp4", "mov", "webm"];

/// A video in the making. Under its name stands nothing, or what was there before, until [`VideoWriter::finish`].
pub struct VideoWriter {
    path: PathBuf,
    temporary: PathBuf,
    size: [usize; 2],
    child: Child,
    frames: Option<ChildStdin>,
}

impl VideoWriter {
    /// Starts a video of frames of a size \[px\] and a rate \[1/s\]: H.264 in `.mp4` and `.mov`, VP9 in `.webm`. An odd side
    /// loses its last column or row: the codecs want even ones.
    ///
    /// # Errors
    /// `Program` where there is no ffmpeg; the file cannot be written; its ending is none of [`VIDEO_EXTENSIONS`].
    pub fn create(path: &Path, size: [usize; 2], fps: f64) -> Result<Self, IoError> {
        let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        let codec: &[&str] = match ending.as_str() {
            "mp4" | "mov" => &["-c:v", "libx264", "-crf", "16", "-preset", "medium", "-movflags", "+faststart"],
            "webm" => &["-c:v", "libvpx-vp9", "-crf", "24", "-b:v", "0", "-row-mt", "0"],
            _ => {
                return Err(IoError::content(
                    path,
                    At::FILE,
                    "is no video that is written",
                    "end it in .mp4, .mov or .webm",
                ));
            }
        };
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let temporary = path.with_file_name(format!(".{name}.tmp.{ending}"));
        // ffmpeg's own words about a folder that is not there come only with the first frame.
        std::fs::File::create(&temporary).map_err(IoError::writing(path))?;
        let spawned = Command::new("ffmpeg")
            .args(["-y", "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"])
            .args(["-s", &format!("{}x{}", size[0], size[1]), "-framerate", &fps.to_string(), "-i", "-"])
            .args(["-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2:0:0", "-pix_fmt", "yuv420p", "-threads", "1"])
            .args(["-fflags", "+bitexact", "-flags:v", "+bitexact"])
            .args(codec)
            .arg(&temporary)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn();
        let mut child = spawned.map_err(|cause| {
            let _ = std::fs::remove_file(&temporary);
            match cause.kind() {
                std::io::ErrorKind::NotFound => IoError::Program { program: "ffmpeg", file: path.to_owned() },
                _ => IoError::writing(path)(cause),
            }
        })?;
        let frames = child.stdin.take();
        Ok(Self { path: path.to_owned(), temporary, size, child, frames })
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// ffmpeg does not take it, or it has another size than the video.
    pub fn push(&mut self, image: &RgbImage) -> Result<(), IoError> {
        if [image.width, image.height] != self.size {
            let fact =
                format!("a frame is {}×{}, the video {}×{}", image.width, image.height, self.size[0], self.size[1]);
            return Err(IoError::content(&self.path, At::FILE, fact, "give frames of one size"));
        }
        let Some(frames) = &mut self.frames else { return Ok(()) };
        match frames.write_all(image.data.as_flattened()) {
            Ok(()) => Ok(()),
            Err(cause) => Err(self.refused(&cause.to_string())),
        }
    }

    /// Ends the video and gives it its name.
    ///
    /// # Errors
    /// ffmpeg or the file system refuses.
    pub fn finish(mut self) -> Result<(), IoError> {
        drop(self.frames.take());
        match self.child.wait() {
            // ffmpeg 5 calls it a success where the disk is full at the end; its words tell.
            Ok(status) if status.success() => {
                let said = self.said();
                if ["Error writing", "Error closing"].iter().any(|words| said.contains(words)) {
                    return Err(self.refusal(&said, "ends too early"));
                }
            }
            Ok(status) => return Err(self.refused(&status.to_string())),
            Err(cause) => return Err(self.refused(&cause.to_string())),
        }
        std::fs::rename(&self.temporary, &self.path).map_err(IoError::writing(&self.path))
    }

    fn refused(&mut self, otherwise: &str) -> IoError {
        let said = self.said();
        self.refusal(&said, otherwise)
    }

    /// What ffmpeg said; it gets no more frames.
    fn said(&mut self) -> String {
        drop(self.frames.take());
        let mut said = String::new();
        if let Some(mut stderr) = self.child.stderr.take() {
            let _ = stderr.read_to_string(&mut said);
        }
        said
    }

    fn refusal(&self, said: &str, otherwise: &str) -> IoError {
        let fact = said.lines().map(str::trim).rfind(|line| !line.is_empty()).unwrap_or(otherwise);
        let hint = match ["No space left", "File too large", "quota"].iter().any(|words| said.contains(words)) {
            true => "free some disk space, or write elsewhere",
            false => "write PNGs instead (a folder), or install an ffmpeg with the codecs libx264 and libvpx-vp9",
        };
        let fact = fact.replace(&*self.temporary.to_string_lossy(), &self.path.to_string_lossy());
        IoError::content(&self.path, At::FILE, format!("ffmpeg cannot write it: {fact}"), hint)
    }
}

impl Drop for VideoWriter {
    /// A video that was not finished leaves nothing.
    fn drop(&mut self) {
        drop(self.frames.take());
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_file(&self.temporary);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_video_comes_whole_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.mp4");
        let Ok(mut video) = VideoWriter::create(&path, [33, 24], 25.0) else {
            eprintln!("skipped: no ffmpeg");
            return;
        };
        for frame in 0..5u8 {
            video.push(&RgbImage::filled(33, 24, [40 * frame, 90, 120])).unwrap();
        }
        assert!(video.push(&RgbImage::filled(2, 2, [0; 3])).unwrap_err().to_string().contains("2×2"));
        assert!(!path.exists());
        drop(video);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
        let mut video = VideoWriter::create(&path, [33, 24], 25.0).unwrap();
        video.push(&RgbImage::filled(33, 24, [200, 90, 120])).unwrap();
        video.finish().unwrap();
        assert!(path.exists() && std::fs::read_dir(dir.path()).unwrap().count() == 1);
        assert!(VideoWriter::create(&dir.path().join("no/a.mp4"), [8, 8], 25.0).is_err());
        assert!(VideoWriter::create(&dir.path().join("a.avi"), [8, 8], 25.0).is_err());
    }
}
