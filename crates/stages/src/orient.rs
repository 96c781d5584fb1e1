//! Stage 5: 2D orientation and confidence of every hair pixel.

use serde::{Deserialize, Serialize};
use strandflow_core::{Mask, Place, Plane, Report, RgbImage};

use crate::{Mode, SettingViolation, StageError};

/// Undirected orientation of the strands in one image.
#[derive(Clone, Debug, PartialEq)]
pub struct OrientationMap {
    /// Angle in [0, π) from +x (right) towards +y (down) \[rad\]; 0 where there is no hair.
    pub angle: Plane<f32>,
    /// Trust 0 to 1; 0 where there is no hair.
    pub confidence: Plane<f32>,
}

/// Settings of stage `orient`.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OrientSettings {}

impl OrientSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        Vec::new()
    }
}

/// The orientation map of one view and frame.
pub fn orient(
    place: &Place,
    image: &RgbImage,
    hair: &Mask,
    subject: &Mask,
    mode: Mode,
    settings: &OrientSettings,
    report: &mut Report,
) -> Result<OrientationMap, StageError> {
    unimplemented!()
}
