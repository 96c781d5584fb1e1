//! Markers that begin in another frame than the labelled one: their place on the head by its pose there.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec2;
use strandflow_core::{Camera, Place, Report};
use strandflow_geometry::triangulate::triangulate;

use super::{
    anchor::Anchor,
    sweep::{Correction, corrections, to_next},
    tracker::{Points, Tracker, lend_look},
};
use crate::StageError;

/// Labels of markers without a place, by marker: each with its view and that view's camera as the head sees it.
type Sightings = BTreeMap<usize, Vec<(usize, Camera, DVec2)>>;

/// Gives every marker its place on the head, as far as labels tell it. A head that only such markers show in a correction is
/// found in the next round, with those that were placed in this one. What stays without a place is in the report.
pub(super) fn place_all(tracker: &mut Tracker, report: &mut Report) -> Result<(), StageError> {
    while place(tracker)? {}
    let begin = labelled_late(tracker);
    for (m, label) in tracker.input.labels.iter().enumerate().filter(|(m, _)| tracker.model[*m].is_none()) {
        if let Some(&frame) = begin.get(&m) {
            let fact =
                format!("marker {} is not labelled in two views that agree, in frames whose pose is known", label.id);
            report.warn(Place::frame(frame), fact, "it has no place on the head and is not tracked");
        }
    }
    Ok(())
}

/// Frames in which markers without a place are first corrected, by marker.
fn labelled_late(tracker: &Tracker) -> BTreeMap<usize, usize> {
    let mut begin = BTreeMap::new();
    for (&frame, labels) in tracker.input.corrections.range(tracker.input.frames.start..tracker.input.frames.end) {
        for label in labels.iter().filter(|label| !label.views.is_empty()) {
            let m = tracker.input.labels.iter().position(|known| known.id == label.id);
            if let Some(m) = m.filter(|m| tracker.model[*m].is_none()) {
                begin.entry(m).or_insert(frame);
            }
        }
    }
    begin
}

/// One round over the corrections; whether a marker got a place in it.
fn place(tracker: &mut Tracker) -> Result<bool, StageError> {
    let late: BTreeSet<usize> = labelled_late(tracker).into_keys().collect();
    if late.is_empty() {
        return Ok(false);
    }
    let base = Anchor::base(tracker)?;
    let (mut sightings, mut unsaid) = (Sightings::new(), Report::default());
    for way in corrections(tracker) {
        let mut anchor = base.clone();
        let is_late = |(_, labels): &Correction| {
            labels.iter().any(|label| late.iter().any(|&m| tracker.input.labels[m].id == label.id))
        };
        let last = way.iter().rposition(is_late).map_or(0, |at| at + 1);
        for &correction in &way[..last] {
            let (_, mut next) = to_next(tracker, &anchor, correction, &mut unsaid)?;
            if next.found.is_known {
                see(tracker, &mut next, &late, &mut sightings);
            }
            anchor = next;
        }
    }
    Ok(late.iter().any(|&m| tracker.model[m].is_some()))
}

/// Takes in what a correction shows of markers without a place, and places those that two views agree on.
fn see(tracker: &mut Tracker, anchor: &mut Anchor, late: &BTreeSet<usize>, sightings: &mut Sightings) {
    let labelled = anchor.labelled.clone();
    for &m in late {
        for (view, point) in of_marker(&labelled, m) {
            let camera = &tracker.input.rig.cameras[view];
            let camera_from_world = camera.camera_from_world.after(&anchor.found.pose);
            sightings.entry(m).or_default().push((view, Camera { camera_from_world, ..camera.clone() }, point));
            // Its look is that of the frame in which it is first seen so.
            tracker.looks[view][m] = tracker.looks[view][m].filter(|look| !look.is_lent).or(anchor.looks[view][m]);
        }
        let Some(seen) = sightings.get(&m).filter(|_| of_marker(&labelled, m).next().is_some()) else { continue };
        // A view that stands still sees no depth, however often it looks.
        if seen.iter().all(|(view, ..)| *view == seen[0].0) {
            continue;
        }
        let rays: Vec<(&Camera, DVec2)> = seen.iter().map(|(_, camera, point)| (camera, *point)).collect();
        let Some(found) = triangulate(&rays, tracker.settings.inlier_px) else { continue };
        tracker.model[m] = Some(found.point);
        lend_look(&mut tracker.looks, m);
        lend_look(&mut anchor.looks, m);
    }
}

/// Points of a marker by view.
fn of_marker(points: &Points, m: usize) -> impl Iterator<Item = (usize, DVec2)> + '_ {
    points.iter().enumerate().filter_map(move |(view, points)| Some((view, points[m]?)))
}
