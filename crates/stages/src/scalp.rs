//! Stage 4: the scalp from the hulls of the slow start in head space, and blue-noise roots under the hair mask.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use strandflow_core::{Grid, Mask, Occupancy, Report, Rig, RigidTransform, TriMesh};

use crate::{SettingViolation, StageError};

/// One frame of the slow start.
pub struct ScalpFrame<'a> {
    /// The head's motion since the first frame.
    pub world_from_head: RigidTransform,
    /// Its hull.
    pub hull: &'a Occupancy,
    /// Its subject masks, one a view.
    pub subjects: Vec<&'a Mask>,
    /// Its hair masks, one a view.
    pub hairs: Vec<&'a Mask>,
}

/// What the stage needs.
pub struct ScalpInput<'a> {
    /// The cameras.
    pub rig: &'a Rig,
    /// Frames in which the head hardly moved, the first frame of the take first.
    pub frames: &'a [ScalpFrame<'a>],
    /// Markers at the first frame \[mm\]; they sit on the hair close to the scalp.
    pub markers: &'a [DVec3],
    /// Gravity \[mm/s²\], world.
    pub gravity: DVec3,
    /// Seed of the root sampling.
    pub seed: u64,
}

/// The scalp and its roots, in head space (the world of the first frame).
#[derive(Clone, Debug, PartialEq)]
pub struct Scalp {
    /// Closed head surface under the hair (scalp, and as much of face and neck as the hull gives); outward faces \[mm\].
    pub mesh: TriMesh,
    /// Hair roots on the surface \[mm\], length N.
    pub roots: Vec<DVec3>,
    /// Outward unit normals at the roots, length N.
    pub normals: Vec<DVec3>,
}

/// Settings of stage `scalp`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ScalpSettings {
    /// Roots to sample.
    pub root_count: usize,
}

impl Default for ScalpSettings {
    fn default() -> Self {
        Self { root_count: 8000 }
    }
}

impl ScalpSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        Vec::new()
    }
}

/// The scalp and its roots.
pub fn scalp(input: &ScalpInput, settings: &ScalpSettings, report: &mut Report) -> Result<Scalp, StageError> {
    unimplemented!()
}
