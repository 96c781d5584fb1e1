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
    masks::{MasksSettings, around, matte_options},
};

/// Where pixels count as fully covered.
const SOLID: u8 = 230;

/// What hair looks like in a view.
#[derive(Clone, Debug, PartialEq)]
pub struct HairLook {
    /// Hair against skin, markers and the plate between strands; `None` where the key frame shows no subject, or one that is
    /// all hair or has none.
    hair: Option<Boosted>,
}

impl HairLook {
    /// Learns from the image of a key frame, the clean plate and the given hair mask; and from the subject mask where one
    /// is given.
    ///
    /// # Errors
    /// Sizes differ.
    pub fn learn(
        place: &Place,
        (image, plate, hair): (&RgbImage, &RgbImage, &Mask),
        given_subject: Option<&Mask>,
        settings: &MasksSettings,
    ) -> Result<Self, StageError> {
        let sizes = [(plate.width, plate.height), (hair.width, hair.height)];
        let subject_size = given_subject.map(|m| (m.width, m.height));
        if sizes.into_iter().chain(subject_size).any(|size| size != (image.width, image.height)) {
            return Err(StageError::Input {
                place: place.clone(),
                fact: "image, clean plate and masks of the key frame differ in size".into(),
                hint: "images, plates and masks of a view have one size".into(),
            });
        }
        let matte = given_subject.map_or_else(|| from_plate(image, plate, &matte_options(settings)), Mask::clone);
        Ok(Self { hair: learnt_hair((image, plate), &matte, hair) })
    }

    /// Log odds of hair at every pixel of a region of an image; 0 where nothing was learnt.
    pub fn hair_odds(&self, image: &RgbImage, plate: &RgbImage, subject: &Mask, region: Region) -> Vec<f32> {
        match &self.hair {
            Some(model) => model.log_odds(&hair_columns((image, plate), subject, region)),
            None => vec![0.0; region.width * region.height],
        }
    }
}

/// Hair against what else is subject, from the pixels that the subject covers.
fn learnt_hair((image, plate): (&RgbImage, &RgbImage), subject: &Mask, hair: &Mask) -> Option<Boosted> {
    let region = around(subject)?;
    let solid = region.crop(subject, |&m| m >= SOLID);
    let hair = region.crop(hair, |&m| f32::from(m) / 255.0);
    learnt(&hair_columns((image, plate), subject, region), &hair, &solid)
}

/// Trees from every other of the pixels in use, rows taking turns.
fn learnt(columns: &[Vec<f32>], target: &Plane<f32>, used: &Plane<bool>) -> Option<Boosted> {
    let in_turn = |i: usize| (i % target.width + i / target.width).is_multiple_of(2);
    let chosen: Vec<usize> = (0..target.data.len()).filter(|&i| used.data[i] && in_turn(i)).collect();
    let pick = |column: &[f32]| chosen.iter().map(|&i| column[i]).collect::<Vec<f32>>();
    let columns: Vec<Vec<f32>> = columns.iter().map(|c| pick(c)).collect();
    let target = pick(&target.data);
    Boosted::learn(&columns, &target, &vec![1.0; target.len()], &BoostOptions::default())
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
