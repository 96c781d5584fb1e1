//! Stage 1: subject and hair masks. Subject from the clean plate; hair given on key frames and carried by optical flow.

use serde::{Deserialize, Serialize};
use strandflow_core::{Mask, Place, Plane, Report, RgbImage};
use strandflow_image::{
    boost::{BoostOptions, Boosted},
    colour::luma_of,
    filter::{gaussian_where, halved},
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
    /// Weight of the carried mask's log odds against those of the look.
    pub carried_weight: f32,
    /// Sigma over which the decision is averaged \[px\].
    pub decision_px: f32,
    /// Trees that learn the look of hair on a key frame.
    pub trees: usize,
}

impl Default for MasksSettings {
    fn default() -> Self {
        Self {
            threshold: 6.0,
            speck_area_px: 24,
            hole_area_px: 60,
            shadow: 0.06,
            border_px: 6,
            carried_weight: 0.3,
            decision_px: 0.7,
            trees: 80,
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
            ("carried_weight", self.carried_weight, 0.0, 100.0),
            ("decision_px", self.decision_px, 0.0, 20.0),
            ("trees", self.trees as f32, 1.0, 1000.0),
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

/// Hair by its look learnt on the key frame, with the carried mask as prior.
fn decided_hair(
    input: &MasksInput,
    subject: &Mask,
    carried: Option<Mask>,
    (key_image, key_hair): (&RgbImage, &Mask),
    settings: &MasksSettings,
) -> Mask {
    let carried = carried.unwrap_or_else(|| key_hair.clone());
    let key_subject = from_plate(key_image, input.plate, &matte_options(settings));
    let model = hair_look(key_image, &key_subject, key_hair, settings);
    let (Some(model), Some(region)) = (model, around(subject)) else { return within(&carried, subject) };
    let coverage = region.crop(subject, |&m| f32::from(m) / 255.0);
    let prior = region.crop(&carried, |&m| f32::from(m) / 255.0);
    let odds = model.log_odds(&look(input.image, subject, region));
    let share = |i: usize| {
        let p = (prior.data[i] / coverage.data[i].max(0.3)).clamp(0.04, 0.96);
        let logit = settings.carried_weight * (p / (1.0 - p)).ln() + odds[i];
        1.0 / (1.0 + (-logit).exp())
    };
    let share = Plane { data: (0..coverage.data.len()).map(share).collect(), ..coverage };
    let share = gaussian_where(&share, &coverage.map(|c| c + 1e-3), settings.decision_px);
    let covered = |(&s, &c): (&f32, &f32)| (255.0 * at_border(s, c) * c).round() as u8;
    let data = share.data.iter().zip(&coverage.data).map(covered).collect();
    let mut mask = empty(input.image);
    region.paste(&Plane { width: share.width, height: share.height, data }, &mut mask);
    mask
}

/// The share of hair in what the subject covers of a pixel. Where colours are mixed with the plate the look falls short, and
/// a pixel counts as the class that is more likely: hair from a share of 0.35 on.
fn at_border(share: f32, coverage: f32) -> f32 {
    if coverage < 0.98 { 1.0 / (1.0 + (-30.0 * (share - 0.35)).exp()) } else { share }
}

/// What hair looks like in a view, learnt on a key frame; `None` where the subject is all hair or has none.
///
/// Every second pixel that is all subject takes part, in a chequered pattern; the target is the coverage that the user gave.
fn hair_look(image: &RgbImage, subject: &Mask, hair: &Mask, settings: &MasksSettings) -> Option<Boosted> {
    let region = around(subject)?;
    let columns = look(image, subject, region);
    let (covered, hair) = (region.crop(subject, |&m| m), region.crop(hair, |&m| f32::from(m) / 255.0));
    let chequered = |i: &usize| (i % hair.width + i / hair.width).is_multiple_of(2);
    let learnt: Vec<usize> = (0..hair.data.len()).filter(|&i| covered.data[i] >= 230).filter(chequered).collect();
    let columns: Vec<Vec<f32>> = columns.iter().map(|c| learnt.iter().map(|&i| c[i]).collect()).collect();
    let target: Vec<f32> = learnt.iter().map(|&i| hair.data[i]).collect();
    let options = BoostOptions { trees: settings.trees, ..BoostOptions::default() };
    Boosted::learn(&columns, &target, &vec![1.0; target.len()], &options)
}

/// The features of every pixel of a region, a column each: colour ratios (which shade leaves alone) and brightness at
/// three scales, the energy of fine texture at two, and the texture itself.
fn look(image: &RgbImage, subject: &Mask, region: Region) -> Vec<Vec<f32>> {
    // The plate must not bleed into the subject's colours.
    let weight = region.crop(subject, |&m| if m >= 230 { 1.0 } else { 1e-3 + 0.2 * (f32::from(m) / 255.0).powi(2) });
    let rgb = [0, 1, 2].map(|c| region.crop(image, |colour| f32::from(colour[c])));
    let luma = region.crop(image, |&colour| luma_of(colour));
    let ratio = |a: &Plane<f32>, b: &Plane<f32>| -> Vec<f32> {
        a.data.iter().zip(&b.data).map(|(a, b)| ((a + 5.0) / (b + 5.0)).ln()).collect()
    };
    let mut columns = Vec::new();
    for sigma in [0.7, 1.5, 3.0] {
        let [r, g, b] = rgb.each_ref().map(|plane| gaussian_where(plane, &weight, sigma));
        columns.extend([ratio(&r, &g), ratio(&g, &b), gaussian_where(&luma, &weight, sigma).data]);
    }
    let (fine, coarse) = (gaussian_where(&luma, &weight, 0.7), gaussian_where(&luma, &weight, 2.0));
    let detail = Plane { data: fine.data.iter().zip(&coarse.data).map(|(a, b)| a - b).collect(), ..fine };
    let energy = detail.map(|d| d * d);
    for sigma in [1.5, 4.0] {
        columns.push(gaussian_where(&energy, &weight, sigma).data.iter().map(|e| 0.5 * (e + 0.1).ln()).collect());
    }
    columns.push(detail.data);
    columns
}

/// The subject's surroundings.
fn around(subject: &Mask) -> Option<Region> {
    Some(Region::bounding(subject, |&m| m > 0)?.grown(8, subject.width, subject.height))
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
