//! When each view saw what it shows: the time that lets a view's markers lie where the others', moved on, say they are.
//!
//! Markers followed in every view by itself are triangulated from the other views; their points are projected into the
//! view at moments between frames, and the moment that fits is the view's delay. A clip that lost a frame has one delay
//! before and another after.

use glam::{DVec2, DVec3};
use strandflow_core::{Camera, Rig};
use strandflow_geometry::{project::project, triangulate::triangulate};

use crate::{follow::Followed, labels::median};

/// Largest delay looked for \[frames\].
const REACH: f64 = 6.0;
/// Steps of the search \[frames\].
const STEP: f64 = 0.1;
/// Residual \[px\] beyond which an observation is an outlier: a marker lost or taken for another.
const OUTLIER_PX: f64 = 6.0;
/// Rounds in which delays found correct the points that they are found by: a view two frames off drags the points of its
/// markers by a sixth of that.
const ROUNDS: usize = 3;
/// Scatter of marker centres that is assumed where all fit better than that \[px\].
const CENTRE_PX: f64 = 0.15;

/// When a view saw what it shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Clock {
    /// How many frames later than the others' the moments are that it shows: positive where it is ahead.
    pub ahead: f64,
    /// Standard error of that \[frames\]; infinite where nothing moves.
    pub error: f64,
    /// A change within the clip: the first frame after it, and by how much it is ahead before and after.
    pub change: Option<(usize, f64, f64)>,
    /// Root mean square distance between markers and where they are expected, in time \[px\].
    pub rms_px: f64,
}

/// The clocks of all views; `None` where too few markers of a view can be compared. Views that are left out neither help
/// nor are judged. Delays are relative to the median view.
pub fn clocks(rig: &Rig, followed: &[Followed], left_out: &[usize], inlier_px: f64) -> Vec<Option<Clock>> {
    let mut clocks: Vec<Option<Clock>> = vec![None; rig.view_count()];
    for _ in 0..ROUNDS {
        let in_time: Vec<Timed> = followed.iter().zip(&clocks).map(|(f, clock)| Timed { followed: f, clock }).collect();
        let next: Vec<Option<Clock>> = (0..rig.view_count())
            .map(
                |view| {
                    if left_out.contains(&view) { None } else { clock_of(rig, &in_time, (view, left_out), inlier_px) }
                },
            )
            .collect();
        let middle = median(next.iter().flatten().map(|clock| clock.ahead)).unwrap_or(0.0);
        clocks = next;
        for clock in clocks.iter_mut().flatten() {
            clock.ahead -= middle;
            clock.change = clock.change.map(|(frame, before, after)| (frame, before - middle, after - middle));
        }
    }
    clocks
}

/// A view's markers with what is known of its clock.
struct Timed<'a> {
    followed: &'a Followed,
    clock: &'a Option<Clock>,
}

impl Timed<'_> {
    /// By how much a frame is ahead.
    fn ahead(&self, frame: usize) -> f64 {
        match self.clock {
            Some(Clock { change: Some((at, before, after)), .. }) => {
                if frame < *at {
                    *before
                } else {
                    *after
                }
            }
            Some(clock) => clock.ahead,
            None => 0.0,
        }
    }

    /// Where a marker was at a moment, between the two frames around it that show it.
    fn at(&self, marker: usize, moment: f64) -> Option<DVec2> {
        let track = self.followed.tracks.get(&marker)?;
        let shows = |frame: usize| frame as f64 + self.ahead(frame);
        // Frames rise, and so do their moments but at a change; two steps find the frame before the moment.
        let last = (0..track.len()).rev().find(|&frame| shows(frame) <= moment + 1e-9)?;
        let (from, next) = (shows(last), last + 1);
        if (moment - from).abs() < 1e-6 {
            return track[last];
        }
        let to = (next < track.len()).then(|| shows(next))?;
        let share = (moment - from) / (to - from);
        (to > from && to - from < 3.0).then_some(())?;
        Some(track[last]?.lerp(track[next]?, share))
    }
}

/// How far a view's markers are from where they are expected, by frame and delay tried.
struct Compared {
    /// Squared distances summed over markers \[px²\], and their number; shape (frames, delays).
    cost: Vec<Vec<(f64, usize)>>,
    /// Squared speed in the image, summed over the markers of a frame \[px²/frame²\].
    speed: Vec<f64>,
}

/// Largest delay looked for in clips of so many frames: a third of them.
fn reach(frames: usize) -> f64 {
    REACH.min((frames / 3) as f64)
}

