//! Stage 11: every strand's motion explained by a simulation: parameters and averaged simulated positions (eq. 3, 4).

use glam::DVec3;
use serde::{Deserialize, Serialize};
use strandflow_core::{Report, RigidTransform, StrandSequence};

use crate::{Mode, SettingViolation, StageError};

/// What one block of strands needs.
pub struct FitInput<'a> {
    /// The trimmed sequence of the block, all frames.
    pub sequence: &'a StrandSequence,
    /// The head's motion per frame.
    pub world_from_head: &'a [RigidTransform],
    /// Gravity \[mm/s²\], world.
    pub gravity: DVec3,
    /// Frame interval \[s\].
    pub frame_secs: f64,
    /// Number of the block's first strand in the take, for messages.
    pub first_strand: usize,
}

/// The refined block. Every particle below a strand's count is present in every frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// Refined strands; provenance `Simulated` where the frame had no point.
    pub sequence: StrandSequence,
    /// Fitted parameters per strand, shape (N, 9): k_edge, k_bend, k_torsion, k_alt \[1/s²\], c_edge, c_bend, c_torsion,
    /// c_alt, drag \[1/s\], per unit mass. Geometric mean over the windows of the last outer pass.
    pub parameters: Vec<[f32; 9]>,
    /// Per strand: root mean square distance of the refined to the given points \[mm\].
    pub residual_mm: Vec<f32>,
    /// Per strand: windows fitted, windows that stopped without converging, windows that failed.
    pub windows: Vec<[u16; 3]>,
}

/// Settings of stage `fit`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitSettings {
    /// Passes over the whole take.
    pub outer_passes: usize,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self { outer_passes: 2 }
    }
}

impl FitSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        Vec::new()
    }
}

/// Fits one block of strands.
pub fn fit(input: &FitInput, mode: Mode, settings: &FitSettings, report: &mut Report) -> Result<Fitted, StageError> {
    unimplemented!()
}
