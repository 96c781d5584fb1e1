//! Reconstructed strands against true ones: precision, recall, F1, and whether a strand follows one true strand.
//!
//! A point is matched at (distance, angle) if a point of the other set lies within both; angles are undirected. Precision
//! is the share of reconstructed points that are matched by true ones, recall the converse (Nam et al. 2019).

use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use strandflow_core::{Rig, StrandSequence};

use crate::index::{SampleIndex, StrandSample, sample_polyline, undirected_cosine};
use crate::raster::{NO_STRAND, StrandView};
use crate::statistics::{Summary, evenly, share};
use crate::truth::Truth;

/// Distance \[mm\] and undirected angle \[degrees\] within which points match.
pub const THRESHOLDS: [(f32, f32); 3] = [(2.0, 20.0), (3.0, 30.0), (4.0, 40.0)];

/// How much is looked at.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StrandSampling {
    /// Frames, evenly chosen.
    pub frames: usize,
    /// Spacing of the points that are asked about \[mm\].
    pub query_mm: f32,
    /// At most this many points are asked about per frame and side, evenly chosen (a standard error below 0.3 %).
    pub queries: usize,
    /// Strands whose consistency is judged per frame, evenly chosen.
    pub consistency_strands: usize,
    /// Spacing of the points they are compared with \[mm\].
    pub target_mm: f32,
    /// A point is visible in a view if it lies at most this far behind what the view sees first \[mm\].
    pub visible_mm: f64,
}

impl Default for StrandSampling {
    fn default() -> Self {
        Self { frames: 6, query_mm: 4.0, queries: 30_000, consistency_strands: 800, target_mm: 1.0, visible_mm: 2.0 }
    }
}

/// Precision, recall and their harmonic mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct F1 {
    /// Share of reconstructed points that true points match.
    pub precision: f64,
    /// Share of true points that reconstructed points match.
    pub recall: f64,
    /// 2 P R / (P + R).
    pub f1: f64,
}

impl F1 {
    fn new(precision: f64, recall: f64) -> Self {
        let sum = precision + recall;
        Self { precision, recall, f1: if sum > 0.0 { 2.0 * precision * recall / sum } else { 0.0 } }
    }
}

/// Scores at one pair of thresholds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ThresholdScores {
    /// Distance \[mm\].
    pub distance_mm: f32,
    /// Undirected angle \[degrees\].
    pub angle_deg: f32,
    /// Over all points.
    pub all: F1,
    /// Over points visible in two or more views.
    pub visible: F1,
}

/// Scores of a sequence, means over the frames looked at.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StrandScores {
    /// Frames looked at.
    pub frames: Vec<u32>,
    /// Strands with two or more points, mean over the frames.
    pub strands: f64,
    /// Scores per threshold.
    pub thresholds: Vec<ThresholdScores>,
    /// Share of a strand's matched points (3 mm, 30°) whose nearest true point is on the strand's majority truth strand.
    pub consistency: f64,
    /// Share of a strand's matched points (3 mm, 30°) that one true strand matches, the best one.
    pub consistency_within: f64,
    /// Voxels of 3 mm that strands pass through, reconstructed against true.
    pub occupancy: F1,
    /// Depth of what a view sees first, reconstructed against true strands, at the pixels where it sees both: means over
    /// views and frames of the median error and of the median difference (positive: ours lies behind) \[mm\].
    pub surface_mm: (f64, f64),
    /// How much was looked at.
    pub sampling: StrandSampling,
}