fn delays(frames: usize) -> impl Iterator<Item = f64> {
    let half = (reach(frames) / STEP).round() as i64;
    (-half..=half).map(|k| k as f64 * STEP)
}

fn clock_of(rig: &Rig, timed: &[Timed], who: (usize, &[usize]), inlier_px: f64) -> Option<Clock> {
    let compared = compared(rig, timed, who, inlier_px)?;
    let frames = compared.cost.len();
    let whole = best(&compared, 0..frames)?;
    let scatter2 = |mean: f64| (0.5 * mean).max(CENTRE_PX * CENTRE_PX);
    // The best split in two: the cost falls by far where the clip lost a frame, and hardly at all where it did not.
    let halves = |at: usize| Some((at, best(&compared, 0..at)?, best(&compared, at..frames)?));
    let sum = |(_, before, after): &(usize, Fit, Fit)| before.sum() + after.sum();
    let split = (2..frames.saturating_sub(1)).filter_map(halves).min_by(|a, b| sum(a).total_cmp(&sum(b)));
    let split = split.filter(|split| {
        let (at, before, after) = split;
        let mean = sum(split) / (before.count + after.count) as f64;
        let gain = (whole.mean * (before.count + after.count) as f64 - sum(split)) / scatter2(mean);
        let known = |range: std::ops::Range<usize>| error_of(&compared, range, scatter2(mean)) < KNOWN;
        (after.ahead - before.ahead).abs() > 0.5 && gain > GAIN && known(0..*at) && known(*at..frames)
    });
    let mean = split.as_ref().map_or(whole.mean, |split| sum(split) / (split.1.count + split.2.count) as f64);
    // At the end of the search nothing was found.
    let found = whole.ahead.abs() < reach(frames) - STEP;
    let error = if found { error_of(&compared, 0..frames, scatter2(mean)) } else { f64::INFINITY };
    let change = split.map(|(at, before, after)| (at, before.ahead, after.ahead));
    Some(Clock { ahead: whole.ahead, error, change, rms_px: mean.sqrt() })
}

/// Fall of the cost, in variances of a marker's centre, from which on a clip has a change within: chance gives some tens.
const GAIN: f64 = 150.0;
/// Standard error of a delay that counts as known \[frames\].
const KNOWN: f64 = 0.15;

fn error_of(compared: &Compared, range: std::ops::Range<usize>, sigma2: f64) -> f64 {
    let speed: f64 = compared.speed[range].iter().sum();
    if speed > 0.0 { (sigma2 / speed).sqrt() } else { f64::INFINITY }
}

/// A delay over a range of frames.
#[derive(Clone, Copy, Debug)]
struct Fit {
    ahead: f64,
    /// Mean squared distance \[px²\], and of how many.
    mean: f64,
    count: usize,
}

impl Fit {
    fn sum(&self) -> f64 {
        self.mean * self.count as f64
    }
}

/// The delay of least mean cost over a range of frames, refined by a parabola. Moments that lie outside the clips are not
/// compared; a delay that leaves fewer than half to compare is not tried.
fn best(compared: &Compared, frames: std::ops::Range<usize>) -> Option<Fit> {
    let ahead: Vec<f64> = delays(compared.cost.len()).collect();
    let total: Vec<(f64, usize)> = (0..ahead.len())
        .map(|k| compared.cost[frames.clone()].iter().fold((0.0, 0), |(c, n), row| (c + row[k].0, n + row[k].1)))
        .collect();
    let most = total.iter().map(|t| t.1).max().filter(|&n| n >= FEWEST)?;
    let mean: Vec<f64> = total.iter().map(|&(c, n)| if 2 * n >= most { c / n as f64 } else { f64::INFINITY }).collect();
    // Of equals the smallest delay: where nothing moves, none is found.
    let order = |a: &usize, b: &usize| mean[*a].total_cmp(&mean[*b]).then(ahead[*a].abs().total_cmp(&ahead[*b].abs()));
    let k = (0..mean.len()).min_by(order)?;
    let around = k.checked_sub(1).map(|before| (mean[before], mean.get(k + 1).copied().unwrap_or(f64::INFINITY)));
    let (off, less) = match around {
        Some((a, c)) if a.is_finite() && c.is_finite() && a + c > 2.0 * mean[k] => {
            let off = (0.5 * (a - c) / (a - 2.0 * mean[k] + c)).clamp(-0.5, 0.5);
            (off, 0.25 * (a - c) * off)
        }
        _ => (0.0, 0.0),
    };
    Some(Fit { ahead: ahead[k] + off * STEP, mean: (mean[k] - less).max(0.0), count: total[k].1 })
}

