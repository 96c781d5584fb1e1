//! Stage 1: subject and hair masks. Subject from the clean plate; hair given on key frames and carried by optical flow.

use serde::{Deserialize, Serialize};
use strandflow_core::{Mask, Place, Report, RgbImage};

use crate::{Mode, SettingViolation, StageError};

/// What one view and frame needs.
pub struct MasksInput<'a> {
    /// Where, for messages.
    pub place: Place,
    /// The image.
    pub image: &'a RgbImage,
    /// The view without the subject.
    pub plate: &'a RgbImage,
    /// A subject mask given by the user for this frame; replaces the computed one.
    pub given_subject: Option<&'a Mask>,
    /// A hair mask given by the user for this frame (a key frame).
    pub given_hair: Option<&'a Mask>,
    /// The frame before, unless this is the first.
    pub previous: Option<PreviousFrame<'a>>,
    /// The latest key frame at or before this frame: its image and its given hair mask (appearance model).
    pub key: Option<(&'a RgbImage, &'a Mask)>,
}

/// The frame before and what was found there.
pub struct PreviousFrame<'a> {
    /// Its image.
    pub image: &'a RgbImage,
    /// Its masks.
    pub masks: &'a Masks,
}

/// The masks of one view and frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Masks {
    /// Head, hair and markers.
    pub subject: Mask,
    /// Hair.
    pub hair: Mask,
}

/// Settings of stage `masks`.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MasksSettings {}

impl MasksSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        Vec::new()
    }
}

/// The masks of one view and frame.
pub fn masks(
    input: &MasksInput,
    mode: Mode,
    settings: &MasksSettings,
    report: &mut Report,
) -> Result<Masks, StageError> {
    unimplemented!()
}
