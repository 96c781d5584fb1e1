//! Strands of the stages against drawn strands: of the user over several views, or of a truth as a person would draw it.

use glam::DVec3;
use serde::Serialize;
use strandflow_core::StrandSequence;
use strandflow_engine::Take;
use strandflow_eval::{
    Truth,
    sketches::{CurveDistance, distance_to_strand, drawn_strand, length},
};

use crate::{
    scores::SEQUENCE_STAGES,
    sketch_drawings::Drawings,
    sketch_lengths::{self, LengthsOverTime},
};

/// What the true strand is called beside the stages: how far it is from its own drawings is the error of judging by them.
pub const TRUTH: &str = "truth";

/// All that drawn strands are compared with, in the order of the tables.
pub const COMPARED: [&str; 4] = [TRUTH, SEQUENCE_STAGES[0], SEQUENCE_STAGES[1], SEQUENCE_STAGES[2]];

/// A drawn strand in one frame.
#[derive(Debug, Serialize)]
pub struct SketchScores {
    /// Its number in the sketches.
    pub id: u32,
    /// The frame.
    pub frame: usize,
    /// Views it was drawn in.
    pub views: usize,
    /// Distance of its curve in space to the drawings \[px\].
    pub rms_px: f64,
    /// Its length \[mm\].
    pub length_mm: f64,
    /// By stage, and `truth` where it was drawn of one: the number of the strand that it is, and how far that is; `None` where
    /// the frame lacks it.
    pub stages: Vec<(String, usize, Option<CurveDistance>)>,
}

/// A drawn strand in space, in one frame.
pub struct Drawn {
    /// The frame.
    pub frame: usize,
    /// Views it was drawn in.
    pub views: usize,
    /// Distance of the curve to the drawings \[px\].
    pub rms_px: f64,
    /// The curve \[mm\].
    pub curve: Vec<DVec3>,
}

/// The strand of a stage that a drawn strand is, and how far.
pub fn match_of(score: &SketchScores, stage: &str) -> Option<(usize, Option<CurveDistance>)> {
    score.stages.iter().find(|(of, ..)| of == stage).map(|(_, n, distance)| (*n, *distance))
}

/// Scores every drawn strand in every frame and stage that has strands, and follows the longest over time. `truth`: what the
/// strands were drawn of, numbered as there.
pub fn score(
    take: &Take,
    only: Option<&str>,
    drawn: &Drawings,
    truth: Option<&Truth>,
) -> (Vec<SketchScores>, Option<LengthsOverTime>) {
    let stages = SEQUENCE_STAGES.iter().filter(|name| only.is_none_or(|only| only == **name));
    let sequences: Vec<(&str, StrandSequence)> =
        stages.filter_map(|name| Some((*name, take.read_sequence(name).ok()?))).collect();
    // The same strand in all stages, so that they can be compared: chosen in the last.
    let Some((_, last)) = sequences.last() else { return (Vec::new(), None) };
    let mut scores = Vec::new();
    for (&id, frames) in drawn {
        let mut of_strand: Vec<SketchScores> = frames.iter().map(|drawn| unscored(id, drawn)).collect();
        if let Some(truth) = truth {
            score_truth(truth, id as usize, frames, &mut of_strand);
        }
        if let Some(n) = strand_of(last, frames) {
            for (stage, sequence) in &sequences {
                score_stage(stage, sequence, n, frames, &mut of_strand);
            }
        }
        scores.extend(of_strand);
    }
    let longest = sketch_lengths::of_longest(&scores, &sequences, truth);
    (scores, longest)
}

fn score_truth(truth: &Truth, n: usize, frames: &[Drawn], scores: &mut [SketchScores]) {
    for (drawn, score) in frames.iter().zip(scores) {
        if let Some(t) = truth.at(drawn.frame as u32) {
            score.stages.push((TRUTH.to_owned(), n, distance_to_strand(&drawn.curve, truth.strand(t, n))));
        }
    }
}

fn unscored(id: u32, drawn: &Drawn) -> SketchScores {
    let length_mm = length(&drawn.curve);
    SketchScores { id, frame: drawn.frame, views: drawn.views, rms_px: drawn.rms_px, length_mm, stages: Vec::new() }
}

/// The frames of a sequence that have a drawing: index of the drawing, index of the frame.
fn drawn_frames<'a>(sequence: &'a StrandSequence, frames: &'a [Drawn]) -> impl Iterator<Item = (usize, usize)> + 'a {
    let at = |frame: usize| sequence.frames.iter().position(|&f| f as usize == frame);
    frames.iter().enumerate().filter_map(move |(i, drawn)| Some((i, at(drawn.frame)?)))
}

/// The strand that was drawn.
fn strand_of(sequence: &StrandSequence, frames: &[Drawn]) -> Option<usize> {
    let known: Vec<(usize, usize)> = drawn_frames(sequence, frames).collect();
    // Every fourth point tells strands apart as well, in a quarter of the time.
    let thinned = |curve: &[DVec3]| -> Vec<DVec3> { curve.iter().step_by(4).chain(curve.last()).copied().collect() };
    let curves: Vec<Vec<DVec3>> = known.iter().map(|&(i, _)| thinned(&frames[i].curve)).collect();
    drawn_strand(&curves, sequence.strand_count, |k, n| sequence.strand(known[k].1, n))
}

fn score_stage(stage: &str, sequence: &StrandSequence, n: usize, frames: &[Drawn], scores: &mut [SketchScores]) {
    if n >= sequence.strand_count {
        return;
    }
    for (i, t) in drawn_frames(sequence, frames) {
        let distance = distance_to_strand(&frames[i].curve, sequence.strand(t, n));
        scores[i].stages.push((stage.to_owned(), n, distance));
    }
}
