//! Stage 4: the scalp from the hulls of the slow start in head space, and blue-noise roots under the hair mask.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use strandflow_core::{Mask, Occupancy, Place, Report, Rig, RigidTransform, TriMesh};

use crate::{SettingViolation, StageError};

mod evidence;
mod fit;
mod roots;
mod surface;
mod template;

/// One frame of the slow start.
pub struct ScalpFrame<'a> {
    /// The head's motion since the first frame.
    pub world_from_head: RigidTransform,
    /// Its hull.
    pub hull: &'a Occupancy,
    /// Its subject masks, one a view.
    pub subjects: Vec<&'a Mask>,
    /// Its hair masks, one a view.
    pub hairs: Vec<&'a Mask>,
}

/// What the stage needs.
pub struct ScalpInput<'a> {
    /// The cameras.
    pub rig: &'a Rig,
    /// Frames in which the head hardly moved, the first frame of the take first.
    pub frames: &'a [ScalpFrame<'a>],
    /// Markers at the first frame \[mm\]; they sit on the hair close to the scalp.
    pub markers: &'a [DVec3],
    /// Gravity \[mm/s²\], world.
    pub gravity: DVec3,
    /// Seed of the root sampling.
    pub seed: u64,
}

/// The scalp and its roots, in head space (the world of the first frame).
#[derive(Clone, Debug, PartialEq)]
pub struct Scalp {
    /// Closed head surface under the hair (scalp, and as much of face and neck as the hull gives); outward faces \[mm\].
    pub mesh: TriMesh,
    /// Hair roots on the surface \[mm\], length N.
    pub roots: Vec<DVec3>,
    /// Outward unit normals at the roots, length N.
    pub normals: Vec<DVec3>,
}

/// Settings of stage `scalp`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ScalpSettings {
    /// Roots to sample.
    pub root_count: usize,
    /// How far inside the fitted head the scalp lies at the nape, where hair hides the head in every view \[mm\].
    pub nape_margin_mm: f64,
}

impl Default for ScalpSettings {
    fn default() -> Self {
        Self { root_count: 8000, nape_margin_mm: 6.0 }
    }
}

impl ScalpSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        let mut found = Vec::new();
        SettingViolation::unless(
            (1..=200_000).contains(&self.root_count),
            &mut found,
            ("scalp.root_count", self.root_count),
            ("1..=200000", "a head bears about 100000 hairs"),
        );
        SettingViolation::unless(
            (0.0..=20.0).contains(&self.nape_margin_mm),
            &mut found,
            ("scalp.nape_margin_mm", self.nape_margin_mm),
            ("0.0..=20.0", "napes differ by a few millimetres"),
        );
        found
    }
}

/// The scalp and its roots, in head space.
///
/// The hulls of the slow start, brought to head space, share a volume that is tighter than each; in it a generic head is
/// placed and scaled, then corrected towards the markers. Roots are sampled by area on its hair-bearing part.
///
/// Errors: no frame, fewer than three markers, non-finite numbers, hulls that share no volume, no place that bears hair.
///
/// Deviation: the paper takes the scalp as a shrunk hull. Under hair that hangs off the head a shrunk hull is centimetres
/// outside it; the generic head knows where a head can be. At the nape, which hair hides in every view, the scalp lies
/// `nape_margin_mm` inside the fitted head: hair cannot be where the head is, so that a nape too far out costs the strands
/// below it, and one too far in hardly anything. On the two captures with truth the mean distance of the true roots to the
/// surface is 1.1 mm, with true masks and poses.
///
/// Reference: Zhang et al. 2012 §4; Wei et al. 2005.
pub fn scalp(input: &ScalpInput, settings: &ScalpSettings, report: &mut Report) -> Result<Scalp, StageError> {
    check_input(input)?;
    let nothing =
        |fact: &str, hint: &str| StageError::Input { place: Place::default(), fact: fact.into(), hint: hint.into() };
    let evidence = evidence::gather(input).ok_or_else(|| {
        nothing("the hulls of the slow start share no volume in head space", "check the head pose of the first frames")
    })?;
    if input.markers.len() < 3 {
        let fact = format!("{} markers at the first frame", input.markers.len());
        report.warn(Place::frame(0), fact, "the scalp rests on the hull and the proportions of a mean head");
    }
    let head = fit::fit_head(&evidence, input.markers);
    let mesh = surface::head_surface(&head, &evidence, input.markers, settings.nape_margin_mm);
    let (roots, normals) = roots::sample_roots(&mesh, &head.shape, input, settings.root_count);
    if roots.len() < settings.root_count {
        return Err(nothing(
            "no part of the scalp projects into the hair masks",
            "look at the hair masks of the first frames and at the head pose",
        ));
    }
    Ok(Scalp { mesh, roots, normals })
}

fn check_input(input: &ScalpInput) -> Result<(), StageError> {
    if input.frames.is_empty() {
        return Err(StageError::Input {
            place: Place::default(),
            fact: "no frame of the slow start".into(),
            hint: "the first frame of the take must have a head pose and a hull".into(),
        });
    }
    for (number, frame) in input.frames.iter().enumerate() {
        let views = input.rig.view_count();
        if frame.subjects.len() != views || frame.hairs.len() != views {
            return Err(StageError::Input {
                place: Place::default(),
                fact: format!("frame {number} of the slow start lacks a mask of one of the {views} views"),
                hint: "run the masks of all views first".into(),
            });
        }
        let pose = &frame.world_from_head;
        if !pose.rotation.is_finite() || !pose.translation.is_finite() {
            return Err(StageError::NonFinite {
                place: Place::default(),
                what: "a head pose of the slow start".into(),
            });
        }
    }
    if !input.markers.iter().all(|m| m.is_finite()) || !input.gravity.is_finite() {
        return Err(StageError::NonFinite { place: Place::frame(0), what: "a marker or gravity".into() });
    }
    Ok(())
}
