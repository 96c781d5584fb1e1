//! Frames in time, and where images come from.

use std::{fmt, str::FromStr, sync::Arc};

use serde::{Deserialize, Serialize};

use crate::RgbImage;

/// A half-open range of frames, written `A..B`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrameRange {
    /// First frame.
    pub start: usize,
    /// One past the last frame.
    pub end: usize,
}

impl FrameRange {
    /// Number of frames.
    pub fn len(&self) -> usize {
        self.end.saturating_sub(self.start)
    }

    /// Whether there is no frame in the range.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether `frame` lies in the range.
    pub fn contains(&self, frame: usize) -> bool {
        (self.start..self.end).contains(&frame)
    }
}

impl fmt::Display for FrameRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}..{}", self.start, self.end)
    }
}

impl FromStr for FrameRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is not a frame range; write A..B (A first, B one past the last)");
        let (a, b) = text.split_once("..").ok_or_else(wrong)?;
        let range = Self { start: a.parse().map_err(|_| wrong())?, end: b.parse().map_err(|_| wrong())? };
        if range.is_empty() { Err(format!("frame range `{text}` is empty")) } else { Ok(range) }
    }
}

/// Why an image could not be had: the file, view and frame, and what to do.
#[derive(Clone, Debug, thiserror::Error)]
#[error("view {view}, frame {frame}: {fact} ({file})")]
pub struct SourceError {
    /// The file that was asked.
    pub file: String,
    /// The view's name.
    pub view: String,
    /// The frame.
    pub frame: usize,
    /// What is wrong.
    pub fact: String,
    /// What to do about it.
    pub hint: String,
    /// Whether the system lacked something and the file is not to blame.
    pub is_shortage: bool,
}

/// Where the images of a take come from. Implementations cache; callers ask for frames in rising order.
pub trait ImageSource: Sync {
    /// The image of one view and frame.
    fn image(&self, view: usize, frame: usize) -> Result<Arc<RgbImage>, SourceError>;
}
