//! Scores of marker tracks: seen and followed, exchanged, followed where nothing is seen.

use glam::DVec2;
use serde::{Deserialize, Serialize};

use crate::truth::Truth;

/// A marker counts as visible in a view where at least this share of its disc is seen.
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
    views: &[usize],
    ids: &[u32],
    tracks: &[Vec<Vec<Option<DVec2>>>],
    truth: &Truth,
) -> MarkerScores {
    let mut scores = MarkerScores::default();
    for (frame, tracks) in frames.iter().zip(tracks) {
        let Some(of_views) = truth.marker_views.get(*frame as usize) else { continue };
        for &view in views {
            let (Some(points), Some(tracks)) = (of_views.get(view), tracks.get(view)) else { continue };
            for (&id, &track) in ids.iter().zip(tracks).filter(|(id, _)| (**id as usize) < points.len()) {
                scores.count(track, points, id as usize);
            }
        }
    }
    scores
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
            evaluate_markers(&[0], &[0], &[0, 1, 2, 3], &[vec![tracks.map(|x| x.map(at)).to_vec()]], &truth)
        };
        let all = MarkerScores { visible: 2, within_2px: 2, swaps: 0, false_tracks: 0 };
        assert_eq!(score([Some(1.0), Some(50.5), None, Some(121.0)]), all);
        assert_eq!(score([Some(3.0), None, None, None]), MarkerScores { within_2px: 0, ..all });
        assert_eq!(score([Some(49.0), Some(50.0), None, None]), MarkerScores { within_2px: 1, swaps: 1, ..all });
        assert_eq!(score([Some(0.0), Some(50.0), Some(90.0), Some(123.0)]), MarkerScores { false_tracks: 2, ..all });
        assert_eq!(evaluate_markers(&[0], &[], &[0], &[vec![vec![None]]], &truth).visible, 0);
    }
}
