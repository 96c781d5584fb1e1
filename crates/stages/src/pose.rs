//! Stage 3: markers tracked from labels in the first frame, and the rigid head pose of every frame (eq. 1).

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use strandflow_core::{FrameRange, ImageSource, Report, Rig, RigidTransform};

use crate::{Mode, SettingViolation, StageError};

/// A marker labelled in the first frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MarkerLabel {
    /// The marker's number.
    pub id: u32,
    /// Image point \[px\] per view index in which a person sees it.
    pub views: BTreeMap<usize, DVec2>,
}

/// What the stage needs.
pub struct PoseInput<'a> {
    /// The cameras.
    pub rig: &'a Rig,
    /// All images.
    pub images: &'a dyn ImageSource,
    /// The frames of the take.
    pub frames: FrameRange,
    /// Labels in the first frame.
    pub labels: &'a [MarkerLabel],
}

/// Marker tracks and head poses.
#[derive(Clone, Debug, PartialEq)]
pub struct HeadPoses {
    /// Motion of the head from the first frame to each frame, in world coordinates (eq. 1's C^t). Head space is the
    /// world of the first frame.
    pub world_from_head: Vec<RigidTransform>,
    /// Marker positions \[mm\], shape (T, M); `None` where not triangulated.
    pub markers: Vec<Vec<Option<DVec3>>>,
    /// Marker image points \[px\], shape (T, views, M); `None` where lost or occluded.
    pub tracks: Vec<Vec<Vec<Option<DVec2>>>>,
    /// Root mean square reprojection error of the markers used \[px\], per frame.
    pub rms_px: Vec<f64>,
    /// Markers that the pose of each frame rests on.
    pub used: Vec<u32>,
    /// Whether the pose of a frame was interpolated.
    pub interpolated: Vec<bool>,
}

/// Settings of stage `pose`.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PoseSettings {}

impl PoseSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        Vec::new()
    }
}

/// Marker tracks and head poses of the whole take.
pub fn pose(
    input: &PoseInput,
    mode: Mode,
    settings: &PoseSettings,
    report: &mut Report,
) -> Result<HeadPoses, StageError> {
    unimplemented!()
}
