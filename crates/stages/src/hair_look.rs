//! What hair looks like in a view, learnt from the mask of a key frame.
//!
//! *Deviation*: the paper carries the given mask along optical flow alone. Flow slips where hair lifts off skin; the look
//! learnt from the same given mask does not drift.

use strandflow_core::{Mask, Place, Plane, RgbImage};
use strandflow_image::{
    boost::{BoostOptions, Boosted},
    colour::luma_of,
    filter::{gaussian, gaussian_where},
    matte::from_plate,
    region::Region,
};

use crate::{
    StageError,
    hair_edge::HairEdge,
    masks::{MasksSettings, around, matte_options},
};

/// Where pixels count as fully covered.
pub(crate) const SOLID: u8 = 230;
/// Weight of a pixel of another view or shade; each view has its own light and its own camera.
const OTHERS: f32 = 0.3;
/// Shares of its brightness at which the view is shown again: hair that moves casts its shadow elsewhere.
const SHADES: [f32; 2] = [0.5, 0.75];
/// One in so many pixels teaches, of the view itself and of others.
const TAUGHT: (usize, usize) = (2, 8);

/// What a view shows on a key frame.
#[derive(Clone, Copy, Debug)]
pub struct KeyView<'a> {
    /// The image.
    pub image: &'a RgbImage,
    /// The view without the subject.
    pub plate: &'a RgbImage,
    /// The given hair mask.
    pub hair: &'a Mask,
    /// The subject mask, where one is given.
    pub subject: Option<&'a Mask>,
}

impl KeyView<'_> {
    fn is_of_one_size(&self) -> bool {
        let sizes = [(self.plate.width, self.plate.height), (self.hair.width, self.hair.height)];
        let subject = self.subject.map(|m| (m.width, m.height));
        sizes.into_iter().chain(subject).all(|size| size == (self.image.width, self.image.height))
    }

    fn matte(&self, settings: &MasksSettings) -> Mask {
        self.subject.map_or_else(|| from_plate(self.image, self.plate, &matte_options(settings)), Mask::clone)
    }
}

/// What hair looks like in a view.
#[derive(Clone, Debug, PartialEq)]
pub struct HairLook {
    /// Hair against skin, markers and the plate between strands; `None` where the key frame shows no subject, or one that is
    /// all hair or has none.
    hair: Option<Boosted>,
    /// The border of thin hair; `None` where the plate does better or the subject is given.
    edge: Option<HairEdge>,
}

impl HairLook {
    /// Learns from the key frame of a view, and, with less weight, from those of the others: a view may show shadowed skin
    /// later that only others show yet. Others whose sizes do not agree are passed over.
    ///
    /// # Errors
    /// Sizes of the view itself differ.
    pub fn learn(
        place: &Place,
        own: &KeyView,
        others: &[KeyView],
        settings: &MasksSettings,
    ) -> Result<Self, StageError> {
        if !own.is_of_one_size() {
            return Err(StageError::Input {
                place: place.clone(),
                fact: "image, clean plate and masks of the key frame differ in size".into(),
                hint: "images, plates and masks of a view have one size".into(),
            });
        }
        let matte = own.matte(settings);
        let Some(region) = around(&matte) else { return Ok(Self { hair: None, edge: None }) };
        let mut lesson = Lesson::of(own, &matte, region, 1.0, TAUGHT.0);
        let other = |key: &KeyView| {
            let matte = key.matte(settings);
            Some(Lesson::of(key, &matte, around(&matte)?, OTHERS, TAUGHT.1))
        };
        others.iter().filter(|key| key.is_of_one_size()).filter_map(other).for_each(|more| lesson.add(more));
        for shade in SHADES {
            let image = own.image.map(|colour| colour.map(|code| (f32::from(code) * shade).round() as u8));
            lesson.add(Lesson::of(&KeyView { image: &image, ..*own }, &matte, region, OTHERS, TAUGHT.0));
        }
        let edge = own.subject.is_none().then(|| HairEdge::learn(own, &matte, region)).flatten();
        Ok(Self { hair: lesson.learnt(), edge })
    }

