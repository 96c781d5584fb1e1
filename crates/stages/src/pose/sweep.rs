//! Tracks from labelled frames to all others, forward and backward.

use std::sync::Arc;

use strandflow_core::{Report, RgbImage};

use super::{
    anchor::Anchor,
    tracker::{Found, Looks, Tracker},
};
use crate::{Mode, StageError};

/// What every frame of the take shows.
pub(super) fn all_frames(tracker: &Tracker, report: &mut Report) -> Result<Vec<Found>, StageError> {
    let frames = tracker.input.frames;
    let mut anchor = Anchor::first(tracker)?;
    let mut all = vec![anchor.found.clone()];
    let corrections = tracker.input.corrections.range(frames.start + 1..).filter(|(frame, _)| **frame < frames.end);
    for (&frame, labels) in corrections {
        let Swept { found: mut forward, images: previous, looks } = swept(tracker, &anchor, anchor.frame + 1..frame)?;
        let before: Vec<Found> = std::iter::once(anchor.found.clone()).chain(forward.iter().cloned()).collect();
        let seen_before = (previous.as_slice(), before.as_slice());
        let next = Anchor::corrected(tracker, (frame, labels.as_slice()), seen_before, looks, report)?;
        let backward = swept(tracker, &next, (anchor.frame + 1..frame).rev())?.found;
        for (t, (ahead, back)) in forward.iter_mut().zip(backward.into_iter().rev()).enumerate() {
            let from_before = t + 1;
            let is_nearer = frame - (anchor.frame + from_before) < from_before;
            if is_better(&back, ahead, is_nearer) {
                *ahead = back;
            }
        }
        all.extend(forward);
        all.push(next.found.clone());
        anchor = next;
    }
    all.extend(swept(tracker, &anchor, anchor.frame + 1..frames.end)?.found);
    for (frame, found) in (frames.start..frames.end).zip(&all) {
        tracker.report_lost(frame, found, report);
    }
    Ok(all)
}

/// More seen is better; where both see as much, what comes from nearer.
fn is_better(one: &Found, other: &Found, is_nearer: bool) -> bool {
    let seen = |found: &Found| (found.is_known, found.tracks.iter().flatten().flatten().count());
    match seen(one).cmp(&seen(other)) {
        std::cmp::Ordering::Equal => is_nearer,
        more => more.is_gt(),
    }
}

/// Frames followed from an anchor.
struct Swept {
    found: Vec<Found>,
    /// The images of the last of them.
    images: Vec<Arc<RgbImage>>,
    /// What the markers look like after it.
    looks: Looks,
}

/// Frame after frame from an anchor, in either direction.
fn swept(tracker: &Tracker, anchor: &Anchor, frames: impl Iterator<Item = usize>) -> Result<Swept, StageError> {
    let mut found = vec![anchor.found.clone()];
    let mut looks = anchor.looks.clone();
    let mut previous = tracker.images(anchor.frame)?;
    for frame in frames {
        let images = tracker.images(frame)?;
        let next = match tracker.mode {
            Mode::Paper => {
                let tracks = tracker.followed(&previous, &images, &found[found.len() - 1].tracks);
                tracker.posed_by_eq1(tracks, &found)
            }
            Mode::Robust => {
                // At a correction the head may be in full motion, at an unknown speed.
                let more = usize::from(anchor.is_correction && found.len() == 1);
                let (next, after) = tracker.by_look(&images, &looks, &found, tracker.reach(&found, more));
                looks = after;
                next
            }
        };
        found.push(next);
        previous = images;
    }
    found.remove(0);
    Ok(Swept { found, images: previous, looks })
}
