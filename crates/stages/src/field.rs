//! Stage 7: the dense line field of the hair volume, diffused from the sparse lines as tensors.

use glam::Vec3;
use serde::{Deserialize, Serialize};
use strandflow_core::{Mask, Occupancy, Report, Rig, RigidTransform, SparseVoxels, TriMesh};

use crate::{Mode, SettingViolation, StageError, lift::Line};

/// The line at a voxel of the hair volume.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FieldVoxel {
    /// Unit direction; sign without meaning.
    pub direction: Vec3,
    /// 1 − λ₂/λ₁ of the tensor, times what reached the voxel from observed lines, 0 to 1.
    pub trust: f32,
    /// Whether the voxel itself was observed.
    pub observed: bool,
}

/// What one frame needs.
pub struct FieldInput<'a> {
    /// The cameras.
    pub rig: &'a Rig,
    /// The frame, for messages.
    pub frame: usize,
    /// The hull.
    pub hull: &'a Occupancy,
    /// Observed lines.
    pub lines: &'a SparseVoxels<Line>,
    /// Hair masks, one a view.
    pub hairs: &'a [&'a Mask],
    /// Scalp in head space.
    pub scalp: &'a TriMesh,
    /// The head's motion.
    pub world_from_head: RigidTransform,
}

/// Settings of stage `field`.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FieldSettings {}

impl FieldSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        Vec::new()
    }
}

/// The line field of one frame over its hair volume (between scalp and hull, where hair can be).
pub fn field(
    input: &FieldInput,
    mode: Mode,
    settings: &FieldSettings,
    report: &mut Report,
) -> Result<SparseVoxels<FieldVoxel>, StageError> {
    unimplemented!()
}
