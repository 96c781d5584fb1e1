//! The checks `epipolar` and `followed`: pairs of views against one another, by the markers that both see.
//!
//! A marker in one view gives a line in another, on which it must lie. A pair of views is judged without any third, so that one
//! view that is off spoils its own pairs and no others: the view that most of the distance goes to is the one.

use std::collections::BTreeMap;

use glam::DVec2;
use rayon::prelude::*;
use strandflow_core::{Camera, Rig};
use strandflow_geometry::epipolar::epipolar_distance;

use crate::{
    Evidence, Finding, Outcome,
    labels::{Label, median},
    turn::{Seen, Turn, sightings, turn_of},
};

/// Frames whose followed markers are compared: in more they lie on the same lines again.
const FRAMES: usize = 12;
/// Fewest marker-frames a pair is judged by.
const FEWEST: usize = 5;
/// What a pair's distance may be of the median pair's: in rigs that are sound the worst pair has twice as much.
const WORSE: f64 = 3.0;
/// Distance that a pair may have in any case, in radii of a marker: shading moves the middle of a ball by a tenth of its radius.
const SHADED: f64 = 0.15;
/// The same of labels, which people click: what two clicks scatter across a line.
const CLICKED: f64 = 0.5;
/// Distance beyond which a sighting is another marker \[px\].
const OUTLIER_PX: f64 = 8.0;

/// Two views and how their markers agree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// The views.
    pub views: [usize; 2],
    /// Median symmetric epipolar distance \[px\].
    pub px: f64,
    /// Marker-frames compared.
    pub count: usize,
}

/// All pairs of a rig that share enough markers.
pub fn pairs(rig: &Rig, seen: &[Seen]) -> Vec<Pair> {
    let views = rig.view_count();
    let all: Vec<[usize; 2]> = (0..views).flat_map(|b| (0..b).map(move |a| [a, b])).collect();
    let pair = |&[a, b]: &[usize; 2]| {
        let camera = |view: usize| -> &Camera { &rig.cameras[view] };
        let both = seen.iter().filter_map(|seen| Some((*seen.views.get(&a)?, *seen.views.get(&b)?)));
        let off: Vec<f64> =
            both.filter_map(|(at, other)| epipolar_distance((camera(a), at), (camera(b), other))).collect();
        let count = off.len();
        let px = median(off.into_iter()).filter(|_| count >= FEWEST)?;
        Some(Pair { views: [a, b], px, count })
    };
    all.par_iter().filter_map(pair).collect()
}

/// A view that disagrees with others.
#[derive(Clone, Debug, PartialEq)]
pub struct Odd {
    /// The view, or two of which nothing tells which is off.
    pub views: Vec<usize>,
    /// Its pairs that are off, out of all it has, and the median of their distances \[px\].
    pub off: usize,
    /// All its pairs.
    pub of: usize,
    /// Median distance over the pairs that are off \[px\].
    pub px: f64,
}

/// The views without which no pair is further off than `limit` \[px\], the worst first.
pub fn odd_views(pairs: &[Pair], limit: f64) -> Vec<Odd> {
    let mut left: Vec<Pair> = pairs.to_vec();
    let mut odd = Vec::new();
    while let Some(worst) = left.iter().filter(|pair| pair.px > limit).copied().max_by(|a, b| a.px.total_cmp(&b.px)) {
        // What is off of a view, summed: a view that is right has a part of it with each view that is wrong.
        let off_of = |view: usize| -> Vec<f64> {
            left.iter().filter(|pair| pair.views.contains(&view) && pair.px > limit).map(|pair| pair.px).collect()
        };
        let weight = |view: usize| off_of(view).iter().map(|px| px * px).sum::<f64>();
        let [a, b] = worst.views;
        let views: Vec<usize> = left.iter().flat_map(|pair| pair.views).collect();
        let most = views.into_iter().max_by(|a, b| weight(*a).total_cmp(&weight(*b)).then(b.cmp(a))).unwrap_or(a);
        // A pair that is off alone tells nothing of which of the two it is.
        let alone = off_of(a).len() == 1 && off_of(b).len() == 1;
        let named = if alone { vec![a, b] } else { vec![most] };
        let of = |view: &usize| left.iter().filter(|pair| pair.views.contains(view)).count();
        let off = off_of(named[0]);
        odd.push(Odd {
            off: off.len(),
            of: named.iter().map(of).max().unwrap_or(0),
            px: median(off.into_iter()).unwrap_or(worst.px),
            views: named.clone(),
        });
        left.retain(|pair| !pair.views.iter().any(|view| named.contains(view)));
    }
    odd
}

