//! Stage 9: outliers by reprojection against the orientation maps, and by iterative weighting in the voxel field.

use serde::{Deserialize, Serialize};
use strandflow_core::{Grid, Occupancy, Report, Rig, Strands};

use crate::{Mode, SettingViolation, StageError, orient::OrientationMap};

/// What one frame needs.
pub struct PruneInput<'a> {
    /// The cameras.
    pub rig: &'a Rig,
    /// The frame, for messages.
    pub frame: usize,
    /// The hull (visibility, and the grid of the voxel field).
    pub hull: &'a Occupancy,
    /// Strands as grown.
    pub strands: &'a Strands,
    /// Orientation maps, one a view.
    pub maps: &'a [&'a OrientationMap],
}

/// Strands after the outlier tests: same numbering, field-consistent, outliers emptied or cut short, and flagged.
#[derive(Clone, Debug, PartialEq)]
pub struct Pruned {
    /// The strands; a rejected strand is empty.
    pub strands: Strands,
    /// Why a strand was rejected: 0 kept, 1 reprojection, 2 voxel field, 3 too short or absent. Length N.
    pub flags: Vec<u8>,
}

/// Settings of stage `prune`.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PruneSettings {}

impl PruneSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        Vec::new()
    }
}

/// The strands of one frame that survive both tests.
pub fn prune(
    input: &PruneInput,
    mode: Mode,
    settings: &PruneSettings,
    report: &mut Report,
) -> Result<Pruned, StageError> {
    unimplemented!()
}
