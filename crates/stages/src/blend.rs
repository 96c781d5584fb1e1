//! Stage 13: strands warped along the velocity field and interpolated in time (eq. 6, 7); missing strands completed.

use glam::Vec3;
use serde::{Deserialize, Serialize};
use strandflow_core::{Report, RigidTransform, SparseVoxels, StrandSequence};

use crate::{Mode, SettingViolation, StageError};

/// What one frame needs. `sequence` holds the fitted strands of the previous, this and the next frame (2 or 3 frames:
/// a neighbour that does not exist is left out), `fields[i]` the velocity field of `sequence.frames[i]`.
pub struct BlendInput<'a> {
    /// Index of this frame within `sequence.frames`.
    pub at: usize,
    /// Fitted strands.
    pub sequence: &'a StrandSequence,
    /// Velocity fields \[mm/s\].
    pub fields: &'a [&'a SparseVoxels<Vec3>],
    /// The head's motion, per frame of `sequence`.
    pub world_from_head: &'a [RigidTransform],
    /// Roots of all strands in head space \[mm\], shape (N).
    pub roots: &'a [glam::DVec3],
    /// Frame interval \[s\].
    pub frame_secs: f64,
    /// Edge length \[mm\].
    pub edge_mm: f64,
}

/// Settings of stage `blend`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BlendSettings {
    /// γ of eq. 7.
    pub relaxation: f64,
    /// s_l of eq. 6.
    pub length_weight: f64,
}

impl Default for BlendSettings {
    fn default() -> Self {
        Self { relaxation: 0.25, length_weight: 50.0 }
    }
}

impl BlendSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        Vec::new()
    }
}

/// The blended strands of one frame: a sequence of one frame, every strand of the take present (absent ones completed
/// from their neighbours, provenance `Completed`).
pub fn blend(
    input: &BlendInput,
    mode: Mode,
    settings: &BlendSettings,
    report: &mut Report,
) -> Result<StrandSequence, StageError> {
    unimplemented!()
}
