//! Stage 1: subject and hair masks. Subject from the clean plate; hair given on key frames and carried by optical flow.

use serde::{Deserialize, Serialize};
use strandflow_core::{Mask, Place, Plane, Report, RgbImage};
use strandflow_image::{
    appearance::{Appearance, features},
    filter::{gaussian_where, halved},
    flow::{Flow, FlowOptions, flow},
    matte::{MatteOptions, from_plate},
    morph::eroded,
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
    /// Log likelihood ratio below which appearance is silent.
    pub appearance_dead_zone: f32,
    /// Sigma over which appearance is averaged \[px\].
    pub appearance_px: f32,
    /// Sigma over which texture is measured \[px\].
    pub texture_px: f32,
}

impl Default for MasksSettings {
    fn default() -> Self {
        Self {
            threshold: 6.0,
            speck_area_px: 24,
            hole_area_px: 60,
            shadow: 0.06,
            border_px: 6,
            appearance_weight: 1.5,
            appearance_dead_zone: 0.5,
            appearance_px: 0.8,
            texture_px: 2.0,
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
            ("appearance_dead_zone", self.appearance_dead_zone, 0.0, 20.0),
            ("appearance_px", self.appearance_px, 0.0, 20.0),
            ("texture_px", self.texture_px, 0.5, 20.0),
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
    let prior = carried.unwrap_or_else(|| key_hair.clone());
    let key_subject = from_plate(key_image, input.plate, &matte_options(settings));
    let (Some(key_region), Some(region)) = (around(&key_subject), around(subject)) else {
        return within(&prior, subject);
    };
    let look = |image: &RgbImage, region: Region| {
        features(&region.crop(image, |&c| c), settings.appearance_px, settings.texture_px)
    };
    let key_hair = key_region.crop(key_hair, |&m| f32::from(m) / 255.0);
    let key_core = core(&key_region.crop(&key_subject, |&m| m));
    // Mixtures teach nothing: only the core of the subject is learnt from, and as "not hair" only what is wider than the
    // gaps between strands.
    let not_hair = eroded(&key_hair.map(|&h| h < 0.3), 1);
    let model = Appearance::learn(&look(key_image, key_region), |i| {
        if key_core.data[i] { (key_hair.data[i], f32::from(u8::from(not_hair.data[i]))) } else { (0.0, 0.0) }
    });
    let Some(model) = model else { return within(&prior, subject) };
    let coverage = region.crop(subject, |&m| f32::from(m) / 255.0);
    let inside = core(&region.crop(subject, |&m| m));
    let prior = region.crop(&prior, |&m| f32::from(m) / 255.0);
    let (colour, texture) = model.log_ratio(&look(input.image, region));
    let share = hair_share(&prior, &coverage, &inside, (&colour, &texture), settings);
    let covered = |(s, c): (&f32, &f32)| (255.0 * s * c).round() as u8;
    let data = share.data.iter().zip(&coverage.data).map(covered).collect();
    let hair = Plane { width: share.width, height: share.height, data };
    let mut mask = empty(input.image);
    region.paste(&hair, &mut mask);
    mask
}

/// The share of hair in the subject at every pixel, 0 to 1: flow prior and appearance in the core, its continuation in
/// the soft border, where colours are mixed with the plate.
fn hair_share(
    prior: &Plane<f32>,
    coverage: &Plane<f32>,
    inside: &Plane<bool>,
    (colour, texture): (&Plane<f32>, &Plane<f32>),
    settings: &MasksSettings,
) -> Plane<f32> {
    let core = inside.map(|&m| if m { 1.0 } else { 0.0 });
    let colour = gaussian_where(colour, &core, settings.appearance_px);
    let decide = |i: usize| {
        if !inside.data[i] {
            return 0.0;
        }
        let p = (prior.data[i] / coverage.data[i].max(0.3)).clamp(0.04, 0.96);
        let look = colour.data[i].clamp(-4.0, 4.0) + 0.5 * texture.data[i].clamp(-2.0, 2.0);
        // The same look comes again in every frame: mild evidence must not add up against the flow.
        let strong = look.signum() * (look.abs() - settings.appearance_dead_zone).max(0.0);
        let logit = (p / (1.0 - p)).ln() + settings.appearance_weight * strong;
        1.0 / (1.0 + (-logit).exp())
    };
    let mut share = Plane { data: (0..coverage.data.len()).map(decide).collect(), ..*coverage };
    let (near, far) = (gaussian_where(&share, &core, 2.0), gaussian_where(&share, &core, 6.0));
    for i in 0..share.data.len() {
        if !inside.data[i] && coverage.data[i] > 0.0 {
            // Too far from any core (a flying wisp): what flow says.
            let flown = (prior.data[i] / coverage.data[i].max(0.3)).min(1.0);
            let continued = if near.data[i] > 0.0 { near.data[i] } else { far.data[i] };
            share.data[i] = continued.max(flown);
        }
    }
    share
}

/// The subject's surroundings.
fn around(subject: &Mask) -> Option<Region> {
    Some(Region::bounding(subject, |&m| m > 0)?.grown(8, subject.width, subject.height))
}

/// Pixels whose neighbourhood is all subject: no mixture with the plate.
fn core(subject: &Mask) -> Plane<bool> {
    eroded(&subject.map(|&m| m >= 230), 1)
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
