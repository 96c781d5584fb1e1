//! Markers of a frame: searched, followed, triangulated, fitted.

use std::sync::Arc;

use glam::{DVec2, DVec3};
use rayon::prelude::*;
use strandflow_core::{Place, Report, RgbImage, RigidTransform};
use strandflow_geometry::{project::project, triangulate::triangulate};
use strandflow_image::blob::Blob;

use super::{
    PoseInput, PoseSettings,
    sight::{SeenMarkers, Shutters, Sight, shutter_of},
    solve::{Seen, between, consensus, eq1, refine},
    track::{Look, by_flow},
};
use crate::{Mode, StageError};

/// Image points, shape (views, M).
pub(super) type Points = Vec<Vec<Option<DVec2>>>;
/// Looks of markers, shape (views, M).
pub(super) type Looks = Vec<Vec<Option<Look>>>;

/// What a frame shows.
#[derive(Clone)]
pub(super) struct Found {
    /// The head's pose; where it is not known, the expected one.
    pub pose: RigidTransform,
    /// Whether enough markers were seen.
    pub is_known: bool,
    pub tracks: Points,
    pub markers: Vec<Option<DVec3>>,
    pub used: u32,
    pub rms_px: f64,
    /// How well each shutter explained the frames up to this one.
    pub shutters: Shutters,
}

/// What is known of the markers from labels, and how they are found.
pub(super) struct Tracker<'a> {
    pub input: &'a PoseInput<'a>,
    pub mode: Mode,
    pub settings: &'a PoseSettings,
    /// Look of every marker in the labelled frame; of those that begin elsewhere, there.
    pub looks: Looks,
    /// Marker points of the labelled frame.
    pub base: Points,
    /// Marker positions in head space, here the world of the labelled frame \[mm\].
    pub model: Vec<Option<DVec3>>,
}

impl<'a> Tracker<'a> {
    pub fn start(input: &'a PoseInput<'a>, mode: Mode, settings: &'a PoseSettings) -> Result<Self, StageError> {
        let place = Place::frame(input.labelled);
        if !input.frames.contains(input.labelled) {
            let fact = format!("the markers are labelled outside the frames {}", input.frames);
            let hint = "label five markers or more in a frame of the take".into();
            return Err(StageError::Input { place, fact, hint });
        }
        let too_few = |fact: String| StageError::Input {
            place: place.clone(),
            fact,
            hint: format!(
                "label at least {} markers in one frame, each in two or more of its views",
                settings.markers_needed
            ),
        };
        let labelled = input.labels.iter().filter(|label| !label.views.is_empty()).count();
        if labelled < settings.markers_needed {
            return Err(too_few(format!("{labelled} markers are labelled, {} are needed", settings.markers_needed)));
        }
        let views = input.rig.view_count();
        let mut tracker = Self {
            input,
            mode,
            settings,
            looks: vec![vec![None; input.labels.len()]; views],
            base: vec![vec![None; input.labels.len()]; views],
            model: Vec::new(),
        };
        let images = tracker.images(input.labelled)?;
        for (m, label) in input.labels.iter().enumerate() {
            for (&view, &point) in label.views.iter().filter(|(view, _)| **view < views) {
                if !point.is_finite() {
                    let place = Place::view_frame(&input.rig.cameras[view].name, input.labelled);
                    return Err(StageError::NonFinite { place, what: format!("label of marker {}", label.id) });
                }
                let (centre, look) = learnt(&images[view], point, settings.marker_radius_px);
                (tracker.base[view][m], tracker.looks[view][m]) = (Some(centre), look);
            }
            lend_look(&mut tracker.looks, m);
        }
        tracker.model = tracker.triangulated(&tracker.base);
        let known = tracker.model.iter().flatten().count();
        if known < settings.markers_needed {
            return Err(too_few(format!(
                "{known} markers could be triangulated, {} are needed",
                settings.markers_needed
            )));
        }
        Ok(tracker)
    }