/// Scores the strands of a sequence on frames that the truth has. A rig is needed for visibility; without one (no views)
/// the visible scores are zero.
pub fn evaluate_strands(
    sequence: &StrandSequence,
    truth: &Truth,
    rig: &Rig,
    sampling: &StrandSampling,
) -> StrandScores {
    let common: Vec<(usize, usize)> =
        sequence.frames.iter().enumerate().filter_map(|(t, frame)| Some((t, truth.at(*frame)?))).collect();
    let chosen: Vec<(usize, usize)> = evenly(common.len(), sampling.frames).into_iter().map(|i| common[i]).collect();
    let frames: Vec<FrameScores> = chosen.iter().map(|&(t, u)| frame(sequence, t, truth, u, rig, sampling)).collect();
    let mean = |f: &dyn Fn(&FrameScores) -> f64| frames.iter().map(f).sum::<f64>() / frames.len().max(1) as f64;
    let mean_f1 = |which: &dyn Fn(&FrameScores) -> F1| F1 {
        precision: mean(&|s| which(s).precision),
        recall: mean(&|s| which(s).recall),
        f1: mean(&|s| which(s).f1),
    };
    let thresholds = THRESHOLDS.iter().enumerate().map(|(i, &(distance_mm, angle_deg))| ThresholdScores {
        distance_mm,
        angle_deg,
        all: mean_f1(&|s| s.all[i]),
        visible: mean_f1(&|s| s.visible[i]),
    });
    StrandScores {
        frames: chosen.iter().map(|&(t, _)| sequence.frames[t]).collect(),
        strands: mean(&|s| s.strands as f64),
        thresholds: thresholds.collect(),
        consistency: mean(&|s| s.consistency.0),
        consistency_within: mean(&|s| s.consistency.1),
        occupancy: mean_f1(&|s| s.occupancy),
        surface_mm: (mean(&|s| s.surface_mm.0), mean(&|s| s.surface_mm.1)),
        sampling: *sampling,
    }
}

struct FrameScores {
    strands: usize,
    all: [F1; 3],
    visible: [F1; 3],
    consistency: (f64, f64),
    occupancy: F1,
    surface_mm: (f64, f64),
}

fn frame(
    sequence: &StrandSequence,
    t: usize,
    truth: &Truth,
    u: usize,
    rig: &Rig,
    sampling: &StrandSampling,
) -> FrameScores {
    let found: Vec<(u32, &[Vec3])> = (0..sequence.strand_count).map(|n| (n as u32, sequence.strand(t, n))).collect();
    let true_strands: Vec<(u32, &[Vec3])> = (0..truth.strand_count()).map(|n| (n as u32, truth.strand(u, n))).collect();
    let samples = |strands: &[(u32, &[Vec3])], step: f32| {
        let mut out = Vec::new();
        strands.iter().for_each(|(n, points)| sample_polyline(points, *n, step, &mut out));
        out
    };
    let (found_queries, true_queries) = (samples(&found, sampling.query_mm), samples(&true_strands, sampling.query_mm));
    let (found_targets, true_targets) =
        (samples(&found, sampling.target_mm), samples(&true_strands, sampling.target_mm));
    let occupancy = occupancy(&found_targets, &true_targets);
    let cell = THRESHOLDS[2].0;
    let (found_index, true_index) = (SampleIndex::new(&found_targets, cell), SampleIndex::new(&true_targets, cell));

    // Which thresholds each point meets, and whether two views see it.
    let head = truth.head_at(truth.frames[u]);
    let views: Vec<StrandView> =
        rig.cameras.par_iter().map(|camera| StrandView::draw(camera, true_strands.iter().copied(), &head)).collect();
    let seen = |point: Vec3| {
        let views = rig.cameras.iter().zip(&views);
        views.filter(|(camera, view)| view.sees(camera, point, sampling.visible_mm)).count() >= 2
    };
    let found_views: Vec<StrandView> =
        rig.cameras.par_iter().map(|camera| StrandView::draw(camera, found.iter().copied(), &head)).collect();
    let judge = |queries: &[StrandSample], index: &SampleIndex| -> Vec<([bool; 3], bool)> {
        queries.par_iter().map(|q| (matched(q, index), seen(q.position))).collect()
    };
    let thinned = |queries: &[StrandSample]| -> Vec<StrandSample> {
        evenly(queries.len(), sampling.queries).into_iter().map(|i| queries[i]).collect()
    };
    let of_found = judge(&thinned(&found_queries), &true_index);
    let of_true = judge(&thinned(&true_queries), &found_index);
    let rate = |judged: &[([bool; 3], bool)], i: usize, only_seen: bool| {
        let considered = judged.iter().filter(|(_, seen)| *seen || !only_seen);
        let (hits, all) = considered.fold((0, 0), |(h, n), (m, _)| (h + usize::from(m[i]), n + 1));
        share(hits, all)
    };
    let f1 = |only_seen| [0, 1, 2].map(|i| F1::new(rate(&of_found, i, only_seen), rate(&of_true, i, only_seen)));
    FrameScores {
        strands: found.iter().filter(|(_, p)| p.iter().filter(|p| p.is_finite()).count() >= 2).count(),
        all: f1(false),
        visible: f1(true),
        consistency: consistency(&found_queries, &true_index, sampling.consistency_strands),
        occupancy,
        surface_mm: surface(&found_views, &views),
    }
}

