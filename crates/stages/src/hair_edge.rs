//! Where thin hair lets the plate shine through, learnt from the mask of a key frame.
//!
//! A matte by colour needs the colour of what stands before the plate. In a fringe of single hairs no pixel shows it, and
//! the mixture is taken for the subject. The given mask knows the difference.

use glam::Vec3;
use strandflow_core::{Mask, Plane, RgbImage};
use strandflow_image::{
    boost::{BoostOptions, Boosted},
    filter::gaussian,
    morph::dilated,
    region::Region,
};

use crate::hair_look::KeyView;

/// Pixels around the matte in which hair may be.
const MARGIN: usize = 3;
/// Blur under which difference from the plate and share of hair are compared \[px\].
const SEEN_PX: f32 = 2.0;
/// Colour between strands \[code values from the plate's\]: nearer than the first it is the plate, beyond the second not.
const PLATE_OR_SKIN: (f32, f32) = (8.0, 16.0);
/// Edge of the squares that take turns in teaching and testing \[px\].
const SQUARE: usize = 16;
/// Errors on pixels that did not teach, over those of the matte, up to which the learnt edge is believed. Views of the
/// captures in which it gained had 0.68 to 0.81; at 0.87 it lost.
const BETTER: f64 = 0.85;

/// Subject against plate at the border of hair.
#[derive(Clone, Debug, PartialEq)]
pub struct HairEdge(Boosted);

impl HairEdge {
    /// Learns from a key frame and its matte. `None` where the given mask tells no more than the matte does: learnt on
    /// every other square, the edge must do better on the squares between.
    pub fn learn(key: &KeyView, matte: &Mask, region: Region) -> Option<Self> {
        let lesson = Lesson::of(key, matte, region);
        let width = region.width;
        let teaches = |i: usize| (i % width / SQUARE + i / width / SQUARE).is_multiple_of(2);
        let (half, other): (Vec<usize>, Vec<usize>) = lesson.used.iter().partition(|&&i| teaches(i));
        let errors = |learnt_on: &[usize], tested_on: &[usize]| {
            let model = lesson.learnt(learnt_on)?;
            let odds = model.log_odds(&lesson.columns_at(tested_on));
            let wrong = |found: bool, i: usize| usize::from(found != (lesson.target[i] >= 0.5));
            let learnt: usize = tested_on.iter().zip(&odds).map(|(&i, o)| wrong(*o > 0.0, i)).sum();
            let matte: usize = tested_on.iter().map(|&i| wrong(lesson.matte[i] >= 128, i)).sum();
            Some((learnt, matte))
        };
        let ((a, b), (c, d)) = (errors(&half, &other)?, errors(&other, &half)?);
        if (a + c) as f64 > BETTER * (b + d) as f64 {
            return None;
        }
        lesson.learnt(&lesson.used).map(Self)
    }

    /// The matte of an image, thinned where the plate is seen between strands.
    pub fn thinned(&self, image: &RgbImage, plate: &RgbImage, matte: &Mask, region: Region) -> Mask {
        let odds = self.0.log_odds(&columns(image, plate, matte, region));
        let possible = dilated(&region.crop(matte, |&m| m > 0), MARGIN);
        // Single pixels flicker with the noise: half a pixel of blur gains 0.001 to 0.002 of IoU on the captures.
        let likely = odds.iter().map(|o| 1.0 / (1.0 + (-o).exp())).collect();
        let likely = gaussian(&Plane { width: region.width, height: region.height, data: likely }, 0.5);
        let coverage = |(&l, &p): (&f32, &bool)| if p && l >= 0.1 { (255.0 * l).round() as u8 } else { 0 };
        let data = likely.data.iter().zip(&possible.data).map(coverage).collect();
        let mut subject = Plane::filled(matte.width, matte.height, 0u8);
        region.paste(&Plane { width: region.width, height: region.height, data }, &mut subject);
        subject
    }
}

/// What a key frame teaches, over a region.
struct Lesson {
    columns: Vec<Vec<f32>>,
    target: Vec<f32>,
    matte: Vec<u8>,
    /// Pixels of which the mask knows whether they are subject.
    used: Vec<usize>,
}

impl Lesson {
    /// Hair of the given mask is subject; where no hair is near, the matte knows. Between strands, the plate may be behind
    /// them, or skin: where what is not hair has another colour than the plate.
    fn of(key: &KeyView, matte: &Mask, region: Region) -> Self {
        let here = region.crop(matte, |&m| m);
        let hair = region.crop(key.hair, |&m| f32::from(m) / 255.0);
        let (near_hair, possible) = (dilated(&hair.map(|&h| h > 0.1), MARGIN), dilated(&here.map(|&m| m > 0), MARGIN));
        let behind = colour_behind(key, &hair, region);
        let target = |i: usize| match behind[i] {
            _ if hair.data[i] >= 0.5 => Some(hair.data[i]),
            _ if !near_hair.data[i] => Some(f32::from(here.data[i]) / 255.0),
            away if away < PLATE_OR_SKIN.0 => Some(hair.data[i]),
            away if away > PLATE_OR_SKIN.1 => Some(1.0),
            _ => None,
        };
        let targets: Vec<Option<f32>> = (0..hair.data.len()).map(|i| target(i).filter(|_| possible.data[i])).collect();
        Self {
            columns: columns(key.image, key.plate, matte, region),
            used: (0..targets.len()).filter(|&i| targets[i].is_some()).collect(),
            target: targets.into_iter().map(Option::unwrap_or_default).collect(),
            matte: here.data,
        }
    }

    fn columns_at(&self, pixels: &[usize]) -> Vec<Vec<f32>> {
        self.columns.iter().map(|column| pixels.iter().map(|&i| column[i]).collect()).collect()
    }

    /// Trees from every other of some pixels.
    fn learnt(&self, pixels: &[usize]) -> Option<Boosted> {
        let pixels: Vec<usize> = pixels.iter().copied().step_by(2).collect();
        let target: Vec<f32> = pixels.iter().map(|&i| self.target[i]).collect();
        Boosted::learn(&self.columns_at(&pixels), &target, &vec![1.0; target.len()], &BoostOptions::default())
    }
}

/// How far the colour seen between hair is from the plate's \[code values\], brightness of the hair left out: what the
/// difference from the plate holds beyond the hair's share of full hair's difference.
fn colour_behind(key: &KeyView, hair: &Plane<f32>, region: Region) -> Vec<f32> {
    let share = gaussian(hair, SEEN_PX);
    let away = difference(key.image, key.plate, region).map(|plane| gaussian(&plane, SEEN_PX));
    let colour = [0, 1, 2].map(|c| region.crop(key.image, |pixel| f32::from(pixel[c])));
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

/// Image minus plate, one plane a channel.
fn difference(image: &RgbImage, plate: &RgbImage, region: Region) -> [Plane<f32>; 3] {
    let channel = |source: &RgbImage, c: usize| region.crop(source, |colour| f32::from(colour[c]));
    [0, 1, 2].map(|c| {
        let (seen, behind) = (channel(image, c), channel(plate, c));
        Plane { data: seen.data.iter().zip(&behind.data).map(|(a, b)| a - b).collect(), ..seen }
    })
}

/// The size of a difference after a blur.
fn size(difference: &[Plane<f32>; 3], sigma: f32) -> Vec<f32> {
    let [r, g, b] = [0, 1, 2].map(|c| gaussian(&difference[c], sigma).data);
    (0..r.len()).map(|i| (r[i] * r[i] + g[i] * g[i] + b[i] * b[i]).sqrt()).collect()
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
