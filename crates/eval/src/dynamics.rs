//! Motion against truth: position and velocity, jitter and jerk, lengths, identity, window borders.
//!
//! Each reconstructed strand is given to one stable true strand, the one with the least mean distance in the middle frame
//! that both have, and is compared with that strand in every frame.

use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use strandflow_core::{Provenance, StrandSequence};
use strandflow_geometry::polyline;

use crate::index::{SampleIndex, sample_polyline};
use crate::lengths::present_length;
use crate::statistics::{Summary, evenly, root_mean_square, share, variation};
use crate::truth::Truth;

/// How much is looked at, and what counts as what.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DynamicsSampling {
    /// Strands, evenly chosen among those present.
    pub strands: usize,
    /// A strand whose particles are on the mean farther than this from every true strand is not given to one \[mm\].
    pub reach_mm: f64,
    /// A rise of the mean distance to the followed strand by more than this between two frames is an identity switch \[mm\].
    pub switch_mm: f64,
    /// Frames of a fitting window (borders at its multiples).
    pub window_frames: usize,
    /// Frame interval \[s\].
    pub frame_secs: f64,
}

impl Default for DynamicsSampling {
    fn default() -> Self {
        Self { strands: 1500, reach_mm: 20.0, switch_mm: 5.0, window_frames: 5, frame_secs: 0.01 }
    }
}

/// Scores of the motion.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DynamicsScores {
    /// Strands looked at, and those given to a true strand.
    pub strands: (usize, usize),
    /// Distance of each particle to its true strand \[mm\].
    pub position_mm: Summary,
    /// The same over the samples that the input of the refinement has, each strand given to a true strand by these alone;
    /// absent where no input was given.
    pub position_of_input_mm: Option<Summary>,
    /// Difference of the particles' velocities from the true strand's at the nearest place \[mm/s\].
    pub velocity_mm_s: Summary,
    /// Root mean square true speed at the same places \[mm/s\].
    pub true_speed_mm_s: f64,
    /// Mean velocity error over the mean true speed.
    pub velocity_share: f64,
    /// Root mean square second difference of the positions \[mm\].
    pub jitter_mm: f64,
    /// The true strands' at the same places \[mm\].
    pub true_jitter_mm: f64,
    /// `jitter_mm` − `true_jitter_mm` \[mm\].
    pub jitter_excess_mm: f64,
    /// Root mean square third difference over the true strands'.
    pub jerk_ratio: f64,
    /// Standard deviation of a strand's length over the frames, over its mean.
    pub length_variation: Summary,
    /// Share of the strands whose length varies by less than 2 %.
    pub length_within_two_percent: f64,
    /// Identity switches per strand and 100 frames.
    pub identity_switches: f64,
    /// Jitter at window borders over jitter elsewhere, the same ratio of the truth divided out.
    pub border_ratio: f64,
    /// How much was looked at.
    pub sampling: DynamicsSampling,
}

/// Scores a sequence over the frames that the truth has too. Missing samples take no part.
pub fn evaluate_dynamics(sequence: &StrandSequence, truth: &Truth, sampling: &DynamicsSampling) -> DynamicsScores {
    scores(sequence, None, truth, sampling)
}

/// Scores what a refinement made of its input: as [`evaluate_dynamics`], and the position error over the samples that the
/// input has, too. A refinement fills in what its input lacks; what it makes of what it was given shows there alone.
pub fn evaluate_refinement(
    sequence: &StrandSequence,
    input: &StrandSequence,
    truth: &Truth,
    sampling: &DynamicsSampling,
) -> DynamicsScores {
    scores(sequence, Some(input), truth, sampling)
}

