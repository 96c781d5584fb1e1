//! Scores of marker tracks: seen and followed, exchanged, followed where nothing is seen.

use glam::DVec2;
use serde::{Deserialize, Serialize};
use strandflow_core::{Camera, Rig};

use crate::truth::Truth;

/// A marker counts as visible in a view where at least this share of its disc is seen: the truth's share, or what nearer
/// markers leave of the disc where that is less (there are truths whose share leaves other markers out).
const VISIBLE: f32 = 0.5;

/// A marker counts as hidden where less than this share of its disc is seen: nothing there can be measured.
const HIDDEN: f32 = 0.1;

/// How far a track may be from the true projection of the marker's centre \[px\].
const NEAR_PX: f64 = 2.0;

/// Marker tracks against the truth: counts over frames, views and labelled markers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MarkerScores {
    /// Marker-frames of a view in which at least half of the marker is seen.
    pub visible: usize,
    /// Those of them that are tracked within 2 px.
    pub within_2px: usize,
    /// Tracks that are further than 2 px from their marker and nearer to another one, seen or not.
    pub swaps: usize,
    /// Tracks where less than a tenth of the marker is seen, and tracks further than 2 px off where less than half is.
    pub false_tracks: usize,
}

impl MarkerScores {
    /// Share of the visible marker-frames that are tracked within 2 px; 1 where there is none.
    pub fn share_within_2px(&self) -> f64 {
        if self.visible == 0 { 1.0 } else { self.within_2px as f64 / self.visible as f64 }
    }

    /// Counts one marker of one view and frame; `points` are the true ones of all markers there.
    fn count(&mut self, track: Option<DVec2>, points: &[(DVec2, f32)], marker: usize) {
        let (truth, seen) = points[marker];
        let off = track.map(|track| track.distance(truth));
        let is_near = off.is_some_and(|off| off <= NEAR_PX);
        self.visible += usize::from(seen >= VISIBLE);
        self.within_2px += usize::from(seen >= VISIBLE && is_near);
        let Some((track, off)) = track.zip(off) else { return };
        let is_nearer = |other: &(DVec2, f32)| track.distance(other.0) < off;
        self.swaps += usize::from(!is_near && points.iter().any(is_nearer));
        self.false_tracks += usize::from(seen < HIDDEN || (seen < VISIBLE && !is_near));
    }
}

/// Scores tracks \[px\], shape (T, views, markers), of these frame numbers, of the views that took part and of the markers with
/// these numbers (in the truth, markers are counted from 0). Markers that nobody labelled do not count.
pub fn evaluate_markers(
    frames: &[u32],
    (rig, views): (&Rig, &[usize]),
    ids: &[u32],
    tracks: &[Vec<Vec<Option<DVec2>>>],
    truth: &Truth,
) -> MarkerScores {
    let mut scores = MarkerScores::default();
    for (frame, tracks) in frames.iter().zip(tracks) {
        for &view in views {
            let (Some(points), Some(tracks)) = (seen(truth, *frame, rig, view), tracks.get(view)) else { continue };
            for (&id, &track) in ids.iter().zip(tracks).filter(|(id, _)| (**id as usize) < points.len()) {
                scores.count(track, &points, id as usize);
            }
        }
    }
    scores
}

/// True image points of all markers of a view, each with the share of it that is seen.
fn seen(truth: &Truth, frame: u32, rig: &Rig, view: usize) -> Option<Vec<(DVec2, f32)>> {
    let points = truth.marker_views.get(frame as usize)?.get(view)?;
    let discs: Option<Vec<Disc>> = rig.cameras.get(view).map(|camera| discs(truth, frame, camera, points));
    let discs = discs.filter(|discs| discs.len() == points.len());
    let left = |m: usize| discs.as_ref().map_or(1.0, |discs| left_by_nearer(discs, m) as f32);
    Some(points.iter().enumerate().map(|(m, &(at, share))| (at, share.min(left(m)))).collect())
}

/// A marker ball in an image.
struct Disc {
    at: DVec2,
    radius: f64,
    depth: f64,
}

