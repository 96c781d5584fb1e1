//! Stage 5: 2D orientation and confidence of every hair pixel.
//!
//! Reference: Zhang et al. 2012 §4; Paris et al. 2004 (oriented filters on hair); Granlund & Knutsson 1995.

use serde::{Deserialize, Serialize};
use strandflow_core::{Mask, Place, Plane, Report, RgbImage};
use strandflow_image::{colour::luma_of, filter::gaussian_where, gabor::OrientationEnergy, region::Region};

use crate::{Mode, SettingViolation, StageError};

mod energies;
mod exposure;
mod focus;
pub mod steady;

/// Share of the hair that may be overexposed without a word. Lower, and every good highlight is a finding; higher, and a lamp
/// that burns out a lock goes unsaid.
const OVEREXPOSED: f32 = 0.03;

/// Undirected orientation of the strands in one image.
#[derive(Clone, Debug, PartialEq)]
pub struct OrientationMap {
    /// Angle in [0, π) from +x (right) towards +y (down) \[rad\]; 0 where there is no hair.
    pub angle: Plane<f32>,
    /// Trust 0 to 1; 0 where there is no hair.
    pub confidence: Plane<f32>,
}

/// Settings of stage `orient`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OrientSettings {
    /// Wavelengths of the filter pairs \[px\]: about two to four times the width of a visible strand or wisp.
    pub wavelengths_px: Vec<f32>,
    /// Orientations of the bank (even); more than twelve read the same.
    pub orientations: usize,
    /// Sigma of the high pass that removes shading \[px\].
    pub highpass_px: f32,
    /// Sensor noise \[code values\]: texture below it is not amplified.
    pub noise_codes: f32,
    /// Sigma of pooling in every direction \[px\].
    pub pool_px: f32,
    /// Sigma of pooling along the strands \[px\].
    pub pool_along_px: f32,
    /// Sigma of the surroundings that decide where a pixel's own texture says little \[px\]; 0: none.
    pub support_px: f32,
    /// Frames before, and frames after, that a frame's orientations are averaged with; 0: none.
    pub over_frames: usize,
}

impl Default for OrientSettings {
    fn default() -> Self {
        Self {
            wavelengths_px: vec![4.5, 6.5, 9.5],
            orientations: 12,
            highpass_px: 6.0,
            noise_codes: 4.0,
            pool_px: 5.0,
            pool_along_px: 10.0,
            support_px: 12.0,
            over_frames: 2,
        }
    }
}

impl OrientSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        let mut found = Vec::new();
        let mut unless = |ok, field: &str, value: String, range: &str, reason: &str| {
            SettingViolation::unless(ok, &mut found, (&format!("orient.{field}"), value), (range, reason));
        };
        let waves = &self.wavelengths_px;
        unless(
            !waves.is_empty() && waves.iter().all(|w| (2.5..=64.0).contains(w)),
            "wavelengths_px",
            format!("{waves:?}"),
            "one or more of 2.5..=64",
            "shorter waves are not sampled, longer ones are shading",
        );
        unless(
            self.orientations >= 4 && self.orientations.is_multiple_of(2),
            "orientations",
            self.orientations.to_string(),
            "an even number from 4 on",
            "orientations are filtered in mirrored pairs",
        );
        unless(self.over_frames <= 10, "over_frames", self.over_frames.to_string(), "0..=10", "hair turns within more");
        for (field, value, low, high) in [
            ("highpass_px", self.highpass_px, 1.0, 100.0),
            ("noise_codes", self.noise_codes, 0.1, 100.0),
            ("pool_px", self.pool_px, 0.0, 30.0),
            ("support_px", self.support_px, 0.0, 60.0),
            ("pool_along_px", self.pool_along_px, 0.0, 60.0),
        ] {
            let range = format!("{low}..={high}");
            unless((low..=high).contains(&value), field, value.to_string(), &range, "outside what images can show");
        }
        found
    }
}

