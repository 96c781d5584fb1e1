//! A video as a source of frames: one decoder kept open, the last frames kept.

use std::{
    collections::VecDeque,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
};

use strandflow_core::{RgbImage, SourceError};

use super::{SourceInfo, decoder::Decoder, located, probe::probe_video};
use crate::IoError;

/// Memory for decoded frames per view \[bytes\]: 16 frames of VGA; of larger images fewer, but never under
/// `FEWEST_FRAMES`, so that two work items that each look at a frame and its successor do not restart the decoder.
const CACHE_BYTES: usize = 16 << 20;
const FEWEST_FRAMES: usize = 4;
const MOST_FRAMES: usize = 32;

/// One view's video. Rising frames cost one decoding each; going back behind the kept frames restarts the decoder.
pub struct VideoSource {
    view: String,
    path: PathBuf,
    info: SourceInfo,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    decoder: Option<Decoder>,
    kept: VecDeque<(usize, Arc<RgbImage>)>,
}

impl VideoSource {
    /// Probes a video; decoding starts with the first frame asked for.
    ///
    /// # Errors
    /// The file or ffprobe is missing, or it is no video.
    pub fn open(view: &str, path: &Path) -> Result<Self, IoError> {
        Ok(Self { view: view.to_owned(), path: path.to_owned(), info: probe_video(path)?, state: Mutex::default() })
    }

    /// What it holds.
    pub fn info(&self) -> SourceInfo {
        self.info
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// A frame.
    ///
    /// # Errors
    /// The video has no such frame, or it cannot be decoded; located.
    pub fn image(&self, frame: usize) -> Result<Arc<RgbImage>, SourceError> {
        if frame >= self.info.frame_count {
            return Err(SourceError {
                file: self.path.display().to_string(),
                view: self.view.clone(),
                frame,
                fact: format!("the video has {} frames", self.info.frame_count),
                hint: "ask for fewer frames (`--frames A..B`) or give the whole clip".into(),
                is_shortage: false,
            });
        }
        // A poisoned lock only means that another thread panicked between frames; the state is restarted.
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, image)) = state.kept.iter().find(|(kept, _)| *kept == frame) {
            return Ok(image.clone());
        }
        self.decode_to(&mut state, frame).map_err(|error| {
            state.decoder = None;
            located(&error, &self.view, frame)
        })
    }

    /// Decodes up to a frame and keeps the last ones on the way.
    fn decode_to(&self, state: &mut State, frame: usize) -> Result<Arc<RgbImage>, IoError> {
        let capacity =
            (CACHE_BYTES / (self.info.width * self.info.height * 3).max(1)).clamp(FEWEST_FRAMES, MOST_FRAMES);
        // Jumping far ahead is cheaper in a new process, which drops frames before converting them.
        let near = |decoder: &Decoder| (decoder.next..decoder.next + 2 * MOST_FRAMES).contains(&frame);
        let mut decoder = match state.decoder.take().filter(near) {
            Some(decoder) => decoder,
            None => {
                // Going back, start a little earlier: what was asked for out of order comes again soon.
                state.kept.retain(|(kept, _)| *kept > frame);
                Decoder::start(&self.path, frame.saturating_sub(1))?
            }
        };
        loop {
            let number = decoder.next;
            let image = Arc::new(decoder.read(&self.path, &self.view, &self.info)?);
            state.kept.retain(|(kept, _)| *kept != number);
            state.kept.push_back((number, image.clone()));
            while state.kept.len() > capacity {
                state.kept.pop_front();
            }
            if number == frame {
                state.decoder = Some(decoder);
                return Ok(image);
            }
        }
    }
}