/// Fewest observations a delay is told from.
const FEWEST: usize = 6;

/// Compares a view with the points that the others give.
fn compared(rig: &Rig, timed: &[Timed], who: (usize, &[usize]), inlier_px: f64) -> Option<Compared> {
    let view = who.0;
    let frames = timed.iter().map(|t| t.followed.change.len()).max().unwrap_or(0);
    let mut compared =
        Compared { cost: vec![vec![(0.0, 0); delays(frames).count()]; frames], speed: vec![0.0; frames] };
    for (&marker, track) in &timed[view].followed.tracks {
        let path: Vec<Option<DVec3>> = (0..frames).map(|f| point(rig, timed, who, marker, f, inlier_px)).collect();
        let unbiased = |moment: f64| project(&rig.cameras[view], between(&path, moment)?);
        let bias = bias(track, unbiased);
        let expected = |moment: f64| Some(unbiased(moment)? + bias);
        for (frame, seen) in track.iter().enumerate() {
            let Some(seen) = *seen else { continue };
            for (sum, ahead) in compared.cost[frame].iter_mut().zip(delays(frames)) {
                let Some(at) = expected(frame as f64 + ahead) else { continue };
                *sum = (sum.0 + at.distance_squared(seen).min(OUTLIER_PX * OUTLIER_PX), sum.1 + 1);
            }
            if let (Some(a), Some(b)) = (expected(frame as f64 - 0.5), expected(frame as f64 + 0.5)) {
                compared.speed[frame] += a.distance_squared(b);
            }
        }
    }
    (frames > 0).then_some(compared)
}

/// Speed in the image up to which a delay moves nothing \[px/frame\].
const STILL: f64 = 0.3;
/// Largest bias that is one \[px\]; more is a marker taken for another.
const MOST_BIAS: f64 = 3.0;

/// How far a marker is seen from where it is expected while it hardly moves: shading and calibration shift its centre in
/// every frame alike, and must not be taken for a delay.
fn bias(track: &[Option<DVec2>], expected: impl Fn(f64) -> Option<DVec2>) -> DVec2 {
    let (mut sum, mut count) = (DVec2::ZERO, 0.0);
    for (frame, seen) in track.iter().enumerate() {
        let moment = frame as f64;
        // A path begins with the first frame.
        let (before, after) = (expected((moment - 1.0).max(0.0)), expected(moment + 1.0));
        let (Some(seen), Some(at), Some(before), Some(after)) = (seen, expected(moment), before, after) else {
            continue;
        };
        if before.distance(after) < 2.0 * STILL && at.distance(*seen) < MOST_BIAS {
            (sum, count) = (sum + *seen - at, count + 1.0);
        }
    }
    if count > 0.0 { sum / count } else { DVec2::ZERO }
}

/// A marker in space at a frame of the common clock, from the other views.
fn point(
    rig: &Rig,
    timed: &[Timed],
    (view, left_out): (usize, &[usize]),
    marker: usize,
    frame: usize,
    inlier_px: f64,
) -> Option<DVec3> {
    let others = (0..rig.view_count()).filter(|other| *other != view && !left_out.contains(other));
    let seen: Vec<(&Camera, DVec2)> =
        others.filter_map(|other| Some((&rig.cameras[other], timed[other].at(marker, frame as f64)?))).collect();
    let found = triangulate(&seen, inlier_px)?;
    // Two of many that agree may do so by chance.
    (found.inliers.len() > seen.len() / 2).then_some(found.point)
}

/// A path at a moment between frames; short gaps are bridged.
fn between(path: &[Option<DVec3>], moment: f64) -> Option<DVec3> {
    if moment < 0.0 || moment > (path.len() - 1) as f64 {
        return None;
    }
    let (low, high) = (moment.floor() as usize, moment.ceil() as usize);
    let from = (low.saturating_sub(BRIDGED)..=low).rev().find(|&f| path[f].is_some())?;
    let to = (high..path.len().min(high + BRIDGED + 1)).find(|&f| path[f].is_some())?;
    let (a, b) = (path[from]?, path[to]?);
    Some(if to == from { a } else { a.lerp(b, (moment - from as f64) / (to - from) as f64) })
}

/// Frames of a gap that a straight line bridges.
const BRIDGED: usize = 1;
