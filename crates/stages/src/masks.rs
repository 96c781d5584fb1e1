//! Stage 1: subject and hair masks. Subject from the clean plate; hair given on key frames and carried by optical flow.

use serde::{Deserialize, Serialize};
use strandflow_core::{Mask, Place, Plane, Report, RgbImage};
use strandflow_image::{
    appearance::{Appearance, features},
    filter::{gaussian, halved},
    flow::{Flow, FlowOptions, flow},
    matte::{MatteOptions, from_plate},
    region::Region,
};

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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MasksSettings {
    /// Differences from the plate above this many standard deviations of the noise are the subject.
    pub threshold: f32,
    /// Smallest piece of subject kept \[px\].
    pub speck_area_px: usize,
    /// Largest hole in the subject closed \[px\].
    pub hole_area_px: usize,
    /// Darkening of the plate that counts as shadow rather than subject, as a fraction.
    pub shadow: f32,
    /// Half width of the border in which coverage is soft \[px\].
    pub border_px: usize,
    /// Weight of appearance against the mask carried by flow (0: flow alone).
    pub appearance_weight: f32,
    /// Sigma over which appearance is averaged \[px\].
    pub appearance_px: f32,
}

impl Default for MasksSettings {
    fn default() -> Self {
        Self {
            threshold: 6.0,
            speck_area_px: 24,
            hole_area_px: 60,
            shadow: 0.06,
            border_px: 6,
            appearance_weight: 1.0,
            appearance_px: 0.8,
        }
    }
}

impl MasksSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        let mut found = Vec::new();
        let reason = "outside what images can show";
        for (field, value, low, high) in [
            ("threshold", self.threshold, 1.0, 100.0),
            ("shadow", self.shadow, 0.0, 0.9),
            ("border_px", self.border_px as f32, 1.0, 64.0),
            ("appearance_weight", self.appearance_weight, 0.0, 100.0),
            ("appearance_px", self.appearance_px, 0.0, 20.0),
        ] {
            let range = format!("{low}..={high}");
            let ok = (low..=high).contains(&value);
            SettingViolation::unless(ok, &mut found, (&format!("masks.{field}"), value), (&range, reason));
        }
        found
    }
}

/// The masks of one view and frame.
pub fn masks(
    input: &MasksInput,
    mode: Mode,
    settings: &MasksSettings,
    report: &mut Report,
) -> Result<Masks, StageError> {
    check_sizes(input)?;
    let subject = match input.given_subject {
        Some(given) => given.clone(),
        None => from_plate(input.image, input.plate, &matte_options(settings)),
    };
    let Some(bounds) = Region::bounding(&subject, |&m| m >= 128) else {
        report.warn(input.place.clone(), "nothing differs from the clean plate", "subject and hair masks are empty");
        let hair = input.given_hair.cloned().unwrap_or_else(|| empty(input.image));
        return Ok(Masks { subject, hair });
    };
    if let Some(given) = input.given_hair {
        return Ok(Masks { subject, hair: given.clone() });
    }
    let carried = carried_hair(input, &subject, bounds);
    let hair = match (mode, carried, input.key) {
        (_, None, None) => {
            report.warn(input.place.clone(), "no hair mask at or before this frame", "hair mask is empty");
            empty(input.image)
        }
        (Mode::Paper, Some(carried), _) | (Mode::Robust, Some(carried), None) => within(&carried, &subject),
        (Mode::Paper, None, Some((_, mask))) => within(mask, &subject),
        (Mode::Robust, carried, Some(key)) => decided_hair(input, &subject, carried, key, settings),
    };
    Ok(Masks { subject, hair })
}

fn matte_options(settings: &MasksSettings) -> MatteOptions {
    MatteOptions {
        threshold: settings.threshold,
        speck_area: settings.speck_area_px,
        hole_area: settings.hole_area_px,
        shadow: settings.shadow,
        band: settings.border_px,
    }
}

fn empty(image: &RgbImage) -> Mask {
    Plane::filled(image.width, image.height, 0)
}

/// The smaller coverage of the two.
fn within(mask: &Mask, subject: &Mask) -> Mask {
    Plane { data: mask.data.iter().zip(&subject.data).map(|(&a, &b)| a.min(b)).collect(), ..*mask }
}

