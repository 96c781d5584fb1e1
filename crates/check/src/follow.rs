//! Markers followed by their look in each view by itself: what is compared between views must not be shared between them.

use std::collections::BTreeMap;

use glam::DVec2;
use rayon::prelude::*;
use strandflow_core::FrameRange;
use strandflow_image::{blob::Blob, colour::luma_of};
use strandflow_stages::pose::PoseSettings;

use crate::Evidence;

/// What a view's footage shows over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Followed {
    /// Marker centres \[px\], by marker index, one a frame; `None` where lost.
    pub tracks: BTreeMap<usize, Vec<Option<DVec2>>>,
    /// Mean absolute difference in luma to the frame before \[codes\], one a frame; `None` for the first.
    pub change: Vec<Option<f32>>,
}

/// Frames in which a marker may be lost before it is given up: longer, and what comes back may be another.
const PATIENCE: usize = 2;

/// Follows the labelled markers of every view over some frames, of which the labelled one is one: forward and backward from it.
pub fn follow(evidence: &Evidence, frames: FrameRange) -> Vec<Followed> {
    (0..evidence.views.len()).into_par_iter().map(|view| follow_in(evidence, view, frames)).collect()
}

fn follow_in(evidence: &Evidence, view: usize, frames: FrameRange) -> Followed {
    let mut followed = Followed::default();
    let labelled = evidence.image(view, evidence.labelled).filter(|_| frames.contains(evidence.labelled));
    let Some(labelled) = labelled else { return followed };
    let settings = &evidence.settings.pose;
    let mut begun: BTreeMap<usize, Marker> = BTreeMap::new();
    for (marker, label) in evidence.labels.iter().enumerate() {
        let found = label.views.get(&view).and_then(|&at| Marker::begin(&labelled, at, settings));
        found.into_iter().for_each(|found| drop(begun.insert(marker, found)));
    }
    let mut ahead = begun.clone();
    let mut before: Option<std::sync::Arc<strandflow_core::RgbImage>> = None;
    for frame in frames.start..frames.end {
        let Some(image) = evidence.image(view, frame) else { break };
        followed.change.push(before.map(|before| change(&before, &image)));
        if frame > evidence.labelled {
            ahead.values_mut().for_each(|marker| marker.step(&image, settings));
        }
        before = Some(image);
    }
    let mut back = begun;
    for frame in (frames.start..evidence.labelled).rev() {
        match evidence.image(view, frame) {
            Some(image) => back.values_mut().for_each(|marker| marker.step(&image, settings)),
            None => back.values_mut().for_each(|marker| marker.track.push(None)),
        }
    }
    // Both hold the labelled frame. Where the footage ends before it, nothing is behind.
    for (marker, back) in back {
        let mut track: Vec<Option<DVec2>> = back.track.into_iter().rev().collect();
        track.extend(ahead.remove(&marker).into_iter().flat_map(|ahead| ahead.track.into_iter().skip(1)));
        followed.tracks.insert(marker, track);
    }
    followed
}

/// Mean absolute difference of two images in luma, over every third row \[codes\].
fn change(before: &strandflow_core::RgbImage, after: &strandflow_core::RgbImage) -> f32 {
    let (mut sum, mut count) = (0.0f64, 0usize);
    for y in (0..before.height.min(after.height)).step_by(3) {
        for (a, b) in before.row(y).iter().zip(after.row(y)) {
            sum += f64::from((luma_of(*a) - luma_of(*b)).abs());
            count += 1;
        }
    }
    (sum / count.max(1) as f64) as f32
}

/// A marker being followed.
#[derive(Clone)]
struct Marker {
    blob: Blob,
    /// Its score in the labelled frame.
    score: f64,
    track: Vec<Option<DVec2>>,
    /// Where it was last, and its step a frame.
    at: DVec2,
    step: DVec2,
    /// Frames since it was seen.
    lost: usize,
}

impl Marker {
    /// `None` where the label is on nothing that stands out.
    fn begin(image: &strandflow_core::RgbImage, label: DVec2, settings: &PoseSettings) -> Option<Self> {
        let radius = settings.marker_radius_px;
        let blob = Blob::learn(image, label, radius)?;
        let at = blob.centroid(image, label);
        let score = blob.score(image, at);
        let kept = at.distance(label) <= 0.6 * radius && score > 0.2;
        kept.then(|| Self { blob, score, track: vec![Some(at)], at, step: DVec2::ZERO, lost: 0 })
    }

    fn step(&mut self, image: &strandflow_core::RgbImage, settings: &PoseSettings) {
        if self.lost > PATIENCE {
            self.track.push(None);
            return;
        }
        let gap = (self.lost + 1) as f64;
        let expected = self.at + self.step * gap;
        let size = DVec2::new(image.width as f64, image.height as f64);
        let inside = expected.cmpge(DVec2::ZERO).all() && expected.cmplt(size).all();
        let reach = 0.5 * settings.search_px * gap;
        let found = if inside { self.blob.search(image, expected, reach) } else { None };
        match found.filter(|found| found.score >= settings.accept * self.score) {
            Some(found) => {
                (self.step, self.at, self.lost) = ((found.centre - self.at) / gap, found.centre, 0);
                self.track.push(Some(found.centre));
            }
            None => {
                self.lost += 1;
                self.track.push(None);
            }
        }
    }
}
