//! Stage 3: markers tracked from labels in the first frame, and the rigid head pose of every frame (eq. 1).

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use strandflow_core::{FrameRange, ImageSource, Report, Rig, RigidTransform};

use std::sync::Arc;

use rayon::prelude::*;
use strandflow_core::{Place, RgbImage};
use strandflow_geometry::{project::project, triangulate::triangulate};
use strandflow_image::blob::Blob;

use crate::{Mode, SettingViolation, StageError};

mod solve;
mod track;

use solve::{Seen, between, consensus, eq1, refine};
use track::{Look, by_flow, by_look};

/// A marker labelled in the first frame.
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
    /// Labels in the first frame.
    pub labels: &'a [MarkerLabel],
}

/// Marker tracks and head poses.
#[derive(Clone, Debug, PartialEq)]
pub struct HeadPoses {
    /// Motion of the head from the first frame to each frame, in world coordinates (eq. 1's C^t). Head space is the
    /// world of the first frame.
    pub world_from_head: Vec<RigidTransform>,
    /// Marker positions \[mm\], shape (T, M); `None` where not triangulated.
    pub markers: Vec<Vec<Option<DVec3>>>,
    /// Marker image points \[px\], shape (T, views, M); `None` where lost or occluded.
    pub tracks: Vec<Vec<Vec<Option<DVec2>>>>,
    /// Root mean square reprojection error of the markers used \[px\], per frame.
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
    /// Share of its first score a marker must reach to be taken.
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

/// Image points, shape (views, M).
type Points = Vec<Vec<Option<DVec2>>>;

/// Marker tracks and head poses of the whole take.
///
/// Robust mode searches every marker by its look where the pose, continued at constant velocity, expects it, and fits the
/// pose to all image points at once. Deviation: the paper follows markers by flow and uses eq. 1 alone, as paper mode
/// does; a marker lost there stays lost.
pub fn pose(
    input: &PoseInput,
    mode: Mode,
    settings: &PoseSettings,
    report: &mut Report,
) -> Result<HeadPoses, StageError> {
    let tracker = Tracker::start(input, settings)?;
    let mut poses = tracker.first_frame();
    let mut previous = tracker.images(input.frames.start)?;
    for frame in input.frames.start + 1..input.frames.end {
        let images = tracker.images(frame)?;
        match mode {
            Mode::Paper => tracker.frame_by_flow(&previous, &images, &mut poses),
            Mode::Robust => tracker.frame_by_look(&images, &mut poses),
        }
        tracker.report_lost(frame, &poses, report);
        previous = images;
    }
    interpolate(&mut poses, tracker.centre());
    Ok(poses)
}

struct Tracker<'a> {
    input: &'a PoseInput<'a>,
    settings: &'a PoseSettings,
    /// Look of every marker, shape (views, M).
    looks: Vec<Vec<Option<Look>>>,
    /// Marker points of the first frame, shape (views, M).
    first: Points,
    /// Marker positions in head space \[mm\].
    model: Vec<Option<DVec3>>,
    /// What the first frame's points differ by from the projected model (shading shifts centres the same way in every
    /// frame), shape (views, M).
    offset: Vec<Vec<DVec2>>,
}

impl<'a> Tracker<'a> {
    fn start(input: &'a PoseInput<'a>, settings: &'a PoseSettings) -> Result<Self, StageError> {
        let place = Place::frame(input.frames.start);
        let too_few = |fact: String| StageError::Input {
            place: place.clone(),
            fact,
            hint: format!(
                "label at least {} markers, each in two or more views of the first frame",
                settings.markers_needed
            ),
        };
        if input.labels.len() < settings.markers_needed {
            return Err(too_few(format!(
                "{} markers are labelled, {} are needed",
                input.labels.len(),
                settings.markers_needed
            )));
        }
        let views = input.rig.view_count();
        let mut tracker = Self {
            input,
            settings,
            looks: vec![vec![None; input.labels.len()]; views],
            first: vec![vec![None; input.labels.len()]; views],
            model: Vec::new(),
            offset: vec![vec![DVec2::ZERO; input.labels.len()]; views],
        };
        let images = tracker.images(input.frames.start)?;
        for (m, label) in input.labels.iter().enumerate() {
            for (&view, &point) in label.views.iter().filter(|(view, _)| **view < views) {
                if !point.is_finite() {
                    let place = Place::view_frame(&input.rig.cameras[view].name, input.frames.start);
                    return Err(StageError::NonFinite { place, what: format!("label of marker {}", label.id) });
                }
                tracker.learn(&images[view], view, m, point);
            }
            tracker.lend_look(m);
        }
        tracker.model = tracker.triangulated(&tracker.first);
        let known = tracker.model.iter().flatten().count();
        if known < settings.markers_needed {
            return Err(too_few(format!(
                "{known} markers could be triangulated, {} are needed",
                settings.markers_needed
            )));
        }
        tracker.measure_offsets();
        Ok(tracker)
    }

