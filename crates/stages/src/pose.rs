//! Stage 3: markers tracked from the labels of a frame and corrections in others, and the rigid head pose of every frame
//! (eq. 1).

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use strandflow_core::{FrameRange, ImageSource, Report, Rig, RigidTransform};

use crate::{Mode, SettingViolation, StageError};

mod anchor;
mod late;
mod sight;
mod solve;
mod sweep;
mod track;
mod tracker;

use solve::between;
use tracker::Tracker;

/// A marker labelled in a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MarkerLabel {
    /// The marker's number.
    pub id: u32,
    /// Image point \[px\] per view index in which a person sees it.
    pub views: BTreeMap<usize, DVec2>,
}

/// What the stage needs.
pub struct PoseInput<'a> {
    /// The cameras.
    pub rig: &'a Rig,
    /// All images.
    pub images: &'a dyn ImageSource,
    /// The frames of the take.
    pub frames: FrameRange,
    /// The frame that tracks begin from, forward and backward: the first in which enough markers are labelled.
    pub labelled: usize,
    /// All markers, with their labels in that frame; those that begin in another one have none there.
    pub labels: &'a [MarkerLabel],
    /// Where some of these markers are in other frames, by frame.
    pub corrections: &'a BTreeMap<usize, Vec<MarkerLabel>>,
}

/// Marker tracks and head poses.
#[derive(Clone, Debug, PartialEq)]
pub struct HeadPoses {
    /// Motion of the head from the first frame to each frame, in world coordinates (eq. 1's C^t). Head space is the
    /// world of the first frame.
    pub world_from_head: Vec<RigidTransform>,
    /// Marker positions \[mm\], shape (T, M); `None` where not triangulated. In the first frame where the head's pose puts
    /// all that have a place on the head, seen there or not.
    pub markers: Vec<Vec<Option<DVec3>>>,
    /// Marker image points \[px\], shape (T, views, M); `None` where lost or occluded. In robust mode at most half way
    /// from where the pose puts them to where they were measured; of a marker that is hidden in part, less.
    pub tracks: Vec<Vec<Vec<Option<DVec2>>>>,
    /// Root mean square distance of the measured markers to where the pose puts them \[px\], per frame.
    pub rms_px: Vec<f64>,
    /// Markers that the pose of each frame rests on.
    pub used: Vec<u32>,
    /// Whether the pose of a frame was interpolated.
    pub interpolated: Vec<bool>,
}

/// Settings of stage `pose`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PoseSettings {
    /// Markers a pose must rest on; frames with fewer are interpolated.
    pub markers_needed: usize,
    /// Radius of a marker ball in the images \[px\].
    pub marker_radius_px: f64,
    /// How far from its prediction a marker is searched \[px\].
    pub search_px: f64,
    /// Share of its own score that a marker must reach to be found in a search; where the pose is known a fifth is enough.
    pub accept: f64,
    /// Largest reprojection error of an observation that agrees \[px\].
    pub inlier_px: f64,
    /// Largest forward–backward error of a track followed by flow \[px\].
    pub round_trip_px: f64,
}

impl Default for PoseSettings {
    fn default() -> Self {
        Self {
            markers_needed: 5,
            marker_radius_px: 5.0,
            search_px: 14.0,
            accept: 0.6,
            inlier_px: 2.5,
            round_trip_px: 1.0,
        }
    }
}

impl PoseSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        let mut found = Vec::new();
        SettingViolation::unless(
            self.markers_needed >= 3,
            &mut found,
            ("pose.markers_needed", self.markers_needed),
            ("3 or more", "fewer points do not fix a pose"),
        );
        for (field, value, low, high) in [
            ("marker_radius_px", self.marker_radius_px, 1.0, 100.0),
            ("search_px", self.search_px, 1.0, 200.0),
            ("accept", self.accept, 0.05, 1.0),
            ("inlier_px", self.inlier_px, 0.1, 50.0),
            ("round_trip_px", self.round_trip_px, 0.05, 20.0),
        ] {
            let (ok, range) = ((low..=high).contains(&value), format!("{low}..={high}"));
            let name = format!("pose.{field}");
            SettingViolation::unless(ok, &mut found, (&name, value), (&range, "outside what images can show"));
        }
        found
    }
}

