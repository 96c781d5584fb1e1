//! What hair looks like in a view, learnt from the mask of a key frame.
//!
//! *Deviation*: the paper carries the given mask along optical flow alone. Flow slips where hair lifts off skin; the look
//! learnt from the same given mask does not drift.

use strandflow_core::{Mask, Place, Plane, RgbImage};
use strandflow_image::{
    boost::Boosted,
    colour::luma_of,
    filter::{Window, gaussian_where},
    morph::dilated,
    region::Region,
};

use crate::{
    StageError,
    key_frame::{KeyView, Lesson, channels, difference, odds_at, size},
    masks::{MasksSettings, around},
};

/// Where pixels count as fully covered.
const SOLID: u8 = 230;
/// Weight of a pixel of another view or shade; each view has its own light and its own camera.
const OTHERS: f32 = 0.3;
/// Shares of its brightness at which the view is shown again: hair that moves casts its shadow elsewhere.
const SHADES: [f32; 2] = [0.5, 0.75];
/// One in so many pixels teaches, of the view itself and of others.
const TAUGHT: (usize, usize) = (2, 8);

/// What hair looks like in a view: hair against skin, markers and the plate between strands. Nothing where the key frame shows
/// no subject, or one that is all hair or has none.
#[derive(Clone, Debug, PartialEq)]
pub struct HairLook(Option<Boosted>);

/// What the key frame of a view teaches other views: it may show shadowed skin that they show only later, or never.
/// Nothing where its sizes do not agree and where it shows no subject.
pub struct HairLesson(Option<Lesson>);

impl HairLesson {
    /// Of a key frame.
    pub fn of(key: &KeyView, settings: &MasksSettings) -> Self {
        let matte = key.is_of_one_size().then(|| key.matte(settings));
        let shown = matte.and_then(|matte| around(&matte).map(|region| taught(key, &matte, region, OTHERS, TAUGHT.1)));
        Self(shown)
    }
}

impl HairLook {
    /// Learns from the key frame of a view, and, with less weight, from those of the others.
    ///
    /// # Errors
    /// Sizes of the view itself differ.
    pub fn learn<'a>(
        place: &Place,
        own: &KeyView,
        others: impl IntoIterator<Item = &'a HairLesson>,
        settings: &MasksSettings,
    ) -> Result<Self, StageError> {
        own.must_be_of_one_size(place)?;
        let matte = own.matte(settings);
        let Some(region) = around(&matte) else { return Ok(Self(None)) };
        let mut lesson = taught(own, &matte, region, 1.0, TAUGHT.0);
        others.into_iter().filter_map(|HairLesson(other)| other.as_ref()).for_each(|other| lesson.add(other));
        for shade in SHADES {
            let image = own.image.map(|colour| colour.map(|code| (f32::from(code) * shade).round() as u8));
            lesson.add(&taught(&KeyView { image: &image, ..*own }, &matte, region, OTHERS, TAUGHT.0));
        }
        Ok(Self(lesson.learnt()))
    }

    /// Log odds of hair at the pixels of a region of an image that are within `reach` of the subject; 0 at the others, and
    /// where nothing was learnt.
    pub fn hair_odds(
        &self,
        image: &RgbImage,
        plate: &RgbImage,
        subject: &Mask,
        region: Region,
        reach: usize,
    ) -> Vec<f32> {
        let Some(model) = &self.0 else { return vec![0.0; region.width * region.height] };
        let asked = dilated(&region.crop(subject, |&m| m > 0), reach);
        odds_at(model, &hair_columns((image, plate), subject, region), &asked)
    }
}

/// What is hair: one in `step` of the pixels that the subject covers, rows taking turns.
fn taught(key: &KeyView, subject: &Mask, region: Region, weight: f32, step: usize) -> Lesson {
    let solid = region.crop(subject, |&m| m >= SOLID);
    let hair = region.crop(key.hair, |&m| f32::from(m) / 255.0);
    let in_turn = |i: usize| (i % region.width + i / region.width).is_multiple_of(step);
    let chosen: Vec<usize> = (0..hair.data.len()).filter(|&i| solid.data[i] && in_turn(i)).collect();
    Lesson::of(&hair_columns((key.image, key.plate), subject, region), &hair.data, &chosen, weight)
}

/// Ratios of channels (they bear shadow), luma, and texture, at several scales: one column each. Colours are averaged over
/// the subject, so that the plate does not bleed in.
fn hair_columns((image, plate): (&RgbImage, &RgbImage), subject: &Mask, region: Region) -> Vec<Vec<f32>> {
    let weight = region.crop(subject, |&m| if m >= SOLID { 1.0 } else { 1e-3 + 0.2 * (f32::from(m) / 255.0).powi(2) });
    let rgb = channels(image, region);
    let luma = region.crop(image, |&colour| luma_of(colour));
    let mut columns = Vec::new();
    for sigma in [0.7, 1.5, 3.0] {
        let window = Window::new(&weight, sigma);
        let [r, g, b] = [0, 1, 2].map(|c| window.mean(&rgb[c], &weight));
        let ratio = |(a, b): (&f32, &f32)| ((a + 5.0) / (b + 5.0)).ln();
        columns.push(r.data.iter().zip(&g.data).map(ratio).collect());
        columns.push(g.data.iter().zip(&b.data).map(ratio).collect());
        columns.push((0..r.data.len()).map(|i| 0.299 * r.data[i] + 0.587 * g.data[i] + 0.114 * b.data[i]).collect());
    }
    let (fine, coarse) = (gaussian_where(&luma, &weight, 0.7), gaussian_where(&luma, &weight, 2.0));
    let detail = Plane { data: fine.data.iter().zip(&coarse.data).map(|(a, b)| a - b).collect(), ..fine };
    let energy = detail.map(|d| d * d);
    for sigma in [1.5, 4.0] {
        columns.push(gaussian_where(&energy, &weight, sigma).data.iter().map(|e| 0.5 * (e + 0.1).ln()).collect());
    }
    columns.push(detail.data);
    // How far from the plate, for thin hair.
    let away = difference(image, plate, region);
    columns.extend([0.7, 2.5].map(|sigma| size(&away, sigma)));
    columns
}
