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
    let (frames, labelled) = (tracker.input.frames, tracker.input.labelled);
    let base = Anchor::first(tracker)?;
    let backward: Vec<usize> = (frames.start..labelled).rev().collect();
    let forward: Vec<usize> = (labelled + 1..frames.end).collect();
    let mut all = along(tracker, &base, &backward, report)?;
    all.reverse();
    all.push(base.found.clone());
    all.extend(along(tracker, &base, &forward, report)?);
    for (frame, found) in (frames.start..frames.end).zip(&all) {
        tracker.report_lost(frame, found, report);
    }
    Ok(all)
}

/// What the frames of a path away from an anchor show, in that order. Between two labelled frames of the path each frame has
/// what comes from the one, or back from the other.
fn along(tracker: &Tracker, base: &Anchor, path: &[usize], report: &mut Report) -> Result<Vec<Found>, StageError> {
    let corrections = tracker.input.corrections;
    let (mut anchor, mut rest, mut all) = (base.clone(), path, Vec::with_capacity(path.len()));
    while let Some(at) = rest.iter().position(|frame| corrections.contains_key(frame)) {
        let (between, frame) = (&rest[..at], rest[at]);
        let Swept { found: mut away, images: previous, looks } = swept(tracker, &anchor, between.iter().copied())?;
        let before: Vec<Found> = std::iter::once(anchor.found.clone()).chain(away.iter().cloned()).collect();
        let seen_before = (previous.as_slice(), before.as_slice());
        let next = Anchor::corrected(tracker, (frame, &corrections[&frame]), seen_before, looks, report)?;
        let back = swept(tracker, &next, between.iter().rev().copied())?.found;
        for (t, (ahead, back)) in away.iter_mut().zip(back.into_iter().rev()).enumerate() {
            let (from_before, from_next) = (t + 1, at - t);
            if is_better(&back, ahead, from_next < from_before) {
                *ahead = back;
            }
        }
        all.extend(away);
        all.push(next.found.clone());
        (anchor, rest) = (next, &rest[at + 1..]);
    }
    all.extend(swept(tracker, &anchor, rest.iter().copied())?.found);
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
                let more = usize::from(anchor.at_unknown_speed && found.len() == 1);
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