/// The hair mask of the frame before, carried along the flow from this frame to that one, at half resolution.
fn carried_hair(input: &MasksInput, subject: &Mask, bounds: Region) -> Option<Mask> {
    let previous = input.previous.as_ref()?;
    let before = Region::bounding(&previous.masks.subject, |&m| m >= 128)?;
    let (width, height) = (input.image.width, input.image.height);
    let region = bounds.union(&before).grown(16, width, height);
    let back = flow_between(input.image, previous.image, region);
    let hair = region.crop(&previous.masks.hair, |&m| f32::from(m));
    let moved = strandflow_image::flow::warped(&hair, &back);
    let mut mask = Plane::filled(subject.width, subject.height, 0u8);
    region.paste(&moved.map(|m| m.round() as u8), &mut mask);
    Some(mask)
}

/// Flow of a region, computed at half resolution and doubled.
fn flow_between(from: &RgbImage, to: &RgbImage, region: Region) -> Flow {
    let channels = |image: &RgbImage| {
        let f = [0, 1, 2].map(|c| halved(&region.crop(image, |colour| f32::from(colour[c]))));
        f.to_vec()
    };
    let options = FlowOptions { levels: 4, ..FlowOptions::default() };
    flow(&channels(from), &channels(to), &options).doubled(region.width, region.height)
}

/// Hair by appearance learnt on the key frame, with the carried mask as prior.
fn decided_hair(
    input: &MasksInput,
    subject: &Mask,
    carried: Option<Mask>,
    (key_image, key_hair): (&RgbImage, &Mask),
    settings: &MasksSettings,
) -> Mask {
    let prior = match carried {
        Some(carried) => carried,
        None => key_hair.clone(),
    };
    let key_subject = from_plate(key_image, input.plate, &matte_options(settings));
    let sigma = settings.appearance_px;
    let model = Appearance::learn(&features(key_image, sigma), |i| {
        let (hair, subject) = (f32::from(key_hair.data[i]) / 255.0, f32::from(key_subject.data[i]) / 255.0);
        (hair, (subject - hair).max(0.0))
    });
    let Some(model) = model else { return within(&prior, subject) };
    let ratio = gaussian(&model.log_ratio(&features(input.image, sigma)), sigma);
    let prior_wide = gaussian(&prior.map(|&m| f32::from(m) / 255.0), 1.0);
    let data = (0..subject.data.len())
        .map(|i| {
            let inside = f32::from(subject.data[i]) / 255.0;
            if inside == 0.0 {
                return 0;
            }
            // Share of the subject that was hair where this pixel came from, softened: flow is never certain.
            let p = (prior_wide.data[i] / inside.max(0.3)).clamp(0.04, 0.96);
            let logit = (p / (1.0 - p)).ln() + settings.appearance_weight * ratio.data[i].clamp(-4.0, 4.0);
            (255.0 * inside / (1.0 + (-2.0 * logit).exp())).round() as u8
        })
        .collect();
    Plane { data, ..*subject }
}

fn check_sizes(input: &MasksInput) -> Result<(), StageError> {
    let size = (input.image.width, input.image.height);
    let mut others = vec![("clean plate", (input.plate.width, input.plate.height))];
    let mask_size = |mask: &Mask| (mask.width, mask.height);
    others.extend(input.given_subject.map(|m| ("given subject mask", mask_size(m))));
    others.extend(input.given_hair.map(|m| ("given hair mask", mask_size(m))));
    others.extend(input.key.map(|(_, m)| ("hair mask of the key frame", mask_size(m))));
    others.extend(input.key.map(|(i, _)| ("key frame", (i.width, i.height))));
    others.extend(input.previous.as_ref().map(|p| ("frame before", (p.image.width, p.image.height))));
    match others.into_iter().find(|(_, other)| *other != size) {
        None => Ok(()),
        Some((what, (w, h))) => Err(StageError::Input {
            place: input.place.clone(),
            fact: format!("the {what} is {w}×{h}, the image {}×{}", size.0, size.1),
            hint: "images, plates and masks of a view have one size".into(),
        }),
    }
}