fn discs(truth: &Truth, frame: u32, camera: &Camera, points: &[(DVec2, f32)]) -> Vec<Disc> {
    let Some(pose) = truth.world_from_head.get(frame as usize) else { return Vec::new() };
    let disc = |(world, &(at, _)): (&glam::DVec3, &(DVec2, f32))| {
        let depth = camera.camera_from_world.point(pose.point(*world)).z;
        let radius = if depth > 0.0 { truth.marker_radius * camera.focal[0] / depth } else { 0.0 };
        Disc { at, radius, depth }
    };
    truth.markers.iter().zip(points).map(disc).collect()
}

/// The share of a disc that the one nearer disc that covers most of it leaves.
fn left_by_nearer(discs: &[Disc], m: usize) -> f64 {
    let own = &discs[m];
    let nearer = discs.iter().filter(|other| other.depth < own.depth);
    let most = nearer.map(|other| common_area(own, other)).fold(0.0, f64::max);
    let area = std::f64::consts::PI * own.radius * own.radius;
    if area > 0.0 { 1.0 - most / area } else { 1.0 }
}

/// Area that two discs have in common.
fn common_area(a: &Disc, b: &Disc) -> f64 {
    let (d, r, s) = (a.at.distance(b.at), a.radius, b.radius);
    if d.is_nan() || d >= r + s {
        return 0.0;
    }
    if d <= (r - s).abs() {
        return std::f64::consts::PI * r.min(s).powi(2);
    }
    let cut = |r: f64, s: f64| {
        let x = ((d * d + r * r - s * s) / (2.0 * d)).clamp(-r, r);
        r * r * (x / r).acos() - x * (r * r - x * x).max(0.0).sqrt()
    };
    cut(r, s) + cut(s, r)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seen_swapped_and_false_tracks_are_told_apart() {
        let at = |x: f64| DVec2::new(x, 0.0);
        let truth = Truth {
            marker_views: vec![vec![vec![(at(0.0), 1.0), (at(50.0), 1.0), (at(90.0), 0.0), (at(120.0), 0.3)]]],
            ..Truth::default()
        };
        let score = |tracks: [Option<f64>; 4]| {
            let rig = Rig { cameras: Vec::new() };
            evaluate_markers(&[0], (&rig, &[0]), &[0, 1, 2, 3], &[vec![tracks.map(|x| x.map(at)).to_vec()]], &truth)
        };
        let all = MarkerScores { visible: 2, within_2px: 2, swaps: 0, false_tracks: 0 };
        assert_eq!(score([Some(1.0), Some(50.5), None, Some(121.0)]), all);
        assert_eq!(score([Some(3.0), None, None, None]), MarkerScores { within_2px: 0, ..all });
        assert_eq!(score([Some(49.0), Some(50.0), None, None]), MarkerScores { within_2px: 1, swaps: 1, ..all });
        assert_eq!(score([Some(0.0), Some(50.0), Some(90.0), Some(123.0)]), MarkerScores { false_tracks: 2, ..all });
    }

    #[test]
    fn discs_have_in_common_what_circles_cut() {
        let disc = |x: f64, radius: f64, depth: f64| Disc { at: DVec2::new(x, 0.0), radius, depth };
        let pi = std::f64::consts::PI;
        // Two unit discs at a distance of 1: 2π/3 − √3/2.
        let lens = 2.0 * pi / 3.0 - 0.75f64.sqrt();
        assert!((common_area(&disc(0.0, 1.0, 0.0), &disc(1.0, 1.0, 0.0)) - lens).abs() < 1e-12);
        let discs = [disc(0.0, 1.0, 5.0), disc(1.0, 1.0, 4.0), disc(9.0, 1.0, 3.0)];
        assert!((left_by_nearer(&discs, 0) - (1.0 - lens / pi)).abs() < 1e-12);
        assert_eq!(left_by_nearer(&discs, 1), 1.0);
        assert_eq!(left_by_nearer(&[disc(0.0, 1.0, 5.0), disc(0.5, 2.0, 4.0)], 0), 0.0);
    }
}
