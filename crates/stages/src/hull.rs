//! Stage 2: the take's grid, and the visual hull of each frame on it.

use serde::{Deserialize, Serialize};
use strandflow_core::{Grid, Mask, Occupancy, Report, Rig};

use crate::{SettingViolation, StageError};

/// Settings of stage `hull`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HullSettings {
    /// Edge of a voxel \[mm\].
    pub voxel_mm: f64,
}

impl Default for HullSettings {
    fn default() -> Self {
        Self { voxel_mm: 2.0 }
    }
}

impl HullSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        let mut found = Vec::new();
        SettingViolation::unless(
            (0.25..=20.0).contains(&self.voxel_mm),
            &mut found,
            ("hull.voxel_mm", self.voxel_mm),
            ("0.25..=20", "a head is 200 mm wide; below 0.25 mm no image has that detail"),
        );
        found
    }
}

/// The grid that holds the hulls of all frames: the coarse hull of the union of each view's subject masks over all
/// frames, plus a margin. `unions`: one mask a view.
pub fn grid_of_take(
    rig: &Rig,
    unions: &[Mask],
    settings: &HullSettings,
    report: &mut Report,
) -> Result<Grid, StageError> {
    unimplemented!()
}

/// The visual hull of one frame on the take's grid. `subjects`: one mask a view. Voxels that no view sees are not
/// occupied; a view in which a voxel falls outside the image says nothing about it.
pub fn hull(
    rig: &Rig,
    subjects: &[&Mask],
    grid: &Grid,
    frame: usize,
    settings: &HullSettings,
    report: &mut Report,
) -> Result<Occupancy, StageError> {
    unimplemented!()
}
