//! Where thin hair lets the plate shine through, learnt from the mask of a key frame.
//!
//! A matte by colour needs the colour of what stands before the plate. In a fringe of single hairs no pixel shows it, and
//! the mixture is taken for the subject. The given mask knows the difference.

use strandflow_core::{Mask, Plane, RgbImage};
use strandflow_image::{
    boost::{BoostOptions, Boosted},
    filter::gaussian,
    morph::{dilated, eroded},
    region::Region,
};

use crate::hair_look::{KeyView, SOLID};

/// Pixels around the matte in which hair may be.
const MARGIN: usize = 3;
/// Pixels around bare skin in which the hair mask does not say where the subject ends.
const SKIN_MARGIN: usize = 8;
/// Edge of the squares that take turns in teaching and testing \[px\].
const SQUARE: usize = 16;
/// Errors on pixels that did not teach, over those of the matte, up to which the learnt edge is believed.
const BETTER: f64 = 0.9;

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
    /// Hair of the given mask is subject, and so is what is solid without hair (skin, markers). A pixel with less hair than
    /// half is plate, unless skin is near: there it may be either.
    fn of(key: &KeyView, matte: &Mask, region: Region) -> Self {
        let here = region.crop(matte, |&m| m);
        let hair = region.crop(key.hair, |&m| f32::from(m) / 255.0);
        let bare = (0..hair.data.len()).map(|i| here.data[i] >= SOLID && hair.data[i] < 0.5).collect();
        let bare = eroded(&Plane { data: bare, width: region.width, height: region.height }, 2);
        let (near_bare, possible) = (dilated(&bare, SKIN_MARGIN), dilated(&here.map(|&m| m > 0), MARGIN));
        let known = |i: usize| bare.data[i] || hair.data[i] >= 0.5 || !near_bare.data[i];
        let used = (0..hair.data.len()).filter(|&i| possible.data[i] && known(i)).collect();
        let target = hair.data.iter().zip(&bare.data).map(|(&h, &b)| if b { 1.0 } else { h }).collect();
        Self { columns: columns(key.image, key.plate, matte, region), target, matte: here.data, used }
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

/// Difference from the plate at several scales, its size, and the matte's own coverage: one column each.
fn columns(image: &RgbImage, plate: &RgbImage, matte: &Mask, region: Region) -> Vec<Vec<f32>> {
    let channel = |source: &RgbImage, c: usize| region.crop(source, |colour| f32::from(colour[c]));
    let difference = [0, 1, 2].map(|c| {
        let (seen, behind) = (channel(image, c), channel(plate, c));
        Plane { data: seen.data.iter().zip(&behind.data).map(|(a, b)| a - b).collect(), ..seen }
    });
    let mut columns = Vec::new();
    for sigma in [0.6, 1.2, 2.5, 5.0] {
        let [r, g, b] = [0, 1, 2].map(|c| gaussian(&difference[c], sigma).data);
        if sigma != 1.2 && sigma != 5.0 {
            columns.push((0..r.len()).map(|i| (r[i] * r[i] + g[i] * g[i] + b[i] * b[i]).sqrt()).collect());
        }
        columns.extend([r, g, b]);
    }
    let coverage = region.crop(matte, |&m| f32::from(m) / 255.0);
    columns.push(gaussian(&coverage, 3.0).data);
    columns.push(coverage.data);
    columns
}
