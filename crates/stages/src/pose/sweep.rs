//! Tracks from labelled frames to all others, forward and backward.

use std::sync::Arc;

use strandflow_core::{Report, RgbImage};

use super::{
    MarkerLabel,
    anchor::Anchor,
    tracker::{Found, Looks, Tracker},
};
use crate::{Mode, StageError};

/// A corrected frame and its labels.
pub(super) type Correction<'a> = (usize, &'a [MarkerLabel]);

/// What every frame of the take shows.
pub(super) fn all_frames(tracker: &Tracker, report: &mut Report) -> Result<Vec<Found>, StageError> {
    let frames = tracker.input.frames;
    let base = Anchor::base(tracker)?;
    let [after, before] = corrections(tracker);
    let mut all = to_end(tracker, &base, &before, frames.start, report)?;
    all.reverse();
    all.push(base.found.clone());
    all.extend(to_end(tracker, &base, &after, frames.end - 1, report)?);
    for (frame, found) in (frames.start..frames.end).zip(&all) {
        tracker.report_lost(frame, found, report);
    }
    Ok(all)
}

/// The corrected frames behind the labelled one, and those before it; each from there on.
pub(super) fn corrections<'a>(tracker: &Tracker<'a>) -> [Vec<Correction<'a>>; 2] {
    let (frames, labelled) = (tracker.input.frames, tracker.input.labelled);
    let of = |range: std::ops::Range<usize>| tracker.input.corrections.range(range).map(|(&t, m)| (t, m.as_slice()));
    [of(labelled + 1..frames.end.max(labelled + 1)).collect(), of(frames.start..labelled).rev().collect()]
}

/// What the frames behind the labelled one show, up to an end of the take, in the order from there on.
fn to_end(
    tracker: &Tracker,
    base: &Anchor,
    corrections: &[Correction],
    end: usize,
    report: &mut Report,
) -> Result<Vec<Found>, StageError> {
    let mut all = Vec::new();
    let mut anchor = base.clone();
    for &(frame, labels) in corrections {
        let (mut ahead, next) = to_next(tracker, &anchor, (frame, labels), report)?;
        let back = swept(tracker, &next, &way(frame, anchor.frame))?.found;
        for (step, (ahead, back)) in ahead.iter_mut().zip(back.into_iter().rev()).enumerate() {
            let (from_anchor, from_next) = (step + 1, frame.abs_diff(anchor.frame) - step - 1);
            if is_better(&back, ahead, from_next < from_anchor) {
                *ahead = back;
            }
        }
        all.extend(ahead);
        all.push(next.found.clone());
        anchor = next;
    }
    let mut rest = way(anchor.frame, end);
    rest.extend((anchor.frame != end).then_some(end));
    all.extend(swept(tracker, &anchor, &rest)?.found);
    Ok(all)
}

/// What the frames between an anchor and a correction show as followed from the anchor, and the correction.
pub(super) fn to_next(
    tracker: &Tracker,
    anchor: &Anchor,
    (frame, labels): Correction,
    report: &mut Report,
) -> Result<(Vec<Found>, Anchor), StageError> {
    let Swept { found, images: previous, looks } = swept(tracker, anchor, &way(anchor.frame, frame))?;
    let before: Vec<Found> = std::iter::once(&anchor.found).chain(&found).cloned().collect();
    let next = Anchor::corrected(tracker, (frame, labels), (previous.as_slice(), before.as_slice()), looks, report)?;
    Ok((found, next))
}

/// The frames between two, in the order from one to the other.
fn way(from: usize, to: usize) -> Vec<usize> {
    if from < to { (from + 1..to).collect() } else { (to + 1..from).rev().collect() }
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
fn swept(tracker: &Tracker, anchor: &Anchor, frames: &[usize]) -> Result<Swept, StageError> {
    let mut found = vec![anchor.found.clone()];
    let mut looks = anchor.looks.clone();
    let mut previous = tracker.images(anchor.frame)?;
    for &frame in frames {
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
