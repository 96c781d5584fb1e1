//! Where thin hair lets the plate shine through, learnt from the mask of a key frame.
//!
//! A matte by colour needs the colour of what stands before the plate. In a fringe of single hairs no pixel shows it, and
//! the mixture is taken for the subject. The given mask knows the difference.

use glam::Vec3;
use strandflow_core::{Mask, Place, Plane, RgbImage};
use strandflow_image::{
    boost::Boosted,
    filter::{gaussian, gaussian_reach},
    morph::dilated,
    region::Region,
};

use crate::{
    StageError,
    key_frame::{KeyView, Lesson, channels, columns_at, difference, odds_at, size},
    masks::{MasksSettings, around},
};

/// Pixels around the matte in which hair may be.
const MARGIN: usize = 3;
/// Blur of the learnt edge \[px\]: single pixels flicker with the noise.
const STEADY_PX: f32 = 0.5;
/// Blur under which difference from the plate and share of hair are compared \[px\].
const SEEN_PX: f32 = 2.0;
/// Colour between strands \[code values from the plate's\]: nearer than the first it is the plate, beyond the second not.
const PLATE_OR_SKIN: (f32, f32) = (8.0, 16.0);
/// Edge of the squares that take turns in teaching and testing \[px\].
const SQUARE: usize = 16;
/// Errors on pixels that did not teach, over those of the matte, up to which the learnt edge is believed: a clear gain, since
/// what is learnt on one frame is used on all.
const BETTER: f64 = 0.85;
/// One in so many pixels teaches.
const TAUGHT: usize = 2;

/// Subject against plate at the border of hair; nothing where the given mask tells no more than the matte does.
#[derive(Clone, Debug, PartialEq)]
pub struct HairEdge(Option<Boosted>);

impl HairEdge {
    /// Learns from a key frame. Nothing where its subject is given, and where the given mask tells no more than the matte
    /// does: learnt on every other square, the edge must do better on the squares between.
    ///
    /// # Errors
    /// Sizes differ.
    pub fn learn(place: &Place, key: &KeyView, settings: &MasksSettings) -> Result<Self, StageError> {
        key.must_be_of_one_size(place)?;
        let matte = key.matte(settings);
        let region = around(&matte).filter(|_| key.subject.is_none());
        Ok(Self(region.and_then(|region| learnt(key, &matte, region))))
    }

    /// The matte of an image, thinned where the plate is seen between strands.
    pub fn thinned(&self, image: &RgbImage, plate: &RgbImage, matte: &Mask) -> Mask {
        let (Some(model), Some(region)) = (&self.0, around(matte)) else { return matte.clone() };
        let covered = region.crop(matte, |&m| m > 0);
        let (possible, asked) = (dilated(&covered, MARGIN), dilated(&covered, MARGIN + gaussian_reach(STEADY_PX)));
        let odds = odds_at(model, &columns(image, plate, matte, region), &asked);
        let likely = odds.iter().map(|o| 1.0 / (1.0 + (-o).exp())).collect();
        let likely = gaussian(&Plane { width: region.width, height: region.height, data: likely }, STEADY_PX);
        let coverage = |(&l, &p): (&f32, &bool)| if p && l >= 0.1 { (255.0 * l).round() as u8 } else { 0 };
        let data = likely.data.iter().zip(&possible.data).map(coverage).collect();
        let mut subject = Plane::filled(matte.width, matte.height, 0u8);
        region.paste(&Plane { width: region.width, height: region.height, data }, &mut subject);
        subject
    }
}