fn scores(
    sequence: &StrandSequence,
    input: Option<&StrandSequence>,
    truth: &Truth,
    sampling: &DynamicsSampling,
) -> DynamicsScores {
    let frames: Vec<(usize, usize)> =
        sequence.frames.iter().enumerate().filter_map(|(t, f)| Some((t, truth.at(*f)?))).collect();
    let mut scores = DynamicsScores { sampling: *sampling, ..DynamicsScores::default() };
    if frames.is_empty() {
        return scores;
    }
    let indices = stable_indices(truth, &frames);
    let chosen = chosen_strands(sequence, sampling);
    let followed = follow_all(sequence, &chosen, truth, &frames, &indices, sampling);
    scores.position_of_input_mm = input.map(|input| {
        let given = only_where_given(sequence, input);
        let followed = follow_all(&given, &chosen_strands(&given, sampling), truth, &frames, &indices, sampling);
        Summary::of(followed.iter().flat_map(|s| &s.position).copied())
    });

    let all = |f: fn(&StrandRecord) -> &Vec<f64>| followed.iter().flat_map(f).copied();
    scores.strands = (chosen.len(), followed.len());
    scores.position_mm = Summary::of(all(|s| &s.position));
    scores.velocity_mm_s = Summary::of(all(|s| &s.velocity));
    scores.true_speed_mm_s = root_mean_square(all(|s| &s.true_speed));
    scores.velocity_share = ratio(scores.velocity_mm_s.mean, Summary::of(all(|s| &s.true_speed)).mean);
    let jitter = |border: Option<bool>, which: fn(&Second) -> f64| {
        let seconds = followed.iter().flat_map(|s| &s.second);
        root_mean_square(seconds.filter(|s| border.is_none_or(|b| s.border == b)).map(which))
    };
    scores.jitter_mm = jitter(None, |s| s.found);
    scores.true_jitter_mm = jitter(None, |s| s.expected);
    scores.jitter_excess_mm = scores.jitter_mm - scores.true_jitter_mm;
    scores.jerk_ratio = ratio(root_mean_square(all(|s| &s.third)), root_mean_square(all(|s| &s.true_third)));
    let border = |which: fn(&Second) -> f64| ratio(jitter(Some(true), which), jitter(Some(false), which));
    scores.border_ratio = ratio(border(|s| s.found), border(|s| s.expected));
    let pairs: usize = followed.iter().map(|s| s.pairs).sum();
    scores.identity_switches = 100.0 * share(followed.iter().map(|s| s.switches).sum(), pairs);

    let variations: Vec<f64> =
        chosen.iter().filter_map(|n| length_variation(sequence, *n, frames.iter().map(|f| f.0))).collect();
    scores.length_within_two_percent = share(variations.iter().filter(|v| **v < 0.02).count(), variations.len());
    scores.length_variation = Summary::of(variations);
    scores
}

/// Strands evenly chosen among those present.
fn chosen_strands(sequence: &StrandSequence, sampling: &DynamicsSampling) -> Vec<usize> {
    let present: Vec<usize> = (0..sequence.strand_count).filter(|n| sequence.counts[*n] > 1).collect();
    evenly(present.len(), sampling.strands).into_iter().map(|i| present[i]).collect()
}

fn follow_all(
    sequence: &StrandSequence,
    chosen: &[usize],
    truth: &Truth,
    frames: &[(usize, usize)],
    indices: &[SampleIndex],
    sampling: &DynamicsSampling,
) -> Vec<StrandRecord> {
    chosen.par_iter().filter_map(|n| follow(sequence, *n, truth, frames, indices, sampling)).collect()
}

/// The samples of a sequence that another one, of the same strands, has too.
fn only_where_given(sequence: &StrandSequence, input: &StrandSequence) -> StrandSequence {
    let point_count = sequence.point_count.min(input.point_count);
    let mut out = StrandSequence::missing(sequence.frames.clone(), input.counts.clone(), point_count);
    for (t, frame) in sequence.frames.iter().enumerate() {
        let Some(u) = input.frames.iter().position(|other| other == frame) else { continue };
        for n in 0..sequence.strand_count.min(input.strand_count) {
            let points = sequence.strand(t, n).iter().zip(input.strand(u, n)).enumerate();
            let start = out.range(t, n).start;
            for (p, (point, _)) in points.filter(|(_, (_, given))| given.is_finite()) {
                out.points[start + p] = *point;
                (out.provenance[start + p], out.confidence[start + p]) = (Provenance::Observed, 1.0);
            }
        }
    }
    out
}

