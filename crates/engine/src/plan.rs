//! What a run works on: mode, settings and frames, resolved before any work starts.

use std::path::Path;

use serde::{Deserialize, Serialize};
use strandflow_core::FrameRange;
use strandflow_stages::Mode;

use crate::{EngineError, Manifest, Settings, disk, take::RESOLVED};

/// The resolved plan of a run; written to `resolved.toml` beside the results.
///
/// `frames` restricts a run: per-frame stages work on these frames only, and the take-level stages treat them as the
/// take. What is carried from the first frame on (masks, hull, pose, scalp) covers `lead`, from the take's first frame to
/// the last of `frames`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Version of the program.
    pub version: String,
    /// Which reading of the method.
    pub mode: Mode,
    /// Seed.
    pub seed: u64,
    /// The take's first frame up to the last of `frames`.
    pub lead: FrameRange,
    /// The frames asked for.
    pub frames: FrameRange,
    /// One past the take's last frame; the length of every frame dimension in the store.
    pub end: usize,
    /// Settings of all stages.
    pub settings: Settings,
}

impl Plan {
    /// The plan of the last run of a take, as it stands beside the results; `None` where there was none or another version of
    /// the program wrote it otherwise.
    pub fn of_last_run(take: &Path) -> Option<Self> {
        toml::from_str(&disk::read_text(&take.join(RESOLVED)).ok()?).ok()
    }

    /// The plan for a take whose frames are `all`, with what the command line asks for.
    ///
    /// # Errors
    /// `Input` where the frames asked for are not in the take.
    pub fn new(
        manifest: &Manifest,
        all: FrameRange,
        mode: Option<Mode>,
        frames: Option<FrameRange>,
    ) -> Result<Self, EngineError> {
        let frames = frames.unwrap_or(all);
        if frames.start < all.start || frames.end > all.end || frames.is_empty() {
            return Err(EngineError::input(
                format!("--frames {frames}"),
                format!("the take has the frames {all}"),
                format!("ask for frames within {all}"),
            ));
        }
        Ok(Self {
            version: env!("CARGO_PKG_VERSION").into(),
            mode: mode.unwrap_or(manifest.mode),
            seed: manifest.seed,
            lead: FrameRange { start: all.start, end: frames.end },
            frames,
            end: all.end,
            settings: manifest.settings.clone(),
        })
    }

    /// The index of a frame among `frames`.
    pub fn index(&self, frame: usize) -> usize {
        frame - self.frames.start
    }
}