/// The orientation map of one view and frame. Where the hair is overexposed, and where the whole view shows it blurred,
/// confidence falls, and the report says so.
pub fn orient(
    place: &Place,
    image: &RgbImage,
    hair: &Mask,
    subject: &Mask,
    mode: Mode,
    settings: &OrientSettings,
    report: &mut Report,
) -> Result<OrientationMap, StageError> {
    for (mask, what) in [(hair, "hair mask"), (subject, "subject mask")] {
        if (mask.width, mask.height) != (image.width, image.height) {
            return Err(StageError::Input {
                place: place.clone(),
                fact: format!(
                    "the {what} is {}×{}, the image {}×{}",
                    mask.width, mask.height, image.width, image.height
                ),
                hint: "give masks at the size of the images".into(),
            });
        }
    }
    let mut map = OrientationMap {
        angle: Plane::filled(image.width, image.height, 0.0),
        confidence: Plane::filled(image.width, image.height, 0.0),
    };
    let Some(bounds) = Region::bounding(hair, |&m| m >= 128) else {
        report.warn(place.clone(), "the hair mask is empty", "no orientations");
        return Ok(map);
    };
    let margin = settings.wavelengths_px.iter().fold(0.0f32, |a, &b| a.max(b)) as usize + 2;
    let region = bounds.grown(margin, image.width, image.height);
    let coverage = region.crop(hair, |&m| f32::from(m) / 255.0);
    let inside = region.crop(hair, |&m| m >= 128);
    let detail = detail(&region.crop(image, |&c| luma_of(c)), &coverage, settings);
    let trust = Trust::of(image, (region, &inside), subject, &detail, settings);
    trust.say(place, report);
    let texture = texture(detail, &coverage, settings);
    let energies = match mode {
        Mode::Paper => energies::of_pixels(&texture, settings),
        Mode::Robust => energies::pooled(&texture, &inside, settings),
    };
    let (angle, mut confidence) = read_out(&energies, &inside);
    trust.lower(&mut confidence);
    region.paste(&angle, &mut map.angle);
    region.paste(&confidence, &mut map.confidence);
    Ok(map)
}

/// How a view shows the hair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footage {
    /// Energy of the hair's finest texture over that of one twice as coarse: about 1 where hair is sharp. `None` where there
    /// is too little hair to tell.
    pub sharpness: Option<f32>,
    /// Share of the hair with a clipped channel.
    pub overexposed: f32,
}

impl Footage {
    /// Whether [`orient`] takes the hair for blurred.
    pub fn is_blurred(&self) -> bool {
        self.sharpness.is_some_and(|found| found < focus::SHARP)
    }

    /// Whether [`orient`] finds the hair overexposed.
    pub fn is_overexposed(&self) -> bool {
        self.overexposed > OVEREXPOSED
    }
}

/// How an image shows the hair, by the measures of [`orient`] itself; `None` where the hair mask is empty. All of one size.
pub fn footage(image: &RgbImage, hair: &Mask, subject: &Mask, settings: &OrientSettings) -> Option<Footage> {
    let bounds = Region::bounding(hair, |&m| m >= 128)?;
    let margin = settings.wavelengths_px.iter().fold(0.0f32, |a, &b| a.max(b)) as usize + 2;
    let region = bounds.grown(margin, image.width, image.height);
    let coverage = region.crop(hair, |&m| f32::from(m) / 255.0);
    let inside = region.crop(hair, |&m| m >= 128);
    let detail = detail(&region.crop(image, |&c| luma_of(c)), &coverage, settings);
    let trust = Trust::of(image, (region, &inside), subject, &detail, settings);
    Some(Footage { sharpness: trust.sharpness, overexposed: trust.exposure.share })
}

/// How far the footage of a view can be believed at all.
struct Trust {
    exposure: exposure::Exposure,
    /// Sharpness of the hair, where there is enough to tell.
    sharpness: Option<f32>,
}

