//! A frame as the markers are looked for in it: how they look by now, how far they move while the shutter is open, which of
//! them are seen.

use std::sync::Arc;

use glam::DVec2;
use rayon::prelude::*;
use strandflow_core::{RgbImage, RigidTransform};

use strandflow_image::blob::Blob;

use super::{
    track::{Look, by_look},
    tracker::{Looks, Points, Tracker},
};

/// Shutters that are told apart: open for 0, 0.1, … 1 of the time between two frames.
const SHUTTERS: usize = 11;

/// How well the streaks of each shutter explained the frames before; older frames count less.
pub(super) type Shutters = [f64; SHUTTERS];

/// Share of its own score at which a marker is seen where the pose puts it: 19 of 20 hidden ones stay below 0.16, 19 of 20
/// of those that are seen by half or more above 0.2.
const SEEN: f64 = 0.18;

/// Below this share a marker's measured centre says nothing.
const HALF: f64 = 0.4;

/// From this share on a marker is seen whole; below, what hides it shifts the centre.
const WHOLE: f64 = 0.85;

/// Score from which a look is a clear one: those learnt where hair hid a part have 0.2 to 0.4, most others 0.5 to 0.8.
const CLEAR: f64 = 0.45;

/// Weight of the measured centre of a marker that is seen whole against the place by the pose, which rests on all: shading
/// shifts single centres by up to 2.5 px.
const MEASURED: f64 = 0.5;

/// A marker is hidden by a nearer one within this many radii: of the further one less than two fifths are seen.
const COVERS: f64 = 0.6;

/// A marker's look follows the light and its shading by this share a frame: at 0.3 a drift of 2 % a frame lags by 5 %.
const FOLLOW: f32 = 0.3;

/// Where markers were measured and how far that is to be trusted, shape (views, M).
pub(super) type SeenMarkers = Vec<Vec<Option<(DVec2, f64)>>>;

/// The images of a frame and what is known of the markers before it.
pub(super) struct Sight<'a> {
    pub tracker: &'a Tracker<'a>,
    pub images: &'a [Arc<RgbImage>],
    pub looks: &'a Looks,
    /// Pose of the frame before.
    pub before: RigidTransform,
    /// How long the shutter is open, of the time between two frames.
    pub shutter: f64,
}

/// The shutter that explained the frames before best; closed at once where nothing moved yet.
pub(super) fn shutter_of(shutters: &Shutters) -> f64 {
    let best = (0..SHUTTERS).fold(0, |best, k| if shutters[k] > shutters[best] { k } else { best });
    best as f64 / (SHUTTERS - 1) as f64
}