    /// The matte of an image, thinned where the plate is seen between strands.
    pub fn thinned(&self, image: &RgbImage, plate: &RgbImage, matte: &Mask) -> Mask {
        match (&self.edge, around(matte)) {
            (Some(edge), Some(region)) => edge.thinned(image, plate, matte, region),
            _ => matte.clone(),
        }
    }

    /// Log odds of hair at every pixel of a region of an image; 0 where nothing was learnt.
    pub fn hair_odds(&self, image: &RgbImage, plate: &RgbImage, subject: &Mask, region: Region) -> Vec<f32> {
        match &self.hair {
            Some(model) => model.log_odds(&hair_columns((image, plate), subject, region)),
            None => vec![0.0; region.width * region.height],
        }
    }
}

/// Pixels that teach what is hair: one column a feature, the share of hair, and how much each counts.
struct Lesson {
    columns: Vec<Vec<f32>>,
    target: Vec<f32>,
    weight: Vec<f32>,
}

impl Lesson {
    /// One in `step` of the pixels that the subject covers, rows taking turns.
    fn of(key: &KeyView, subject: &Mask, region: Region, weight: f32, step: usize) -> Self {
        let solid = region.crop(subject, |&m| m >= SOLID);
        let hair = region.crop(key.hair, |&m| f32::from(m) / 255.0);
        let in_turn = |i: usize| (i % region.width + i / region.width).is_multiple_of(step);
        let chosen: Vec<usize> = (0..hair.data.len()).filter(|&i| solid.data[i] && in_turn(i)).collect();
        let pick = |column: &[f32]| chosen.iter().map(|&i| column[i]).collect::<Vec<f32>>();
        let columns = hair_columns((key.image, key.plate), subject, region);
        Self {
            columns: columns.iter().map(|c| pick(c)).collect(),
            target: pick(&hair.data),
            weight: vec![weight; chosen.len()],
        }
    }

    fn add(&mut self, more: Self) {
        self.columns.iter_mut().zip(more.columns).for_each(|(all, column)| all.extend(column));
        self.target.extend(more.target);
        self.weight.extend(more.weight);
    }

    fn learnt(&self) -> Option<Boosted> {
        Boosted::learn(&self.columns, &self.target, &self.weight, &BoostOptions::default())
    }
}

/// Ratios of channels (they bear shadow), luma, and texture, at several scales: one column each. Colours are averaged over
/// the subject, so that the plate does not bleed in.
fn hair_columns((image, plate): (&RgbImage, &RgbImage), subject: &Mask, region: Region) -> Vec<Vec<f32>> {
    let weight = region.crop(subject, |&m| if m >= SOLID { 1.0 } else { 1e-3 + 0.2 * (f32::from(m) / 255.0).powi(2) });
    let rgb = [0, 1, 2].map(|c| region.crop(image, |colour| f32::from(colour[c])));
    let luma = region.crop(image, |&colour| luma_of(colour));
    let mut columns = Vec::new();
    for sigma in [0.7, 1.5, 3.0] {
        let [r, g, b] = [0, 1, 2].map(|c| gaussian_where(&rgb[c], &weight, sigma));
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
    let behind = [0, 1, 2].map(|c| region.crop(plate, |colour| f32::from(colour[c])));
    let away = [0, 1, 2].map(|c| {
        let data = rgb[c].data.iter().zip(&behind[c].data).map(|(a, b)| a - b).collect();
        Plane { data, ..rgb[c] }
    });
    for sigma in [0.7, 2.5] {
        let [r, g, b] = [0, 1, 2].map(|c| gaussian(&away[c], sigma).data);
        columns.push((0..r.len()).map(|i| (r[i] * r[i] + g[i] * g[i] + b[i] * b[i]).sqrt()).collect());
    }
    columns
}
