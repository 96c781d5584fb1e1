//! Stage 1: subject and hair masks. Subject from the clean plate; hair given on key frames and carried by optical flow.

use serde::{Deserialize, Serialize};
use strandflow_core::{Mask, Place, Plane, Report, RgbImage};
use strandflow_image::{
    filter::{gaussian_reach, gaussian_where},
    flow::flow_of_region,
    matte::{MatteOptions, from_plate},
    region::Region,
};

use crate::{Mode, SettingViolation, StageError, hair_edge::HairEdge, hair_look::HairLook};

mod framing;
mod people;

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
    /// The next frame towards the key frame, unless this is the key frame.
    pub neighbour: Option<NeighbourFrame<'a>>,
    /// The given hair mask of the nearest key frame.
    pub key: Option<&'a Mask>,
    /// What hair looks like in this view (robust mode).
    pub look: Option<&'a HairLook>,
    /// How the border of thin hair looks in this view (robust mode).
    pub edge: Option<&'a HairEdge>,
}

/// A frame before or after, and what was found there.
pub struct NeighbourFrame<'a> {
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
    /// Weight of the carried mask's log odds against those of the look (robust mode).
    pub carried_weight: f32,
    /// Sigma over which decisions by look are averaged \[px\].
    pub look_px: f32,
}

impl Default for MasksSettings {
    fn default() -> Self {
        Self {
            threshold: 6.0,
            speck_area_px: 24,
            hole_area_px: 60,
            shadow: 0.06,
            border_px: 6,
            carried_weight: 0.5,
            look_px: 0.7,
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
            ("look_px", self.look_px, 0.0, 20.0),
        ] {
            let range = format!("{low}..={high}");
            let ok = (low..=high).contains(&value);
            SettingViolation::unless(ok, &mut found, (&format!("masks.{field}"), value), (&range, reason));
        }
        found
    }
}

/// The masks of one view and frame. Another person, apart from the one with the hair, is left out; that, and hair that the
/// image cuts off, is in the report.
pub fn masks(
    input: &MasksInput,
    mode: Mode,
    settings: &MasksSettings,
    report: &mut Report,
) -> Result<Masks, StageError> {
    check_sizes(input)?;
    let look = input.look.filter(|_| mode == Mode::Robust);
    let edge = input.edge.filter(|_| mode == Mode::Robust && input.given_subject.is_none());
    let matte = match input.given_subject {
        Some(given) => given.clone(),
        None => from_plate(input.image, input.plate, &matte_options(settings)),
    };
    let Some(bounds) = Region::bounding(&matte, |&m| m >= 128) else {
        report.warn(input.place.clone(), "nothing differs from the clean plate", "subject and hair masks are empty");
        let hair = input.given_hair.cloned().unwrap_or_else(|| empty(input.image));
        return Ok(Masks { subject: matte, hair });
    };
    // What follows the flow alone needs it finer; as a prior, a quarter of the resolution does as well in half the time.
    let halvings = if look.is_some() { 2 } else { 1 };
    let expected = input.given_hair.cloned().or_else(|| carried_hair(input, &matte, bounds, halvings));
    let Some(expected) = expected.or_else(|| input.key.cloned()) else {
        report.warn(input.place.clone(), "no hair mask of any frame of this view", "hair mask is empty");
        return Ok(Masks { subject: matte, hair: empty(input.image) });
    };
    let matte = match input.given_subject {
        Some(_) => matte,
        None => people::the_one_with_hair(matte, &expected, settings.border_px, &input.place, report),
    };
    let subject = edge.map_or_else(|| matte.clone(), |edge| edge.thinned(input.image, input.plate, &matte));
    let hair = match (input.given_hair, look) {
        (Some(given), _) => given.clone(),
        (None, Some(look)) => decided_hair(input, (&matte, &subject), &expected, look, settings),
        (None, None) => within(&expected, &subject),
    };
    framing::say_where_cut(&hair, &input.place, report);
    Ok(Masks { subject, hair })
}

