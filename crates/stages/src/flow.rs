//! Stage 12: the velocity field diffused from the fitted strands (eq. 5).

use glam::Vec3;
use serde::{Deserialize, Serialize};
use strandflow_core::{Grid, Occupancy, Report, SparseVoxels};

use crate::{Mode, SettingViolation, StageError};

/// What one frame needs: the strands of three neighbouring frames (the frame itself repeated at the ends of the take).
pub struct FlowInput<'a> {
    /// The frame, for messages.
    pub frame: usize,
    /// The take's grid.
    pub grid: Grid,
    /// The hull of the frame; velocities are defined in it and around the strands.
    pub hull: &'a Occupancy,
    /// Positions of all particles in the previous, this and the next frame, NaN where absent; equal lengths (N · P).
    pub points: [&'a [Vec3]; 3],
    /// P: points per strand in `points`.
    pub point_count: usize,
    /// Seconds between the previous and the next of the three (2 intervals inside the take, 1 at its ends).
    pub span_secs: f64,
}

/// Settings of stage `flow`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FlowSettings {
    /// s of eq. 5.
    pub spread: f32,
    /// Sweeps.
    pub sweeps: usize,
}

impl Default for FlowSettings {
    fn default() -> Self {
        Self { spread: 1.0 / 12.0, sweeps: 30 }
    }
}

impl FlowSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        Vec::new()
    }
}

/// Velocities \[mm/s\] of one frame.
pub fn flow(
    input: &FlowInput,
    mode: Mode,
    settings: &FlowSettings,
    report: &mut Report,
) -> Result<SparseVoxels<Vec3>, StageError> {
    unimplemented!()
}