    fn images(&self, frame: usize) -> Result<Vec<Arc<RgbImage>>, StageError> {
        let views: Vec<usize> = (0..self.input.rig.view_count()).collect();
        let found: Vec<_> = views.into_par_iter().map(|view| self.input.images.image(view, frame)).collect();
        Ok(found.into_iter().collect::<Result<_, _>>()?)
    }

    /// Learns a labelled marker; its centre is measured, the label is where to look.
    fn learn(&mut self, image: &RgbImage, view: usize, m: usize, point: DVec2) {
        self.first[view][m] = Some(point);
        let Some(blob) = Blob::learn(image, point, self.settings.marker_radius_px) else { return };
        let centre = blob.centroid(image, point);
        if centre.distance(point) > 0.6 * self.settings.marker_radius_px {
            return;
        }
        let score = blob.score(image, centre);
        if score > 0.2 {
            self.first[view][m] = Some(centre);
            self.looks[view][m] = Some(Look { blob, score });
        }
    }

    /// Views without a label take the look of the view in which the marker stands out most, and ask more of it.
    fn lend_look(&mut self, m: usize) {
        let best = self.looks.iter().filter_map(|view| view[m]).max_by(|a, b| a.score.total_cmp(&b.score));
        let Some(best) = best else { return };
        for view in &mut self.looks {
            view[m].get_or_insert(Look { score: 1.2 * best.score.min(0.8), ..best });
        }
    }

    fn triangulated(&self, points: &Points) -> Vec<Option<DVec3>> {
        let of = |m: usize| {
            let seen: Vec<_> = points
                .iter()
                .zip(&self.input.rig.cameras)
                .filter_map(|(view, camera)| Some((camera, view[m]?)))
                .collect();
            triangulate(&seen, self.settings.inlier_px).map(|t| t.point)
        };
        (0..self.input.labels.len()).map(of).collect()
    }

    fn measure_offsets(&mut self) {
        for (view, camera) in self.input.rig.cameras.iter().enumerate() {
            for m in 0..self.model.len() {
                let (Some(x), Some(seen)) = (self.model[m], self.first[view][m]) else { continue };
                let Some(p) = project(camera, x) else { continue };
                let off = seen - p;
                if off.length() <= self.settings.inlier_px {
                    self.offset[view][m] = off;
                }
            }
        }
    }

    fn first_frame(&self) -> HeadPoses {
        let mut poses = HeadPoses {
            world_from_head: Vec::new(),
            markers: Vec::new(),
            tracks: Vec::new(),
            rms_px: Vec::new(),
            used: Vec::new(),
            interpolated: Vec::new(),
        };
        self.push(&mut poses, self.first.clone(), self.model.clone(), Some(RigidTransform::IDENTITY));
        poses
    }

    /// Paper mode: flow, triangulation, eq. 1.
    fn frame_by_flow(&self, previous: &[Arc<RgbImage>], images: &[Arc<RgbImage>], poses: &mut HeadPoses) {
        let before = &poses.tracks[poses.tracks.len() - 1];
        let follow = |view: usize, point: Option<DVec2>| {
            by_flow(&previous[view], &images[view], point?, 40, self.settings.round_trip_px)
        };
        let tracks: Points = (0..images.len())
            .into_par_iter()
            .map(|view| before[view].iter().map(|&point| follow(view, point)).collect())
            .collect();
        let markers = self.triangulated(&tracks);
        let used = self.model.iter().zip(&markers).filter(|(a, b)| a.is_some() && b.is_some()).count();
        let pose = if used >= self.settings.markers_needed { eq1(&self.model, &markers) } else { None };
        self.push(poses, tracks, markers, pose);
    }