impl Sight<'_> {
    /// The markers within `reach` \[px\] of where a pose puts them.
    pub fn search(&self, pose: &RigidTransform, reach: f64) -> Points {
        let find = |view: usize, m: usize| {
            let (expected, way) = self.expected(view, m, pose)?;
            let look = self.looks[view][m].as_ref()?;
            let smeared = Look { blob: look.blob.smeared(&self.images[view], expected, way * self.shutter), ..*look };
            by_look(&self.images[view], &smeared, expected, reach, self.tracker.settings.accept)
        };
        self.all(find)
    }

    /// What is seen of the markers at a pose that is known: where each was measured, and how far that is to be trusted, 0 to 1;
    /// the less is seen of it the less (the centre of what is seen of a half is off by 0.4 radii). Of two at one place the
    /// nearer one is seen.
    pub fn seen(&self, measured: &Points, pose: &RigidTransform) -> SeenMarkers {
        let weigh = |view: usize, m: usize| {
            let (expected, _) = self.expected(view, m, pose)?;
            let near = measured[view][m].filter(|p| p.distance(expected) <= self.tracker.settings.inlier_px);
            let share = self.share(view, m, near.unwrap_or(expected), pose).max(self.share(view, m, expected, pose));
            let trust = ((share - HALF) / (WHOLE - HALF)).clamp(0.0, 1.0);
            (share >= SEEN).then_some(near.map_or((expected, 0.0), |near| (near, trust)))
        };
        let mut seen = self.all(weigh);
        for (view, of_view) in seen.iter_mut().enumerate() {
            self.keep_nearest(view, of_view, pose);
        }
        seen
    }

    /// Where the markers that are seen are at the pose fitted to them: at most half way to where they were measured.
    pub fn settled(&self, seen: &SeenMarkers, pose: &RigidTransform) -> Points {
        self.all(|view, m| {
            let (measured, trust) = seen[view][m]?;
            Some(self.tracker.expected_point(view, m, pose)?.lerp(measured, MEASURED * trust))
        })
    }

    fn all<T: Send>(&self, find: impl Fn(usize, usize) -> Option<T> + Sync) -> Vec<Vec<Option<T>>> {
        let markers = self.tracker.model.len();
        (0..self.images.len()).into_par_iter().map(|view| (0..markers).map(|m| find(view, m)).collect()).collect()
    }

    /// Image point at a pose, and the way to it from that of the frame before \[px\].
    fn expected(&self, view: usize, m: usize, pose: &RigidTransform) -> Option<(DVec2, DVec2)> {
        let now = self.tracker.expected_point(view, m, pose)?;
        // A head that stays lost flies on, through cameras too: a way longer than the image is none.
        let most = (self.images[view].width + self.images[view].height) as f64;
        let way = self.tracker.expected_point(view, m, &self.before).map(|before| now - before);
        Some((now, way.filter(|way| way.length() < most).unwrap_or(DVec2::ZERO)))
    }

    /// How much of a marker is seen at a point, of its own score; by the look of it in this view or in others, because hair
    /// may have hidden a part where it was learnt.
    fn share(&self, view: usize, m: usize, at: DVec2, pose: &RigidTransform) -> f64 {
        let way = self.expected(view, m, pose).map_or(DVec2::ZERO, |(_, way)| way * self.shutter);
        let own = (0..self.looks.len()).filter(|&v| v == view || self.looks[v][m].is_some_and(|look| !look.is_lent));
        let of = |look: Look| {
            look.blob.smeared(&self.images[view], at, way).score(&self.images[view], at) / look.score.max(CLEAR)
        };
        own.filter_map(|v| self.looks[v][m]).map(of).fold(0.0, f64::max)
    }

    /// Of markers whose centres are within [`COVERS`] radii in a view, the one nearest to the camera stays.
    fn keep_nearest(&self, view: usize, seen: &mut [Option<(DVec2, f64)>], pose: &RigidTransform) {
        let camera = &self.tracker.input.rig.cameras[view];
        let depth =
            |m: usize| self.tracker.model[m].map_or(f64::INFINITY, |x| camera.camera_from_world.point(pose.point(x)).z);
        let near = COVERS * self.tracker.settings.marker_radius_px;
        let at: Vec<Option<DVec2>> = (0..seen.len()).map(|m| Some(self.expected(view, m, pose)?.0)).collect();
        for m in 0..seen.len() {
            let covers = |other: usize| {
                other != m
                    && seen[other].is_some()
                    && depth(other) < depth(m)
                    && at[m].zip(at[other]).is_some_and(|(a, b)| a.distance(b) < near)
            };
            if (0..seen.len()).any(covers) {
                seen[m] = None;
            }
        }
    }

    /// How well each shutter explains the frame at its pose, added to what was before.
    pub fn judged(&self, shutters: &Shutters, pose: &RigidTransform) -> Shutters {
        let mut judged = shutters.map(|s| 0.8 * s);
        for view in 0..self.images.len() {
            for m in 0..self.tracker.model.len() {
                let (Some((at, way)), Some(look)) = (self.expected(view, m, pose), self.looks[view][m]) else {
                    continue;
                };
                if way.length() < look.blob.radius {
                    continue;
                }
                for (k, sum) in judged.iter_mut().enumerate() {
                    let open = k as f64 / (SHUTTERS - 1) as f64;
                    *sum +=
                        look.blob.smeared(&self.images[view], at, way * open).score(&self.images[view], at).max(0.0);
                }
            }
        }
        judged
    }

    /// How the markers look from this frame on: those that are seen whole as they are seen here, the others in the light
    /// that those have got.
    pub fn looks_after(&self, points: &Points, pose: &RigidTransform) -> Looks {
        let mut looks = self.looks.clone();
        for (view, of_view) in looks.iter_mut().enumerate() {
            let seen: Vec<Option<Look>> = (0..of_view.len()).map(|m| self.seen_look(view, m, points, pose)).collect();
            let mut gains: Vec<f32> = seen
                .iter()
                .zip(&*of_view)
                .filter_map(|(new, old)| Some(gain(&old.as_ref()?.blob, &new.as_ref()?.blob)))
                .collect();
            gains.sort_by(f32::total_cmp);
            let light = if gains.len() < 2 { 1.0 } else { gains[gains.len() / 2] };
            for (old, new) in of_view.iter_mut().zip(seen) {
                *old = new.or_else(|| old.map(|old| Look { blob: old.blob.in_light(light), ..old }));
            }
        }
        looks
    }

    /// The look of a marker that is seen whole, sharp, and where the pose puts it: partly what it was.
    fn seen_look(&self, view: usize, m: usize, points: &Points, pose: &RigidTransform) -> Option<Look> {
        let (point, old) = (points[view][m]?, self.looks[view][m]?);
        let (expected, way) = self.expected(view, m, pose)?;
        // Up to here the middle of the ball is covered by it for the whole exposure.
        let is_sharp = way.length() * self.shutter < 0.8 * old.blob.radius;
        if !is_sharp || point.distance(expected) > 1.0 || self.share(view, m, point, pose) < WHOLE {
            return None;
        }
        let new = Blob::learn(&self.images[view], point, old.blob.radius)?;
        if old.is_lent {
            let score = new.score(&self.images[view], point);
            return (score > CLEAR).then_some(Look { blob: new, score, is_lent: false });
        }
        Some(Look { blob: old.blob.towards(&new, FOLLOW), ..old })
    }
}

/// Light of a ball of that of the same ball before.
fn gain(before: &Blob, now: &Blob) -> f32 {
    let length = |blob: &Blob| blob.colour.iter().map(|c| c * c).sum::<f32>().sqrt();
    length(now) / length(before).max(1.0)
}