    pub fn images(&self, frame: usize) -> Result<Vec<Arc<RgbImage>>, StageError> {
        let views: Vec<usize> = (0..self.input.rig.view_count()).collect();
        let found: Vec<_> = views.into_par_iter().map(|view| self.input.images.image(view, frame)).collect();
        Ok(found.into_iter().collect::<Result<_, _>>()?)
    }

    pub fn triangulated(&self, points: &Points) -> Vec<Option<DVec3>> {
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

    /// Paper mode: the labelled frame as it is labelled.
    pub fn base_frame(&self) -> Found {
        let markers = self.triangulated(&self.base);
        self.found(self.base.clone(), markers, Some(RigidTransform::IDENTITY), RigidTransform::IDENTITY)
    }

    /// Robust mode: the labelled frame with what is seen there of all markers, labelled or not, and without labels that lie on another marker.
    pub fn base_frame_settled(&self, images: &[Arc<RgbImage>]) -> Found {
        let still = RigidTransform::IDENTITY;
        let sight = Sight { tracker: self, images, looks: &self.looks, before: still, shutter: 0.0 };
        let seen = sight.seen(&self.base, &still);
        let mut tracks = sight.settled(&seen, &still);
        // A label whose marker looks like nothing cannot be confirmed; it stays as it is.
        for (view, points) in tracks.iter_mut().enumerate() {
            for (m, point) in points.iter_mut().enumerate().filter(|(m, _)| self.looks[view][*m].is_none()) {
                *point = self.base[view][m];
            }
        }
        let rms_px = self.reprojection_px(&measured_of(&seen), &still);
        Found { rms_px, ..self.found(tracks, self.triangulated(&self.base), Some(still), still) }
    }

    /// Where the markers of the frame before went.
    pub fn followed(&self, previous: &[Arc<RgbImage>], images: &[Arc<RgbImage>], before: &Points) -> Points {
        let follow = |view: usize, point: Option<DVec2>| {
            by_flow(&previous[view], &images[view], point?, 40, self.settings.round_trip_px)
        };
        (0..images.len())
            .into_par_iter()
            .map(|view| before[view].iter().map(|&point| follow(view, point)).collect())
            .collect()
    }

    /// Paper mode: triangulation, eq. 1.
    pub fn posed_by_eq1(&self, tracks: Points, before: &[Found]) -> Found {
        let markers = self.triangulated(&tracks);
        let pose = if self.is_enough(&markers) { eq1(&self.model, &markers) } else { None };
        self.found(tracks, markers, pose, expected(before))
    }

    /// How far from where they are expected markers are searched \[px\]: further after frames without a pose, and after `more`.
    pub fn reach(&self, before: &[Found], more: usize) -> f64 {
        let gap = more + before.iter().rev().take_while(|found| !found.is_known).count();
        self.settings.search_px * (1 + gap.min(3)) as f64
    }

    /// Robust mode: a frame after those before, searched within `reach` \[px\] of where the head is expected; where that
    /// does not do, further, as if it had gathered speed, and as if the shutter were open for longer or shorter. Also how the
    /// markers look from then on.
    pub fn by_look(&self, images: &[Arc<RgbImage>], looks: &Looks, before: &[Found], reach: f64) -> (Found, Looks) {
        let expected = expected(before);
        let shutters = before.last().map_or_else(Shutters::default, |last| last.shutters);
        // Of a frame that was lost there is only a guess: no way can be told from it.
        let last = before.last().filter(|last| last.is_known);
        let from = last.map_or(expected, |last| last.pose);
        let mut best: Option<Found> = None;
        for (speed, reach, shutter) in self.tries(before, reach, shutter_of(&shutters)) {
            let sight = Sight { tracker: self, images, looks, before: from, shutter };
            let found = self.seen_from(&sight, between(&from, &expected, speed, self.centre()), reach);
            if found.is_known {
                let shutters = if last.is_some() { sight.judged(&shutters, &found.pose) } else { shutters };
                let before = last.map_or(found.pose, |last| last.pose);
                let sight = Sight { before, shutter: shutter_of(&shutters), ..sight };
                let found = self.settled(&sight, found);
                let looks = sight.looks_after(&found.tracks, &found.pose);
                return (Found { shutters, ..found }, looks);
            }
            if best.as_ref().is_none_or(|best| found.used > best.used) {
                best = Some(Found { pose: expected, shutters, ..found });
            }
        }
        let nothing = || self.found(vec![vec![None; self.model.len()]; images.len()], Vec::new(), None, expected);
        (best.unwrap_or_else(nothing), looks.clone())
    }

    /// What is tried on a frame, in order: speed of that before, reach \[px\], shutter. A head that stays lost is searched as
    /// expected only: the other tries cost ten times as much.
    fn tries(&self, before: &[Found], reach: f64, shutter: f64) -> Vec<(f64, f64, f64)> {
        let further = (2.0 * reach).min(4.0 * self.settings.search_px);
        let mut tries = vec![(1.0, reach, shutter), (1.0, further, shutter)];
        if before.iter().rev().take(2).all(|found| found.is_known) {
            let others = [0.4, 0.8, 0.0].into_iter().filter(|open| *open != shutter);
            let speeds =
                std::iter::once(shutter).chain(others).flat_map(|open| [1.0, 2.0, 3.0].map(|speed| (speed, open)));
            tries.extend(speeds.skip(1).map(|(speed, open)| (speed, further, open)));
        }
        tries
    }

    /// Search where the pose is expected, agree, fit, search again where the pose now says.
    fn seen_from(&self, sight: &Sight, expected: RigidTransform, reach: f64) -> Found {
        let tracks = sight.search(&expected, reach);
        let start = consensus(&self.model, &self.triangulated(&tracks), 4.0).unwrap_or(expected);
        let once = self.fit(&tracks, start);
        // Second look, close to the pose found: wrong finds are dropped and lost markers come back.
        let measured = sight.search(&once, 0.5 * self.settings.marker_radius_px);
        let pose = self.fit(&measured, once);
        self.posed_by_fit(self.agreeing(measured, &pose), pose, expected)
    }

    /// What is seen of the markers at a pose that is known, and the pose fitted to that; the frame as it was found where too
    /// few are.
    fn settled(&self, sight: &Sight, found: Found) -> Found {
        let measured = sight.search(&found.pose, 0.5 * self.settings.marker_radius_px);
        let seen = sight.seen(&measured, &found.pose);
        let pose = self.fit_weighted(|view, m| seen[view][m], found.pose);
        let tracks = sight.settled(&seen, &pose);
        let markers = self.triangulated(&tracks);
        if !self.is_enough(&markers) {
            return found;
        }
        let rms_px = self.reprojection_px(&measured_of(&seen), &pose);
        Found { rms_px, ..self.found(tracks, markers, Some(pose), pose) }
    }

    /// Robust mode: the pose fitted to all points of a frame.
    pub fn posed_by_fit(&self, tracks: Points, start: RigidTransform, expected: RigidTransform) -> Found {
        let markers = self.triangulated(&tracks);
        let pose = self.is_enough(&markers).then(|| self.fit(&tracks, start));
        self.found(tracks, markers, pose, expected)
    }

    fn is_enough(&self, markers: &[Option<DVec3>]) -> bool {
        self.in_common(markers) >= self.settings.markers_needed
    }

    /// Markers that have a place on the head and are known in this frame.
    pub fn in_common(&self, markers: &[Option<DVec3>]) -> usize {
        self.model.iter().zip(markers).filter(|(a, b)| a.is_some() && b.is_some()).count()
    }

    /// Where a marker's image is expected at a pose.
    pub fn expected_point(&self, view: usize, m: usize, pose: &RigidTransform) -> Option<DVec2> {
        project(&self.input.rig.cameras[view], pose.point(self.model[m]?))
    }

    pub fn fit(&self, tracks: &Points, start: RigidTransform) -> RigidTransform {
        self.fit_weighted(|view, m| Some((tracks[view][m]?, 1.0)), start)
    }

    /// The pose that fits points by their weights.
    fn fit_weighted(
        &self,
        weighted: impl Fn(usize, usize) -> Option<(DVec2, f64)>,
        start: RigidTransform,
    ) -> RigidTransform {
        let mut seen = Vec::new();
        for view in 0..self.input.rig.view_count() {
            for marker in 0..self.model.len() {
                if let Some((point, weight)) = weighted(view, marker) {
                    seen.push(Seen { view, marker, point, weight });
                }
            }
        }
        refine(self.input.rig, &self.model, &seen, start, 0.5)
    }

    /// Keeps the points that lie where the pose puts them.
    pub fn agreeing(&self, mut tracks: Points, pose: &RigidTransform) -> Points {
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

    fn found(
        &self,
        tracks: Points,
        markers: Vec<Option<DVec3>>,
        pose: Option<RigidTransform>,
        expected: RigidTransform,
    ) -> Found {
        let place = pose.unwrap_or(expected);
        let rms_px = self.reprojection_px(&tracks, &place);
        let used = self.in_common(&markers) as u32;
        Found { pose: place, is_known: pose.is_some(), tracks, markers, used, rms_px, shutters: Shutters::default() }
    }

    /// Root mean square distance of points to where a pose puts their markers \[px\].
    fn reprojection_px(&self, points: &Points, pose: &RigidTransform) -> f64 {
        let mut squares = Vec::new();
        for (view, points) in points.iter().enumerate() {
            for (m, point) in points.iter().enumerate() {
                if let (Some(p), Some(e)) = (point, self.expected_point(view, m, pose)) {
                    squares.push(e.distance_squared(*p));
                }
            }
        }
        (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
    }

    pub fn report_lost(&self, frame: usize, found: &Found, report: &mut Report) {
        if !found.is_known {
            let (used, of) = (found.used, self.model.iter().flatten().count());
            let fact = format!("used {used} of {of} markers, need {}", self.settings.markers_needed);
            report.warn(Place::frame(frame), fact, "pose interpolated");
        }
    }

    pub fn centre(&self) -> DVec3 {
        let known: Vec<DVec3> = self.model.iter().flatten().copied().collect();
        known.iter().sum::<DVec3>() / known.len().max(1) as f64
    }
}

/// Views without a label take the look of the view in which the marker stands out most, and ask more of it.
pub(super) fn lend_look(looks: &mut Looks, m: usize) {
    let best = looks.iter().filter_map(|view| view[m]).max_by(|a, b| a.score.total_cmp(&b.score));
    let Some(best) = best else { return };
    for view in looks {
        view[m].get_or_insert(Look { is_lent: true, ..best });
    }
}

/// The points that were measured, not only expected.
fn measured_of(seen: &SeenMarkers) -> Points {
    let measured = |point: &Option<(DVec2, f64)>| point.filter(|(_, trust)| *trust > 0.0).map(|(point, _)| point);
    seen.iter().map(|view| view.iter().map(measured).collect()).collect()
}

/// The centre of a labelled marker, which is measured (the label is where to look), and its look; where nothing there looks
/// like a marker, the label itself and no look.
pub(super) fn learnt(image: &RgbImage, label: DVec2, radius_px: f64) -> (DVec2, Option<Look>) {
    let Some(blob) = Blob::learn(image, label, radius_px) else { return (label, None) };
    let centre = blob.centroid(image, label);
    if centre.distance(label) > 0.6 * radius_px {
        return (label, None);
    }
    let score = blob.score(image, centre);
    if score > 0.2 { (centre, Some(Look { blob, score, is_lent: false })) } else { (label, None) }
}

/// The next pose at constant velocity.
pub(super) fn expected(before: &[Found]) -> RigidTransform {
    match before {
        [] => RigidTransform::IDENTITY,
        [only] => only.pose,
        [.., a, b] => b.pose.after(&a.pose.inverse()).after(&b.pose),
    }
}