    /// Robust mode: search where the pose is expected, agree, fit, search again where the pose now says.
    fn frame_by_look(&self, images: &[Arc<RgbImage>], poses: &mut HeadPoses) {
        let expected = expected(&poses.world_from_head);
        let gap = poses.interpolated.iter().rev().take_while(|&&lost| lost).count();
        let reach = self.settings.search_px * (1 + gap.min(3)) as f64;
        let tracks = self.search(images, &expected, reach);
        let start = consensus(&self.model, &self.triangulated(&tracks), 4.0).unwrap_or(expected);
        let once = self.fit(&tracks, start);
        // Second look, close to the pose found: wrong finds are dropped and lost markers come back.
        let tracks = self.search(images, &once, 0.5 * self.settings.marker_radius_px);
        let pose = self.fit(&tracks, once);
        let tracks = self.agreeing(tracks, &pose);
        let markers = self.triangulated(&tracks);
        let used = self.model.iter().zip(&markers).filter(|(a, b)| a.is_some() && b.is_some()).count();
        let pose = (used >= self.settings.markers_needed).then(|| self.fit(&tracks, pose));
        self.push(poses, tracks, markers, pose);
    }

    fn search(&self, images: &[Arc<RgbImage>], pose: &RigidTransform, reach: f64) -> Points {
        let find = |view: usize, m: usize| {
            let expected = self.expected_point(view, m, pose)?;
            by_look(&images[view], self.looks[view][m].as_ref()?, expected, reach, self.settings.accept)
        };
        (0..images.len()).into_par_iter().map(|view| (0..self.model.len()).map(|m| find(view, m)).collect()).collect()
    }

    /// Where a marker's image is expected at a pose.
    fn expected_point(&self, view: usize, m: usize, pose: &RigidTransform) -> Option<DVec2> {
        Some(project(&self.input.rig.cameras[view], pose.point(self.model[m]?))? + self.offset[view][m])
    }

    fn fit(&self, tracks: &Points, start: RigidTransform) -> RigidTransform {
        let mut seen = Vec::new();
        for (view, points) in tracks.iter().enumerate() {
            for (marker, point) in points.iter().enumerate() {
                if let Some(point) = point {
                    seen.push(Seen { view, marker, point: *point - self.offset[view][marker], weight: 1.0 });
                }
            }
        }
        refine(self.input.rig, &self.model, &seen, start, 0.5)
    }

    /// Keeps the points that lie where the pose puts them.
    fn agreeing(&self, mut tracks: Points, pose: &RigidTransform) -> Points {
        for (view, points) in tracks.iter_mut().enumerate() {
            for (m, point) in points.iter_mut().enumerate() {
                let near = |p: DVec2| {
                    self.expected_point(view, m, pose).is_some_and(|e| e.distance(p) <= self.settings.inlier_px)
                };
                *point = point.filter(|p| near(*p));
            }
        }
        tracks
    }

    fn push(&self, poses: &mut HeadPoses, tracks: Points, markers: Vec<Option<DVec3>>, pose: Option<RigidTransform>) {
        let place = pose.unwrap_or_else(|| expected(&poses.world_from_head));
        let mut squares = Vec::new();
        for (view, points) in tracks.iter().enumerate() {
            for (m, point) in points.iter().enumerate() {
                if let (Some(p), Some(e)) = (point, self.expected_point(view, m, &place)) {
                    squares.push(e.distance_squared(*p));
                }
            }
        }
        let both = |(a, b): (&Option<DVec3>, &Option<DVec3>)| a.is_some() && b.is_some();
        poses.used.push(self.model.iter().zip(&markers).filter(|pair| both(*pair)).count() as u32);
        poses.rms_px.push((squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt());
        poses.world_from_head.push(place);
        poses.interpolated.push(pose.is_none());
        poses.tracks.push(tracks);
        poses.markers.push(markers);
    }

    fn report_lost(&self, frame: usize, poses: &HeadPoses, report: &mut Report) {
        let last = poses.used.len() - 1;
        if poses.interpolated[last] {
            let (used, of) = (poses.used[last], self.model.iter().flatten().count());
            let fact = format!("used {used} of {of} markers, need {}", self.settings.markers_needed);
            report.warn(Place::frame(frame), fact, "pose interpolated");
        }
    }

    fn centre(&self) -> DVec3 {
        let known: Vec<DVec3> = self.model.iter().flatten().copied().collect();
        known.iter().sum::<DVec3>() / known.len().max(1) as f64
    }
}

/// The next pose at constant velocity.
fn expected(poses: &[RigidTransform]) -> RigidTransform {
    match poses {
        [] => RigidTransform::IDENTITY,
        [only] => *only,
        [.., a, b] => b.after(&a.inverse()).after(b),
    }
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