fn ratio(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b } else { 0.0 }
}

/// Standard deviation over mean of a strand's length in these frames; `None` with fewer than three frames that have it.
///
/// The length of a frame is that of the points present, so a tail that comes and goes shows.
pub fn length_variation(sequence: &StrandSequence, strand: usize, frames: impl Iterator<Item = usize>) -> Option<f64> {
    let lengths: Vec<f64> = frames.filter_map(|t| present_length(sequence.strand(t, strand))).collect();
    variation(&lengths)
}

/// A second difference of a particle and of the true place it is compared with \[mm\].
struct Second {
    found: f64,
    expected: f64,
    border: bool,
}

/// What was measured on one strand.
#[derive(Default)]
struct StrandRecord {
    position: Vec<f64>,
    velocity: Vec<f64>,
    true_speed: Vec<f64>,
    second: Vec<Second>,
    third: Vec<f64>,
    true_third: Vec<f64>,
    pairs: usize,
    switches: usize,
}

/// Samples of the stable true strands, one index a frame.
fn stable_indices(truth: &Truth, frames: &[(usize, usize)]) -> Vec<SampleIndex> {
    let index = |u: usize| {
        let mut samples = Vec::new();
        let stable = (0..truth.strand_count()).filter(|n| truth.stable[*n]);
        stable.for_each(|n| sample_polyline(truth.strand(u, n), n as u32, 3.0, &mut samples));
        SampleIndex::new(&samples, 5.0)
    };
    frames.par_iter().map(|(_, u)| index(*u)).collect()
}

fn follow(
    sequence: &StrandSequence,
    strand: usize,
    truth: &Truth,
    frames: &[(usize, usize)],
    indices: &[SampleIndex],
    sampling: &DynamicsSampling,
) -> Option<StrandRecord> {
    let at = |i: usize| sequence.strand(frames[i].0, strand);
    let true_at = |i: usize, n: u32| truth.strand(frames[i].1, n as usize);
    // The frame nearest to the middle that has the strand decides which true strand it is.
    let middle = frames.len() / 2;
    let mut order: Vec<usize> = (0..frames.len()).collect();
    order.sort_by_key(|i| i.abs_diff(middle));
    let start = order.into_iter().find(|i| at(*i).iter().filter(|p| p.is_finite()).count() > 1)?;
    let own = assign(at(start), &indices[start], |n| true_at(start, n), sampling.reach_mm)?;

    // Position and velocity at the nearest place of the true strand, frame by frame.
    let mut record = StrandRecord::default();
    let adjacent = |i: usize, j: usize| sequence.frames[frames[j].0] - sequence.frames[frames[i].0] == (j - i) as u32;
    for i in 0..frames.len() {
        let inner = i > 0 && i + 1 < frames.len() && adjacent(i - 1, i + 1);
        for (p, point) in at(i).iter().enumerate().filter(|(_, point)| point.is_finite()) {
            let (place, distance) = nearest_place(*point, true_at(i, own));
            record.position.push(f64::from(distance));
            if !inner || !at(i - 1)[p].is_finite() || !at(i + 1)[p].is_finite() {
                continue;
            }
            let rate = (0.5 / sampling.frame_secs) as f32;
            let found = (at(i + 1)[p] - at(i - 1)[p]) * rate;
            let [before, now, after] = [i - 1, i, i + 1].map(|j| polyline::at_parameter(true_at(j, own), place));
            let expected = (after - before) * rate;
            record.velocity.push(f64::from(found.distance(expected)));
            record.true_speed.push(f64::from(expected.length()));
            let second = |a: Vec3, b: Vec3, c: Vec3| f64::from((a - b * 2.0 + c).length());
            record.second.push(Second {
                found: second(at(i - 1)[p], *point, at(i + 1)[p]),
                expected: second(before, now, after),
                border: (sequence.frames[frames[i].0] as usize).is_multiple_of(sampling.window_frames.max(1)),
            });
            if i + 2 < frames.len() && adjacent(i, i + 2) && at(i + 2)[p].is_finite() {
                let third = |a: Vec3, b: Vec3, c: Vec3, d: Vec3| f64::from((d - c * 3.0 + b * 3.0 - a).length());
                let further = polyline::at_parameter(true_at(i + 2, own), place);
                record.third.push(third(at(i - 1)[p], *point, at(i + 1)[p], at(i + 2)[p]));
                record.true_third.push(third(before, now, after, further));
            }
        }
    }
    count_switches(&mut record, frames.len(), own, start, &at, &true_at, indices, sampling);
    Some(record)
}