/// Trees, if they do clearly better than the matte on pixels that did not teach them.
fn learnt(key: &KeyView, matte: &Mask, region: Region) -> Option<Boosted> {
    let (columns, target) = (columns(key.image, key.plate, matte, region), known(key, matte, region));
    let used: Vec<usize> = (0..target.len()).filter(|&i| target[i].is_some()).collect();
    let target: Vec<f32> = target.into_iter().map(Option::unwrap_or_default).collect();
    let matte = region.crop(matte, |&m| m);
    let trees = |pixels: &[usize]| {
        let taught: Vec<usize> = pixels.iter().copied().step_by(TAUGHT).collect();
        Lesson::of(&columns, &target, &taught, 1.0).learnt()
    };
    let errors = |learnt_on: &[usize], tested_on: &[usize]| {
        let odds = trees(learnt_on)?.log_odds(&columns_at(&columns, tested_on));
        let wrong = |found: bool, i: usize| usize::from(found != (target[i] >= 0.5));
        let by_trees: usize = tested_on.iter().zip(&odds).map(|(&i, o)| wrong(*o > 0.0, i)).sum();
        let by_matte: usize = tested_on.iter().map(|&i| wrong(matte.data[i] >= 128, i)).sum();
        Some((by_trees, by_matte))
    };
    let in_turn = |i: usize| (i % region.width / SQUARE + i / region.width / SQUARE).is_multiple_of(2);
    let (half, other): (Vec<usize>, Vec<usize>) = used.iter().partition(|&&i| in_turn(i));
    let ((a, b), (c, d)) = (errors(&half, &other)?, errors(&other, &half)?);
    if (a + c) as f64 > BETTER * (b + d) as f64 { None } else { trees(&used) }
}

/// What the mask of a key frame knows of each pixel: the share of the subject, or nothing.
///
/// Hair of the given mask is subject; where no hair is near, the matte knows. Between strands, the plate may be behind them,
/// or skin: where what is not hair has another colour than the plate.
fn known(key: &KeyView, matte: &Mask, region: Region) -> Vec<Option<f32>> {
    let here = region.crop(matte, |&m| m);
    let hair = region.crop(key.hair, |&m| f32::from(m) / 255.0);
    let (near_hair, possible) = (dilated(&hair.map(|&h| h > 0.1), MARGIN), dilated(&here.map(|&m| m > 0), MARGIN));
    let behind = colour_behind(key, &hair, region);
    let target = |i: usize| match behind[i] {
        _ if !possible.data[i] => None,
        _ if hair.data[i] >= 0.5 => Some(hair.data[i]),
        _ if !near_hair.data[i] => Some(f32::from(here.data[i]) / 255.0),
        away if away < PLATE_OR_SKIN.0 => Some(hair.data[i]),
        away if away > PLATE_OR_SKIN.1 => Some(1.0),
        _ => None,
    };
    (0..hair.data.len()).map(target).collect()
}

/// How far the colour seen between hair is from the plate's \[code values\], brightness of the hair left out: what the
/// difference from the plate holds beyond the hair's share of full hair's difference.
fn colour_behind(key: &KeyView, hair: &Plane<f32>, region: Region) -> Vec<f32> {
    let share = gaussian(hair, SEEN_PX);
    let away = difference(key.image, key.plate, region).map(|plane| gaussian(&plane, SEEN_PX));
    let colour = channels(key.image, region);
    let of_hair = |planes: &[Plane<f32>; 3]| {
        let full = (0..share.data.len()).filter(|&i| share.data[i] > 0.95);
        let (sum, count) = full.fold((Vec3::ZERO, 0.0), |(s, n), i| (s + vector(planes, i), n + 1.0));
        sum / f32::max(count, 1.0)
    };
    let (difference, shade) = (of_hair(&away), of_hair(&colour).normalize_or_zero());
    let behind = |i: usize| {
        let beyond = vector(&away, i) - difference * share.data[i];
        beyond.reject_from_normalized(shade).length()
    };
    (0..share.data.len()).map(behind).collect()
}

fn vector(planes: &[Plane<f32>; 3], at: usize) -> Vec3 {
    Vec3::new(planes[0].data[at], planes[1].data[at], planes[2].data[at])
}

/// Difference from the plate at several scales, its size, and the matte's own coverage: one column each.
fn columns(image: &RgbImage, plate: &RgbImage, matte: &Mask, region: Region) -> Vec<Vec<f32>> {
    let difference = difference(image, plate, region);
    let mut columns = vec![size(&difference, 0.6), size(&difference, 2.5)];
    for sigma in [0.6, 1.2, 2.5, 5.0] {
        columns.extend(difference.iter().map(|plane| gaussian(plane, sigma).data));
    }
    let coverage = region.crop(matte, |&m| f32::from(m) / 255.0);
    columns.push(gaussian(&coverage, 3.0).data);
    columns.push(coverage.data);
    columns
}