/// Marker tracks and head poses of the whole take.
///
/// Robust mode searches every marker by its look where the pose, continued at constant velocity, expects it, and fits the
/// pose to all image points at once. Looks follow light and shading, and are smeared along the way of the marker as the
/// shutter does it; a marker that was hidden is found again where the pose puts it.
/// *Deviation*: the paper follows markers by flow and uses eq. 1 alone, as paper mode does; a marker lost there stays lost
/// until a correction finds it again (measured: `docs/results.md`, "Markers").
///
/// From the labelled frame tracks are followed to both ends of the take, and from each correction to its neighbours; between
/// two, every frame has those that see more of the markers, and where both see as much those of the nearer one.
///
/// A marker that begins in a correction gets its place on the head by the head's pose there, from two views or more, be they of
/// several frames; then it is followed over the whole take like the others.
///
/// # Errors
/// Too few markers in the labelled frame, or that frame is not among the frames; an image cannot be had; a label is not finite.
pub fn pose(
    input: &PoseInput,
    mode: Mode,
    settings: &PoseSettings,
    report: &mut Report,
) -> Result<HeadPoses, StageError> {
    let mut tracker = Tracker::start(input, mode, settings)?;
    late::place_all(&mut tracker, report)?;
    let found = sweep::all_frames(&tracker, report)?;
    let mut poses = HeadPoses {
        world_from_head: found.iter().map(|f| f.pose).collect(),
        rms_px: found.iter().map(|f| f.rms_px).collect(),
        used: found.iter().map(|f| f.used).collect(),
        interpolated: found.iter().map(|f| !f.is_known).collect(),
        markers: Vec::with_capacity(found.len()),
        tracks: Vec::with_capacity(found.len()),
    };
    for frame in found {
        poses.markers.push(frame.markers);
        poses.tracks.push(frame.tracks);
    }
    interpolate(&mut poses, tracker.centre());
    from_first_frame(&mut poses, &tracker.model);
    Ok(poses)
}

/// Makes the world of the first frame the head's space, which was that of the labelled frame up to here.
fn from_first_frame(poses: &mut HeadPoses, model: &[Option<DVec3>]) {
    let (Some(first), Some(markers)) = (poses.world_from_head.first().copied(), poses.markers.first_mut()) else {
        return;
    };
    if first == RigidTransform::IDENTITY {
        *markers = model.to_vec();
        return;
    }
    *markers = model.iter().map(|known| known.map(|known| first.point(known))).collect();
    let labelled_from_head = first.inverse();
    poses.world_from_head.iter_mut().for_each(|pose| *pose = pose.after(&labelled_from_head));
    // What rounding leaves of no motion is none.
    poses.world_from_head[0] = RigidTransform::IDENTITY;
}

/// Replaces the poses of frames without enough markers by those between their neighbours.
fn interpolate(poses: &mut HeadPoses, centre: DVec3) {
    let good: Vec<usize> = (0..poses.interpolated.len()).filter(|&t| !poses.interpolated[t]).collect();
    for t in 0..poses.interpolated.len() {
        if !poses.interpolated[t] {
            continue;
        }
        let before = good.iter().rev().find(|&&g| g < t);
        let after = good.iter().find(|&&g| g > t);
        poses.world_from_head[t] = match (before, after) {
            (Some(&a), Some(&b)) => {
                let share = (t - a) as f64 / (b - a) as f64;
                between(&poses.world_from_head[a], &poses.world_from_head[b], share, centre)
            }
            (Some(&a), None) => poses.world_from_head[a],
            (None, Some(&b)) => poses.world_from_head[b],
            (None, None) => RigidTransform::IDENTITY,
        };
    }
}
