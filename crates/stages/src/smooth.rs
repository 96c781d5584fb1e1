//! Stage 10: strands resampled to 5 mm and smoothed (eq. 2), then trimmed to a fixed topology over the take.

use serde::{Deserialize, Serialize};
use strandflow_core::{Report, RigidTransform, StrandSequence, Strands};

use crate::{Mode, SettingViolation, StageError};

/// Settings of stage `smooth`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SmoothSettings {
    /// Edge length after resampling \[mm\].
    pub edge_mm: f64,
    /// w_s of eq. 2.
    pub smoothness: f64,
}

impl Default for SmoothSettings {
    fn default() -> Self {
        Self { edge_mm: 5.0, smoothness: 0.5 }
    }
}

impl SmoothSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        Vec::new()
    }
}

/// Phase 1, one frame: every strand resampled and smoothed; numbering kept.
pub fn smooth_frame(
    strands: &Strands,
    frame: usize,
    mode: Mode,
    settings: &SmoothSettings,
    report: &mut Report,
) -> Result<Strands, StageError> {
    unimplemented!()
}

/// Phase 2, one block of strands over all frames: fixed counts, missing points marked.
///
/// `frames[t]` holds the same strands of the block in frame `frame_numbers[t]`. `point_count` is the P of the take.
pub fn trim_block(
    frame_numbers: &[u32],
    frames: &[Strands],
    world_from_head: &[RigidTransform],
    point_count: usize,
    mode: Mode,
    settings: &SmoothSettings,
    report: &mut Report,
) -> Result<StrandSequence, StageError> {
    unimplemented!()
}
