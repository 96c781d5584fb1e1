//! Stage 8: strands grown from the roots through the line field.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use strandflow_core::{Report, RigidTransform, SparseVoxels, Strands};

use crate::{Mode, SettingViolation, StageError, field::FieldVoxel};

/// What one frame needs.
pub struct GrowInput<'a> {
    /// The frame, for messages.
    pub frame: usize,
    /// The line field.
    pub field: &'a SparseVoxels<FieldVoxel>,
    /// Roots in head space \[mm\].
    pub roots: &'a [DVec3],
    /// Outward normals at the roots, head space.
    pub normals: &'a [DVec3],
    /// The head's motion.
    pub world_from_head: RigidTransform,
    /// Gravity \[mm/s²\], world.
    pub gravity: DVec3,
}

/// Settings of stage `grow`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GrowSettings {
    /// Arc length between points \[mm\].
    pub step_mm: f64,
    /// Longest strand \[mm\].
    pub max_length_mm: f64,
}

impl Default for GrowSettings {
    fn default() -> Self {
        Self { step_mm: 2.0, max_length_mm: 600.0 }
    }
}

impl GrowSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        Vec::new()
    }

    /// The most points a strand can have.
    pub fn max_points(&self) -> usize {
        (self.max_length_mm / self.step_mm).ceil() as usize + 1
    }
}

/// One strand a root (empty where none could be grown), in the order of the roots.
pub fn grow(
    input: &GrowInput,
    mode: Mode,
    settings: &GrowSettings,
    report: &mut Report,
) -> Result<Strands, StageError> {
    unimplemented!()
}
