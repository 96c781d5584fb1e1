//! Frames that a person labelled: where tracks begin.

use std::{collections::BTreeMap, sync::Arc};

use glam::DVec2;
use strandflow_core::{Place, Report, RgbImage};

use super::{
    MarkerLabel,
    sight::{Shutters, Sight, shutter_of},
    solve::eq1,
    tracker::{Found, Looks, Points, Tracker, expected, learnt},
};
use crate::{Mode, StageError};

/// A frame from which tracks are followed.
#[derive(Clone)]
pub(super) struct Anchor {
    pub frame: usize,
    pub found: Found,
    /// Centres of the markers that are labelled there.
    pub labelled: Points,
    /// What the markers look like from here on.
    pub looks: Looks,
    /// Whether it is not known how fast the head moves there.
    pub at_unknown_speed: bool,
}

impl Anchor {
    /// The labelled frame that everything begins from.
    pub fn base(tracker: &Tracker) -> Result<Self, StageError> {
        let (frame, looks) = (tracker.input.labelled, tracker.looks.clone());
        let found = match tracker.mode {
            Mode::Paper => tracker.base_frame(),
            Mode::Robust => tracker.base_frame_settled(&tracker.images(frame)?),
        };
        // Takes begin slowly: elsewhere the head may be in full motion.
        Ok(Self {
            frame,
            found,
            labelled: tracker.base.clone(),
            looks,
            at_unknown_speed: frame != tracker.input.frames.start,
        })
    }

    /// A corrected frame, and what was tracked up to it from the anchor next to it. Labelled points stay; other markers are
    /// searched, or followed, around them. What disagrees with the others is in the report.
    pub fn corrected(
        tracker: &Tracker,
        (frame, labels): (usize, &[MarkerLabel]),
        (previous, before): (&[Arc<RgbImage>], &[Found]),
        mut looks: Looks,
        report: &mut Report,
    ) -> Result<Self, StageError> {
        let images = tracker.images(frame)?;
        let labelled = labelled(tracker, &images, (frame, labels), &mut looks)?;
        let found = match tracker.mode {
            Mode::Paper => {
                let followed = tracker.followed(previous, &images, &before[before.len() - 1].tracks);
                tracker.posed_by_eq1(over(followed, &labelled), before)
            }
            Mode::Robust => by_look(tracker, &images, &looks, &labelled, before),
        };
        for (view, points) in labelled.iter().enumerate() {
            for (m, point) in points.iter().enumerate() {
                let Some((point, expected)) = point.zip(tracker.expected_point(view, m, &found.pose)) else { continue };
                let off = point.distance(expected);
                if off > tracker.settings.inlier_px {
                    let place = Place::view_frame(&tracker.input.rig.cameras[view].name, frame);
                    let id = tracker.input.labels[m].id;
                    let fact = format!("the label of marker {id} is {off:.1} px from where the other points put it");
                    report.warn(place, fact, "the pose rests on the others more than on it");
                }
            }
        }
        Ok(Self { frame, found, labelled, looks, at_unknown_speed: true })
    }
}

/// Centres of the labelled markers; their looks replace those of before.
fn labelled(
    tracker: &Tracker,
    images: &[Arc<RgbImage>],
    (frame, labels): (usize, &[MarkerLabel]),
    looks: &mut Looks,
) -> Result<Points, StageError> {
    let input = tracker.input;
    let number: BTreeMap<u32, usize> = input.labels.iter().enumerate().map(|(m, label)| (label.id, m)).collect();
    let mut points: Points = vec![vec![None; input.labels.len()]; images.len()];
    for label in labels {
        let Some(&m) = number.get(&label.id) else { continue };
        for (&view, &point) in label.views.iter().filter(|(view, _)| **view < images.len()) {
            if !point.is_finite() {
                let place = Place::view_frame(&input.rig.cameras[view].name, frame);
                return Err(StageError::NonFinite { place, what: format!("label of marker {}", label.id) });
            }
            let (centre, look) = learnt(&images[view], point, tracker.settings.marker_radius_px);
            points[view][m] = Some(centre);
            looks[view][m] = look.or(looks[view][m]);
        }
    }
    Ok(points)
}

/// Robust mode. Labels of three markers fix the pose; fewer are added to what is found from the frame before.
fn by_look(tracker: &Tracker, images: &[Arc<RgbImage>], looks: &Looks, labelled: &Points, before: &[Found]) -> Found {
    let (expected, settings) = (expected(before), tracker.settings);
    let known = tracker.triangulated(labelled);
    let fixed = if tracker.in_common(&known) >= 3 { eq1(&tracker.model, &known) } else { None };
    let start = fixed.unwrap_or_else(|| tracker.by_look(images, looks, before, tracker.reach(before, 0)).0.pose);
    let from = before.last().filter(|found| found.is_known).map_or(start, |found| found.pose);
    let shutters = before.last().map_or_else(Shutters::default, |found| found.shutters);
    let sight = Sight { tracker, images, looks, before: from, shutter: shutter_of(&shutters) };
    // Around a pose that rests on labels, markers are at most a radius off; further away are others.
    let once = tracker.fit(&over(sight.search(&start, settings.marker_radius_px), labelled), start);
    let tracks = over(sight.search(&once, 0.5 * settings.marker_radius_px), labelled);
    let pose = tracker.fit(&tracks, once);
    let tracks = over(tracker.agreeing(tracks, &pose), labelled);
    Found { shutters, ..tracker.posed_by_fit(tracks, pose, expected) }
}

/// Points with labelled ones in their place.
fn over(mut points: Points, labelled: &[Vec<Option<DVec2>>]) -> Points {
    for (points, labelled) in points.iter_mut().zip(labelled) {
        points.iter_mut().zip(labelled).for_each(|(point, label)| *point = label.or(*point));
    }
    points
}