/// The subject of a key frame: what differs from the plate, without another person.
pub(crate) fn subject_of_key(image: &RgbImage, plate: &RgbImage, hair: &Mask, settings: &MasksSettings) -> Mask {
    let matte = from_plate(image, plate, &matte_options(settings));
    // The key frame's own item reports what is left out.
    people::the_one_with_hair(matte, hair, settings.border_px, &Place::default(), &mut Report::default())
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

/// The hair mask of the neighbouring frame, carried along the flow from this frame to that one.
fn carried_hair(input: &MasksInput, subject: &Mask, bounds: Region, halvings: usize) -> Option<Mask> {
    let neighbour = input.neighbour.as_ref()?;
    let there = Region::bounding(&neighbour.masks.subject, |&m| m >= 128)?;
    let (width, height) = (input.image.width, input.image.height);
    let region = bounds.union(&there).grown(16, width, height);
    let back = flow_of_region(input.image, neighbour.image, region, halvings);
    let hair = region.crop(&neighbour.masks.hair, |&m| f32::from(m));
    let moved = strandflow_image::flow::warped(&hair, &back);
    let mut mask = Plane::filled(subject.width, subject.height, 0u8);
    region.paste(&moved.map(|m| m.round() as u8), &mut mask);
    Some(mask)
}

/// Hair by its look, with the carried mask as prior: within the subject, whose matte from the plate tells where colours
/// are free of the plate.
fn decided_hair(
    input: &MasksInput,
    (matte, subject): (&Mask, &Mask),
    carried: &Mask,
    look: &HairLook,
    settings: &MasksSettings,
) -> Mask {
    let Some(region) = around(matte) else { return within(carried, subject) };
    let coverage = region.crop(matte, |&m| f32::from(m) / 255.0);
    let prior = region.crop(carried, |&m| f32::from(m) / 255.0);
    // What the blur below still sees of decisions beside the subject.
    let reach = gaussian_reach(settings.look_px);
    let odds = look.hair_odds(input.image, input.plate, matte, region, reach);
    let share = |i: usize| {
        // The flow is never surer than 1 in 25: it slips at every border.
        let p = (prior.data[i] / coverage.data[i].max(0.3)).clamp(0.04, 0.96);
        let logit = settings.carried_weight * (p / (1.0 - p)).ln() + odds[i];
        1.0 / (1.0 + (-logit).exp())
    };
    let share = Plane { data: (0..coverage.data.len()).map(share).collect(), ..coverage };
    let share = gaussian_where(&share, &coverage.map(|c| c + 1e-3), settings.look_px);
    let mut mask = empty(input.image);
    region.paste(&share.map(|s| (255.0 * s).round() as u8), &mut mask);
    // Both are doubts as much as coverages: a product would count the same doubt twice at every border.
    within(&mask, subject)
}

/// The subject's surroundings.
pub(crate) fn around(subject: &Mask) -> Option<Region> {
    Some(Region::bounding(subject, |&m| m > 0)?.grown(8, subject.width, subject.height))
}

fn check_sizes(input: &MasksInput) -> Result<(), StageError> {
    let size = (input.image.width, input.image.height);
    let mut others = vec![("clean plate", (input.plate.width, input.plate.height))];
    let mask_size = |mask: &Mask| (mask.width, mask.height);
    others.extend(input.given_subject.map(|m| ("given subject mask", mask_size(m))));
    others.extend(input.given_hair.map(|m| ("given hair mask", mask_size(m))));
    others.extend(input.key.map(|m| ("hair mask of the key frame", mask_size(m))));
    others.extend(input.neighbour.as_ref().map(|n| ("neighbouring frame", (n.image.width, n.image.height))));
    match others.into_iter().find(|(_, other)| *other != size) {
        None => Ok(()),
        Some((what, (w, h))) => Err(StageError::Input {
            place: input.place.clone(),
            fact: format!("the {what} is {w}×{h}, the image {}×{}", size.0, size.1),
            hint: "images, plates and masks of a view have one size".into(),
        }),
    }
}
