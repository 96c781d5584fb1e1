//! Stage 6: sparse undirected 3D lines from orientation maps of three or more views.

use glam::Vec3;
use serde::{Deserialize, Serialize};
use strandflow_core::{Mask, Occupancy, Report, Rig, SparseVoxels};

use crate::{Mode, SettingViolation, StageError, orient::OrientationMap};

/// An undirected 3D line at a voxel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Line {
    /// Unit direction; sign without meaning.
    pub direction: Vec3,
    /// Trust 0 to 1.
    pub confidence: f32,
    /// Root mean square angle between the line and its planes \[rad\].
    pub residual: f32,
    /// Views that took part.
    pub views: u8,
}

/// What one frame needs.
pub struct LiftInput<'a> {
    /// The cameras.
    pub rig: &'a Rig,
    /// The frame, for messages.
    pub frame: usize,
    /// The hull.
    pub hull: &'a Occupancy,
    /// Orientation maps, one a view.
    pub maps: &'a [&'a OrientationMap],
    /// Hair masks, one a view.
    pub hairs: &'a [&'a Mask],
}

/// Settings of stage `lift`.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LiftSettings {}

impl LiftSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        Vec::new()
    }
}

/// The lines that three or more views agree on.
pub fn lift(
    input: &LiftInput,
    mode: Mode,
    settings: &LiftSettings,
    report: &mut Report,
) -> Result<SparseVoxels<Line>, StageError> {
    unimplemented!()
}
