//! Strands of the stages against strands that the user drew over several views (`user/sketches` of the take).

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};
use serde::Serialize;
use strandflow_core::{Camera, StrandSequence};
use strandflow_engine::{Take, footage::numbered};
use strandflow_eval::{
    Summary, Table,
    sketches::{CurveDistance, distance_to_strand, drawn_strand, length},
    statistics::variation,
};
use strandflow_geometry::sketch::curve_from_drawings;
use strandflow_io::sketches::read_sketches;

use crate::{failure::Failed, scores::SEQUENCE_STAGES};

/// Where sketches lie in a take: one file a frame, `000012.json`.
pub const SKETCHES: &str = "user/sketches";

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
    /// By stage: the number of the strand that it is, and how far that is; `None` where the frame lacks it.
    pub stages: Vec<(String, usize, Option<CurveDistance>)>,
}

struct Drawn {
    frame: usize,
    views: usize,
    rms_px: f64,
    curve: Vec<DVec3>,
}

/// Scores every drawn strand in every frame and stage that has strands.
pub fn score(take: &Take, only: Option<&str>) -> Result<Vec<SketchScores>, Failed> {
    let drawn = drawn_strands(take)?;
    let stages = SEQUENCE_STAGES.iter().filter(|name| only.is_none_or(|only| only == **name));
    let sequences: Vec<(&str, StrandSequence)> =
        stages.filter_map(|name| Some((*name, take.read_sequence(name).ok()?))).collect();
    if sequences.is_empty() {
        return Ok(Vec::new());
    }
    let mut scores = Vec::new();
    for (id, frames) in drawn {
        let mut of_strand: Vec<SketchScores> = frames.iter().map(|drawn| unscored(id, drawn)).collect();
        // The same strand in all stages, so that they can be compared: chosen in the last.
        if let Some((_, last)) = sequences.last()
            && let Some(n) = strand_of(last, &frames)
        {
            for (stage, sequence) in &sequences {
                score_stage(stage, sequence, n, &frames, &mut of_strand);
            }
        }
        scores.extend(of_strand);
    }
    Ok(scores)
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

/// The drawn strands in space, by number, in the order of frames.
fn drawn_strands(take: &Take) -> Result<BTreeMap<u32, Vec<Drawn>>, Failed> {
    let folder = take.root().join(SKETCHES);
    let files = numbered(&folder, |path| path.extension().is_some_and(|extension| extension == "json"))?;
    if files.is_empty() {
        let hint =
            "draw strands over two or more views of a frame, and save them as user/sketches/000012.json of the take";
        return Err(Failed::input(format!("{}: there are no sketches", folder.display()), hint));
    }
    let rig = take.rig();
    let mut drawn: BTreeMap<u32, Vec<Drawn>> = BTreeMap::new();
    for (frame, file) in files {
        for strand in read_sketches(&file)? {
            let mut views: Vec<(&Camera, Vec<DVec2>)> = Vec::new();
            for (view, points) in &strand.views {
                let Some(at) = rig.view_named(view) else {
                    let fact =
                        format!("{}: strand {} is drawn in `{view}`, which is no view", file.display(), strand.id);
                    return Err(Failed::input(fact, "views are named as in the take's manifest"));
                };
                views.push((&rig.cameras[at], points.iter().map(|&point| DVec2::from(point)).collect()));
            }
            let views: Vec<(&Camera, &[DVec2])> =
                views.iter().map(|(camera, points)| (*camera, points.as_slice())).collect();
            match curve_from_drawings(&views) {
                Some(found) => {
                    let one = Drawn { frame, views: views.len(), rms_px: found.rms_px, curve: found.points };
                    drawn.entry(strand.id).or_default().push(one);
                }
                None => eprintln!(
                    "note: {}: strand {} is left out: it needs drawings in two views that look from different sides",
                    file.display(),
                    strand.id
                ),
            }
        }
    }
    Ok(drawn)
}

/// One row a drawn strand and frame, then one a stage.
pub fn tables(scores: &[SketchScores]) -> Vec<Table> {
    let names: Vec<&str> = SEQUENCE_STAGES
        .into_iter()
        .filter(|name| scores.iter().any(|s| s.stages.iter().any(|(of, ..)| of == name)))
        .collect();
    let mut header =
        vec!["sketch".to_owned(), "frame".into(), "views".into(), "drawings, px".into(), "length, mm".into()];
    header.extend(
        names.iter().flat_map(|name| [format!("{name} strand"), "off, mm".into(), "worst".into(), "length".into()]),
    );
    let mut each = Table::new(&header.iter().map(String::as_str).collect::<Vec<_>>());
    for score in scores {
        let mut cells = vec![score.frame.to_string(), score.views.to_string()];
        cells.extend([format!("{:.2}", score.rms_px), format!("{:.1}", score.length_mm)]);
        for name in &names {
            let found = score.stages.iter().find(|(of, ..)| of == name);
            cells.push(found.map_or("-".into(), |(_, n, _)| n.to_string()));
            let numbers = found.and_then(|(_, _, distance)| *distance);
            let of =
                |value: fn(&CurveDistance) -> f64| numbers.as_ref().map_or("-".into(), |d| format!("{:.1}", value(d)));
            cells.extend([of(|d| d.mean_mm), of(|d| d.worst_mm), of(|d| d.strand_mm)]);
        }
        each.row(score.id.to_string(), cells);
    }
    let mut means = Table::new(&[
        "stage",
        "strands and frames",
        "off, mm",
        "worst, mm",
        "length over drawn, %",
        "length varies, %",
    ]);
    for name in &names {
        let found: Vec<(&SketchScores, CurveDistance)> = scores
            .iter()
            .filter_map(|score| {
                let (_, _, distance) = score.stages.iter().find(|(of, ..)| of == name)?;
                Some((score, (*distance)?))
            })
            .collect();
        if found.is_empty() {
            continue;
        }
        let off = Summary::of(found.iter().map(|(_, d)| d.mean_mm)).mean;
        let worst = found.iter().map(|(_, d)| d.worst_mm).fold(0.0, f64::max);
        let ratio = Summary::of(found.iter().map(|(score, d)| 100.0 * (d.strand_mm / score.length_mm - 1.0))).mean;
        let numbers = [off, worst, ratio].map(|number| format!("{number:.2}"));
        let varies = length_variation(&found).map_or("-".into(), |percent| format!("{percent:.2}"));
        means.row(*name, [found.len().to_string()].into_iter().chain(numbers).chain([varies]));
    }
    vec![each, means]
}

/// Mean over strands of the variation of the length over time, in percent; `None` where no strand was drawn in three frames.
fn length_variation(found: &[(&SketchScores, CurveDistance)]) -> Option<f64> {
    let mut by_strand: BTreeMap<u32, Vec<f64>> = BTreeMap::new();
    for (score, distance) in found {
        by_strand.entry(score.id).or_default().push(distance.strand_mm);
    }
    let each = Summary::of(by_strand.values().filter_map(|lengths| variation(lengths)));
    (each.count > 0).then_some(100.0 * each.mean)
}