/// The check `epipolar`: labelled markers. It comes before the clocks, because a camera that was turned looks late.
pub(crate) fn by_labels(evidence: &mut Evidence) -> Outcome {
    by(evidence, &Markers { seen: labelled, called: "labelled markers", allowed: CLICKED })
}

/// The check `followed`: the same by followed markers, which nobody clicked and of which there are more.
pub(crate) fn by_followed(evidence: &mut Evidence) -> Outcome {
    by(evidence, &Markers { seen: followed, called: "followed markers", allowed: SHADED })
}

/// What views are compared by.
struct Markers {
    seen: fn(&Evidence) -> Vec<Seen>,
    called: &'static str,
    /// How far they may lie beside their lines in any case, in radii of a marker.
    allowed: f64,
}

fn by(evidence: &mut Evidence, markers: &Markers) -> Outcome {
    let mut measured = None;
    let mut findings = Vec::new();
    // Each view that is found is left out, because it makes others look odd.
    loop {
        let seen = (markers.seen)(evidence);
        let pairs = pairs(&evidence.mended, &seen);
        let Some(middle) = median(pairs.iter().map(|pair| pair.px)) else { break };
        measured.get_or_insert_with(|| in_words(evidence, &pairs, middle, markers.called));
        let limit = (markers.allowed * evidence.settings.pose.marker_radius_px).max(WORSE * middle);
        let odd = odd_views(&pairs, limit).into_iter().next();
        let turned = turned(evidence, &seen, odd.as_ref());
        let view = match (&odd, &turned) {
            (_, Some((view, _))) => *view,
            (Some(odd), None) if odd.views.len() == 1 => odd.views[0],
            (odd, None) => {
                findings.extend(odd.as_ref().map(|odd| of_two(evidence, odd, middle)));
                break;
            }
        };
        let odd = odd.filter(|odd| odd.views.contains(&view));
        findings.push(of_view(evidence, view, odd.as_ref(), turned.map(|(_, turn)| turn), middle));
        evidence.distrusted.push(view);
    }
    let called = markers.called;
    measured.map_or_else(
        || Outcome::unjudged(format!("no two views of known calibration and clock share {FEWEST} {called}")),
        |measured| Outcome::of(measured, findings),
    )
}

fn in_words(evidence: &Evidence, pairs: &[Pair], middle: f64, by: &str) -> String {
    let worst = pairs.iter().max_by(|a, b| a.px.total_cmp(&b.px));
    let worst = worst
        .map_or_else(String::new, |pair| format!("; worst pair {} {:.2} px", evidence.names(&pair.views), pair.px));
    format!(
        "{by} lie {middle:.2} px beside their lines in other views (median of {} pairs of views){worst}",
        pairs.len()
    )
}

/// The view that was turned, of those that are odd, or of all where none is: the one that the turn mends most.
fn turned(evidence: &Evidence, seen: &[Seen], odd: Option<&Odd>) -> Option<(usize, Turn)> {
    let rig = &evidence.mended;
    let views: Vec<usize> = odd.map_or_else(|| (0..rig.view_count()).collect(), |odd| odd.views.clone());
    let turn = |&view: &usize| {
        let sightings = sightings(rig, view, seen, evidence.settings.pose.inlier_px);
        Some((view, turn_of(&rig.cameras[view], &sightings, OUTLIER_PX).filter(Turn::is_sure)?))
    };
    let turns: Vec<(usize, Turn)> = views.par_iter().filter_map(turn).collect();
    turns.into_iter().max_by(|(_, a), (_, b)| (a.px[0] - a.px[1]).total_cmp(&(b.px[0] - b.px[1])))
}

const SUFFERS: &str =
    "lift: lines of this view meet those of others beside the hair; hull: it carves beside the subject";

/// What is said of one view: that it is odd, or turned, or both.
fn of_view(evidence: &Evidence, view: usize, odd: Option<&Odd>, turn: Option<Turn>, middle: f64) -> Finding {
    let mut facts = Vec::new();
    if let Some(odd) = odd {
        facts.push(format!(
            "disagrees with {} of {} views: markers lie {:.2} px beside their lines, {middle:.2} px in the median pair",
            odd.off, odd.of, odd.px
        ));
    }
    facts.extend(turn.map(|turn| turn.in_words()));
    let hint = if turn.is_some() {
        "the camera was turned after the calibration, or its R is wrong: calibrate it again, hold it out, or leave it out"
    } else {
        "was the camera moved or zoomed after the calibration? Calibrate it again, hold it out, or leave it out"
    };
    let finding = Finding::look("epipolar", format!("view {}", evidence.name(view)), facts.join("; "));
    evidence.unless_held_out(&[view], finding.suffers(SUFFERS).hint(hint))
}

