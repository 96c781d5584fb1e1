//! What a key frame shows, and pixels of it that teach.

use strandflow_core::{Mask, Place, Plane, RgbImage};
use strandflow_image::{
    boost::{BoostOptions, Boosted},
    filter::gaussian,
    region::Region,
};

use crate::{
    StageError,
    masks::{MasksSettings, subject_of_key},
};

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
    pub(crate) fn is_of_one_size(&self) -> bool {
        let sizes = [(self.plate.width, self.plate.height), (self.hair.width, self.hair.height)];
        let subject = self.subject.map(|m| (m.width, m.height));
        sizes.into_iter().chain(subject).all(|size| size == (self.image.width, self.image.height))
    }

    /// An error where image, plate and masks differ in size.
    pub(crate) fn must_be_of_one_size(&self, place: &Place) -> Result<(), StageError> {
        self.is_of_one_size().then_some(()).ok_or_else(|| StageError::Input {
            place: place.clone(),
            fact: "image, clean plate and masks of the key frame differ in size".into(),
            hint: "images, plates and masks of a view have one size".into(),
        })
    }

    pub(crate) fn matte(&self, settings: &MasksSettings) -> Mask {
        self.subject.map_or_else(|| subject_of_key(self.image, self.plate, self.hair, settings), Mask::clone)
    }
}

/// Pixels that teach: one column a feature, the share of the first class, and how much each counts.
pub(crate) struct Lesson {
    columns: Vec<Vec<f32>>,
    target: Vec<f32>,
    weight: Vec<f32>,
}

impl Lesson {
    /// Some pixels of a region, of which there are all columns and targets.
    pub(crate) fn of(columns: &[Vec<f32>], target: &[f32], pixels: &[usize], weight: f32) -> Self {
        let target = pixels.iter().map(|&i| target[i]).collect();
        Self { columns: columns_at(columns, pixels), target, weight: vec![weight; pixels.len()] }
    }

    pub(crate) fn add(&mut self, more: &Self) {
        self.columns.iter_mut().zip(&more.columns).for_each(|(all, column)| all.extend(column));
        self.target.extend(&more.target);
        self.weight.extend(&more.weight);
    }

    /// Trees; `None` where a class is empty.
    pub(crate) fn learnt(&self) -> Option<Boosted> {
        Boosted::learn(&self.columns, &self.target, &self.weight, &BoostOptions::default())
    }
}

/// The features of some pixels.
pub(crate) fn columns_at(columns: &[Vec<f32>], pixels: &[usize]) -> Vec<Vec<f32>> {
    columns.iter().map(|column| pixels.iter().map(|&i| column[i]).collect()).collect()
}

/// The log odds at some pixels of all features; 0 at the others.
pub(crate) fn odds_at(model: &Boosted, columns: &[Vec<f32>], asked: &Plane<bool>) -> Vec<f32> {
    let pixels: Vec<usize> = (0..asked.data.len()).filter(|&i| asked.data[i]).collect();
    let mut odds = vec![0.0; asked.data.len()];
    let found = model.log_odds(&columns_at(columns, &pixels));
    pixels.into_iter().zip(found).for_each(|(i, found)| odds[i] = found);
    odds
}

/// The channels of a region \[code values\].
pub(crate) fn channels(image: &RgbImage, region: Region) -> [Plane<f32>; 3] {
    [0, 1, 2].map(|c| region.crop(image, |colour| f32::from(colour[c])))
}

/// Image minus plate, one plane a channel.
pub(crate) fn difference(image: &RgbImage, plate: &RgbImage, region: Region) -> [Plane<f32>; 3] {
    let (mut seen, behind) = (channels(image, region), channels(plate, region));
    for (seen, behind) in seen.iter_mut().zip(&behind) {
        seen.data.iter_mut().zip(&behind.data).for_each(|(a, b)| *a -= b);
    }
    seen
}

/// The size of a difference after a blur.
pub(crate) fn size(difference: &[Plane<f32>; 3], sigma: f32) -> Vec<f32> {
    let [r, g, b] = [0, 1, 2].map(|c| gaussian(&difference[c], sigma).data);
    (0..r.len()).map(|i| (r[i] * r[i] + g[i] * g[i] + b[i] * b[i]).sqrt()).collect()
}
