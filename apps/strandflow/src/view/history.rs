//! One strand over all frames.

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use strandflow_core::Provenance;
use strandflow_dynamics::Params;
use strandflow_eval::lengths::present_length;
use strandflow_view::{Refusal, describe::StrandHistory};

use super::{
    along::places,
    attributes::velocity,
    parts::{Part, rows},
    sets::{Kind, Set, of_set},
    viewer::Viewer,
};

/// Points of a strand that are compared with the truth: the mean over them is that over the strand to a few hundredths.
const POINTS_FOR_ERROR: usize = 16;

/// A strand, read from every frame that is there: one block a frame.
///
/// # Errors
/// There is no such strand; a frame cannot be read.
pub fn of(viewer: &Viewer, set: &Set, index: usize) -> Result<StrandHistory, Refusal> {
    if index >= set.strands {
        let fact = format!("set {} has no strand {index}", set.id);
        return Err(Refusal::missing(fact, format!("strands are numbered from 0 on; there are {}", set.strands)));
    }
    let source = viewer.source();
    let frames = set.done(source);
    let read = |frame: &usize| -> Result<Part, Refusal> {
        match (&set.kind, source.truth()) {
            (Kind::Truth, Some(truth)) => Ok(one_of(&truth.part(*frame)?, index)),
            _ => rows(&source.store()?, set, *frame, index..index + 1),
        }
    };
    let parts: Vec<Part> = frames.par_iter().map(read).collect::<Result<_, _>>()?;
    let mut history = StrandHistory { frames, ..StrandHistory::default() };
    history.points = parts.iter().map(|part| part.points.iter().filter(|p| p.is_finite()).count()).max().unwrap_or(0);
    history.length_mm = parts.iter().map(|part| present_length(&part.points)).collect();
    let world = |_: usize, p: Vec3| Some(p.as_dvec3());
    history.speed_mm_s = speeds(viewer, &history.frames, &parts, world);
    let heads: Vec<_> = history.frames.iter().map(|frame| set.head_from_world(source, *frame)).collect();
    if heads.iter().any(Option::is_some) {
        let in_head = |t: usize, p: Vec3| Some(heads[t]?.point(p.as_dvec3()));
        history.relative_speed_mm_s = Some(speeds(viewer, &history.frames, &parts, in_head));
    }
    if let Some(truth) = source.truth().filter(|_| matches!(set.kind, Kind::Frames | Kind::Blocks)) {
        let error = |(frame, part): (&usize, &Part)| {
            let Some(places) = places(&part.points, POINTS_FOR_ERROR) else { return Ok(None) };
            let points: Vec<Vec3> = places.iter().map(|place| place.point(&part.points)).collect();
            truth.mean_distance(*frame, &points)
        };
        let errors = history.frames.par_iter().zip(&parts).map(error).collect::<Result<Vec<_>, Refusal>>()?;
        history.error_mm = Some(errors);
    }
    summarise(&parts, &mut history);
    fitted(viewer, set, index, &mut history)?;
    Ok(history)
}

/// One strand of a part.
fn one_of(part: &Part, index: usize) -> Part {
    let range = part.range(index);
    Part {
        first: index,
        width: part.width,
        points: part.points[range.clone()].to_vec(),
        provenance: part.provenance[range.clone()].to_vec(),
        confidence: part.confidence[range].to_vec(),
    }
}

/// Mean speed of the points in each frame \[mm/s\]; `place` brings the points of the `t`-th frame into the space of the speed.
fn speeds(
    viewer: &Viewer,
    frames: &[usize],
    parts: &[Part],
    place: impl Fn(usize, Vec3) -> Option<DVec3>,
) -> Vec<Option<f64>> {
    let fps = viewer.source().manifest().fps;
    let at = |t: Option<usize>, frame: Option<usize>, k: usize| {
        let t = t.filter(|t| frame.is_some() && frames.get(*t).copied() == frame)?;
        place(t, *parts[t].points.get(k).filter(|p| p.is_finite())?)
    };
    let mean = |t: usize| {
        let frame = frames[t];
        let one = |k: usize| {
            let points = [
                at(t.checked_sub(1), frame.checked_sub(1), k),
                at(Some(t), Some(frame), k),
                at(Some(t + 1), frame.checked_add(1), k),
            ];
            velocity(points, fps).map(|v| v.length())
        };
        let speeds: Vec<f64> = (0..parts[t].points.len()).filter_map(one).collect();
        (!speeds.is_empty()).then(|| speeds.iter().sum::<f64>() / speeds.len() as f64)
    };
    (0..frames.len()).map(mean).collect()
}

/// Provenance and confidence over all frames.
fn summarise(parts: &[Part], history: &mut StrandHistory) {
    let (mut counts, mut trust) = ([0usize; 5], 0.0);
    for part in parts {
        for (i, _) in part.points.iter().enumerate().filter(|(_, p)| p.is_finite()) {
            counts[Provenance::from_number(part.provenance[i]) as usize] += 1;
            trust += f64::from(part.confidence[i]) / 255.0;
        }
    }
    let all: usize = counts.iter().sum();
    if all == 0 {
        return;
    }
    history.confidence = Some(trust / all as f64);
    let names = ["observed", "diffused", "simulated", "completed"];
    history.provenance = (1..).zip(names).map(|(i, name)| (name, counts[i] as f64 / all as f64)).collect();
}

/// What stage `fit` found for the strand.
fn fitted(viewer: &Viewer, set: &Set, index: usize, history: &mut StrandHistory) -> Result<(), Refusal> {
    if !set.is_fitted() {
        return Ok(());
    }
    let store = viewer.source().store()?;
    if store.shape("fit/parameters").is_err() {
        return Ok(());
    }
    let row: Vec<f32> = store.read("fit/parameters", &[index..index + 1, 0..9]).map_err(of_set(set))?;
    if row.iter().all(|value| value.is_finite()) {
        history.parameters = Some(Params::NAMES.into_iter().zip(row.iter().map(|v| f64::from(*v))).collect());
    }
    let strand = index..index + 1;
    let residual: Vec<f32> = store.read("fit/residual_mm", std::slice::from_ref(&strand)).map_err(of_set(set))?;
    history.residual_mm = residual.first().map(|v| f64::from(*v)).filter(|v| v.is_finite());
    Ok(())
}