/// Walks from the first frame on; where the mean distance to the followed strand jumps, another strand is followed.
#[expect(clippy::too_many_arguments, reason = "closures over one strand's data")]
fn count_switches<'a>(
    record: &mut StrandRecord,
    frame_count: usize,
    own: u32,
    start: usize,
    at: &dyn Fn(usize) -> &'a [Vec3],
    true_at: &dyn Fn(usize, u32) -> &'a [Vec3],
    indices: &[SampleIndex],
    sampling: &DynamicsSampling,
) {
    let mut current = if start == 0 {
        Some(own)
    } else {
        assign(at(0), &indices[0], |n| true_at(0, n), sampling.reach_mm).or(Some(own))
    };
    for (i, index) in indices.iter().enumerate().take(frame_count).skip(1) {
        let Some(strand) = current else { break };
        let before = mean_distance(at(i - 1), true_at(i - 1, strand));
        let now = mean_distance(at(i), true_at(i, strand));
        let (Some(before), Some(now)) = (before, now) else { continue };
        record.pairs += 1;
        if now - before > sampling.switch_mm {
            record.switches += 1;
            current = assign(at(i), index, |n| true_at(i, n), sampling.reach_mm).or(current);
        }
    }
}

/// The true strand of least mean distance among those near any particle.
fn assign<'a>(
    points: &[Vec3],
    index: &SampleIndex,
    strand_of: impl Fn(u32) -> &'a [Vec3],
    reach_mm: f64,
) -> Option<u32> {
    let finite: Vec<Vec3> = points.iter().copied().filter(|p| p.is_finite()).collect();
    let mut candidates: Vec<u32> = Vec::new();
    for i in evenly(finite.len(), 12) {
        candidates.extend(index.nearest(finite[i], reach_mm as f32, |_| true).map(|(sample, _)| sample.strand));
    }
    candidates.sort_unstable();
    candidates.dedup();
    let scored = candidates.into_iter().filter_map(|n| Some((mean_distance(&finite, strand_of(n))?, n)));
    let best = scored.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))?;
    (best.0 <= reach_mm).then_some(best.1)
}

fn mean_distance(points: &[Vec3], strand: &[Vec3]) -> Option<f64> {
    let finite = points.iter().filter(|p| p.is_finite());
    let (sum, count) = finite.fold((0.0, 0), |(s, n), p| (s + f64::from(nearest_place(*p, strand).1), n + 1));
    (count > 0).then(|| sum / f64::from(count))
}

/// Parameter (in vertices) of the nearest place on a polyline, and its distance \[mm\].
pub fn nearest_place(point: Vec3, strand: &[Vec3]) -> (f32, f32) {
    let mut best = (0.0, strand.first().map_or(f32::INFINITY, |p| p.distance_squared(point)));
    for (i, pair) in strand.windows(2).enumerate() {
        let edge = pair[1] - pair[0];
        let u = ((point - pair[0]).dot(edge) / edge.length_squared().max(1e-12)).clamp(0.0, 1.0);
        let squared = (pair[0] + edge * u).distance_squared(point);
        if squared < best.1 {
            best = (i as f32 + u, squared);
        }
    }
    (best.0, best.1.sqrt())
}