impl Trust {
    fn of(
        image: &RgbImage,
        (region, inside): (Region, &Plane<bool>),
        subject: &Mask,
        detail: &Plane<f32>,
        settings: &OrientSettings,
    ) -> Self {
        let waves = settings.wavelengths_px.iter().copied();
        let (short, long) = (waves.clone().fold(f32::INFINITY, f32::min), waves.fold(0.0, f32::max));
        let sharpness = focus::sharpness(detail, inside, focus::noise_of(image, subject), short);
        Self { exposure: exposure::exposure(image, region, inside, 0.5 * long), sharpness }
    }

    /// Sharpness of hair that is blurred.
    fn blurred(&self) -> Option<f32> {
        self.sharpness.filter(|&found| found < focus::SHARP)
    }

    fn say(&self, place: &Place, report: &mut Report) {
        if self.exposure.share > OVEREXPOSED {
            let fact = format!("{:.0} % of the hair is overexposed", 100.0 * self.exposure.share);
            report.warn(place.clone(), fact, "patches of it have no confidence");
        }
        if let Some(found) = self.blurred() {
            let fact = format!("the hair is blurred (sharpness {found:.2}, {} or more is sharp)", focus::SHARP);
            report.warn(place.clone(), fact, "out of focus or too fast: confidence is lowered over the whole view");
        }
    }

    fn lower(&self, confidence: &mut Plane<f32>) {
        if let Some(trust) = &self.exposure.trust {
            confidence.data.iter_mut().zip(&trust.data).for_each(|(c, t)| *c *= t);
        }
        if let Some(found) = self.blurred() {
            confidence.data.iter_mut().for_each(|c| *c *= found / focus::SHARP);
        }
    }
}

/// Luma without shading, 0 outside the hair: the mask's border makes no edge.
fn detail(luma: &Plane<f32>, coverage: &Plane<f32>, settings: &OrientSettings) -> Plane<f32> {
    let shading = gaussian_where(luma, coverage, settings.highpass_px);
    Plane { data: (0..luma.data.len()).map(|i| (luma.data[i] - shading.data[i]) * coverage.data[i]).collect(), ..*luma }
}

/// Detail with even contrast.
fn texture(detail: Plane<f32>, coverage: &Plane<f32>, settings: &OrientSettings) -> Plane<f32> {
    let variance = gaussian_where(&detail.map(|d| d * d), coverage, 1.5 * settings.highpass_px);
    let floor = settings.noise_codes * settings.noise_codes;
    let mut out = detail;
    out.data.iter_mut().zip(&variance.data).for_each(|(d, v)| *d /= (v + floor).sqrt());
    out
}

/// Of energies, which neither overflow nor vanish when squared.
fn length(x: f32, y: f32) -> f32 {
    (x * x + y * y).sqrt()
}

/// The angle in [0, π) of a doubled-angle vector \[rad\].
fn angle_of(cos2: f32, sin2: f32) -> f32 {
    let half = 0.5 * sin2.atan2(cos2);
    let angle = if half < 0.0 { half + std::f32::consts::PI } else { half };
    if angle >= std::f32::consts::PI { 0.0 } else { angle }
}

/// Angle in [0, π) and confidence: the share of the energy that agrees on the angle.
fn read_out(energies: &OrientationEnergy, inside: &Plane<bool>) -> (Plane<f32>, Plane<f32>) {
    let at = |i: usize| {
        if !inside.data[i] {
            return (0.0, 0.0);
        }
        let (c, s, total) = (energies.cos2.data[i], energies.sin2.data[i], energies.total.data[i]);
        (angle_of(c, s), if total > 0.0 { (length(c, s) / total).min(1.0) } else { 0.0 })
    };
    let (angle, confidence) = (0..inside.data.len()).map(at).unzip();
    let plane = |data| Plane { width: inside.width, height: inside.height, data };
    (plane(angle), plane(confidence))
}