fn of_two(evidence: &Evidence, odd: &Odd, middle: f64) -> Finding {
    let fact = format!(
        "these two disagree: markers lie {:.2} px beside their lines, {middle:.2} px in the median pair; nothing tells which of them is off",
        odd.px
    );
    let finding = Finding::look("epipolar", format!("view {}", evidence.names(&odd.views)), fact)
        .hint("label more of the markers that they share with other views, or calibrate again");
    evidence.unless_held_out(&odd.views, finding.suffers(SUFFERS))
}

fn is_judged(evidence: &Evidence, view: usize) -> bool {
    let left_out = [&evidence.distrusted, &evidence.mended_roughly, &evidence.out_of_time];
    !left_out.iter().any(|views| views.contains(&view)) && evidence.fits(view)
}

/// Markers in some frames, as they were followed in each view by itself.
fn followed(evidence: &Evidence) -> Vec<Seen> {
    let frames = evidence.followed.iter().map(|followed| followed.change.len()).max().unwrap_or(0);
    let step = frames.div_ceil(FRAMES).max(1);
    let mut all = Vec::new();
    for frame in (0..frames).step_by(step) {
        for marker in 0..evidence.labels.len() {
            let at = |view: usize| evidence.followed.get(view)?.tracks.get(&marker)?.get(frame).copied().flatten();
            let judged = (0..evidence.views.len()).filter(|&view| is_judged(evidence, view));
            let views: BTreeMap<usize, DVec2> = judged.filter_map(|view| Some((view, at(view)?))).collect();
            all.extend((views.len() >= 2).then_some(Seen { marker, views }));
        }
    }
    all
}

/// The labels.
fn labelled(evidence: &Evidence) -> Vec<Seen> {
    let judged = |(marker, label): (usize, &Label)| {
        let views = label.views.iter().filter(|(view, _)| is_judged(evidence, **view));
        Seen { marker, views: views.map(|(&view, &at)| (view, at)).collect() }
    };
    evidence.labels.iter().enumerate().map(judged).filter(|seen| seen.views.len() >= 2).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::labels::tests::{labels, rig};
    use glam::{DMat3, DVec3};
    use strandflow_core::RigidTransform;

    fn seen() -> Vec<Seen> {
        labels().into_iter().enumerate().map(|(marker, label)| Seen { marker, views: label.views }).collect()
    }

    /// Labels are off by a third of a pixel.
    const LIMIT: f64 = 0.8;

    #[test]
    fn a_sound_rig_has_no_odd_view() {
        let pairs = pairs(&rig(), &seen());
        assert!(pairs.len() == 15 && pairs.iter().all(|pair| pair.count == 8 && pair.px < 0.7), "{pairs:?}");
        assert!(odd_views(&pairs, LIMIT).is_empty());
    }

    #[test]
    fn a_view_turned_by_half_a_degree_is_named() {
        for axis in [DVec3::X, DVec3::Y] {
            for view in 0..6 {
                let mut rig = rig();
                let turn = DMat3::from_axis_angle(axis, 0.5f64.to_radians());
                let camera = &mut rig.cameras[view];
                camera.camera_from_world =
                    RigidTransform { rotation: turn, translation: DVec3::ZERO }.after(&camera.camera_from_world);
                let odd = odd_views(&pairs(&rig, &seen()), LIMIT);
                let named: Vec<_> = odd.iter().map(|odd| odd.views.as_slice()).collect();
                assert_eq!(named, [[view].as_slice()], "{axis}: {odd:?} {:?}", pairs(&rig, &seen()));
            }
        }
    }

    #[test]
    fn of_a_pair_alone_nobody_knows_which_it_is() {
        let pair = |a: usize, b: usize, px: f64| Pair { views: [a, b], px, count: 9 };
        let pairs = [pair(0, 1, 0.3), pair(0, 2, 0.3), pair(1, 2, 7.0), pair(2, 3, 0.2)];
        assert_eq!(odd_views(&pairs, 1.0)[0].views, [1, 2]);
        let pairs = [pair(0, 1, 0.3), pair(0, 2, 5.0), pair(1, 2, 7.0), pair(2, 3, 0.2)];
        let odd = &odd_views(&pairs, 1.0)[0];
        assert_eq!((odd.views.as_slice(), odd.off, odd.of), ([2].as_slice(), 2, 3));
    }
}