/// Edge of the voxels of the occupancy \[mm\].
const OCCUPANCY_MM: f32 = 3.0;

/// Voxels that samples fall into, against those of true ones.
fn occupancy(found: &[StrandSample], truth: &[StrandSample]) -> F1 {
    let voxels = |samples: &[StrandSample]| -> Vec<[i32; 3]> {
        let mut all: Vec<[i32; 3]> =
            samples.par_iter().map(|s| (s.position / OCCUPANCY_MM).floor().as_ivec3().to_array()).collect();
        all.par_sort_unstable();
        all.dedup();
        all
    };
    let (found, truth) = (voxels(found), voxels(truth));
    let both = found.iter().filter(|voxel| truth.binary_search(voxel).is_ok()).count();
    F1::new(share(both, found.len()), share(both, truth.len()))
}

/// Median error and median difference of the depth at which views see strands first \[mm\], means over the views.
fn surface(found: &[StrandView], truth: &[StrandView]) -> (f64, f64) {
    let view = |(found, truth): (&StrandView, &StrandView)| {
        let strands = found.strand.data.iter().zip(&truth.strand.data);
        let pixels = strands.zip(found.depth.data.iter().zip(&truth.depth.data));
        let seen = pixels.filter(|((a, b), _)| **a != NO_STRAND && **b != NO_STRAND);
        let off: Vec<f64> = seen.map(|(_, (ours, true_depth))| f64::from(ours - true_depth)).collect();
        let error = Summary::of(off.iter().map(|d| d.abs()));
        (error.count > 0).then(|| (error.median, Summary::of(off).median))
    };
    let views: Vec<(f64, f64)> = found.iter().zip(truth).filter_map(view).collect();
    let mean = |of: fn(&(f64, f64)) -> f64| views.iter().map(of).sum::<f64>() / views.len().max(1) as f64;
    (mean(|v| v.0), mean(|v| v.1))
}

/// Which of the thresholds are met by some point of the other set.
pub fn matched(query: &StrandSample, others: &SampleIndex) -> [bool; 3] {
    let squares = THRESHOLDS.map(|(distance, _)| distance * distance);
    let cosines = THRESHOLDS.map(|(_, angle)| angle.to_radians().cos());
    let mut met = [false; 3];
    others.within(query.position, THRESHOLDS[2].0, |other, squared| {
        let cosine = undirected_cosine(query.tangent, other.tangent);
        for i in 0..3 {
            met[i] |= squared <= squares[i] && cosine >= cosines[i];
        }
        !met[0]
    });
    if met[0] { [true; 3] } else { met }
}

/// Means over strands with five or more matched points: by nearest true point, and by the best true strand within reach.
fn consistency(queries: &[StrandSample], truth: &SampleIndex, most: usize) -> (f64, f64) {
    let (distance, cosine) = (THRESHOLDS[1].0, THRESHOLDS[1].1.to_radians().cos());
    let strands: Vec<&[StrandSample]> = queries.chunk_by(|a, b| a.strand == b.strand).collect();
    let shares: Vec<(f64, f64)> = evenly(strands.len(), most)
        .par_iter()
        .map(|i| strands[*i])
        .filter_map(|points| {
            let (mut nearest_votes, mut within_votes) = (Vec::new(), Vec::new());
            for point in points {
                let (mut near, mut best) = (Vec::new(), (f32::INFINITY, 0u32));
                truth.within(point.position, distance, |other, squared| {
                    if undirected_cosine(point.tangent, other.tangent) >= cosine {
                        near.push(other.strand);
                        if squared < best.0 {
                            best = (squared, other.strand);
                        }
                    }
                    true
                });
                if !near.is_empty() {
                    near.sort_unstable();
                    near.dedup();
                    within_votes.extend(near);
                    nearest_votes.push(best.1);
                }
            }
            let matched = nearest_votes.len();
            (matched >= 5)
                .then(|| (share(most_votes(nearest_votes), matched), share(most_votes(within_votes), matched)))
        })
        .collect();
    let mean = |f: fn(&(f64, f64)) -> f64| shares.iter().map(f).sum::<f64>() / shares.len().max(1) as f64;
    (mean(|s| s.0), mean(|s| s.1))
}

/// How often the most frequent number occurs.
fn most_votes(mut votes: Vec<u32>) -> usize {
    votes.sort_unstable();
    votes.chunk_by(|a, b| a == b).map(<[u32]>::len).max().unwrap_or(0)
}
