//! Stage 11.

use std::ops::Range;

use serde_json::{Value, json};
use strandflow_core::{FrameRange, Report, RigidTransform, StrandSequence};
use strandflow_dynamics::{Params, refine::MOVED};
use strandflow_stages::fit::{BlockFit, FitInput, Stretch, stretches};

use super::{
    block_of, ensure, need_pose, of_stage,
    smooth::trim::point_count,
    strand_arrays::{self, padded},
};
use crate::{
    EngineError, Needs,
    item::{BLOCK_STRANDS, Item},
    store::Writer,
    table::Job,
};

const PHASE: &str = "fit/fit";

pub(crate) fn prepare(job: &Job) -> Result<(), EngineError> {
    let strands = job.take.strand_count()?;
    strand_arrays::ensure_strands(job, PHASE, "fit", point_count(job)?)?;
    ensure(job, PHASE, ("fit/counts", Value::Null), &[strands], &[BLOCK_STRANDS])?;
    let names = Params::NAMES;
    ensure(job, PHASE, ("fit/parameters", json!({ "parameters": names })), &[strands, 9], &[BLOCK_STRANDS, 9])?;
    ensure(job, PHASE, ("fit/residual_mm", Value::Null), &[strands], &[BLOCK_STRANDS])?;
    ensure(job, PHASE, ("fit/windows", Value::Null), &[strands, 3], &[BLOCK_STRANDS, 3])?;
    let logarithms = json!({ "logarithms_of": MOVED });
    ensure(job, PHASE, ("fit/covariance", logarithms), &[strands, 4, 4], &[BLOCK_STRANDS, 4, 4])?;
    ensure(job, PHASE, ("fit/held_out_mm", Value::Null), &[strands, 2], &[BLOCK_STRANDS, 2])
}

pub(crate) fn needs(job: &Job, item: Item, needs: &mut Needs) -> Result<(), EngineError> {
    needs.value("values", "gravity", &job.take.manifest().gravity);
    needs.value("values", "fps", &job.take.manifest().fps);
    needs.value("values", "frames", &job.plan.frames);
    need_pose(job, job.plan.frames.start..job.plan.frames.end, needs)?;
    let arrays = ["smooth/points", "smooth/provenance", "smooth/confidence", "smooth/counts"];
    needs.item(&item.key("smooth/trim"), &arrays)
}

pub(crate) fn run(job: &Job, item: Item, out: &mut Writer, report: &mut Report) -> Result<(), EngineError> {
    let block = block_of(item)?;
    let first = block * BLOCK_STRANDS;
    let strands = first..(first + BLOCK_STRANDS).min(job.take.strand_count()?);
    let (start, points) = (job.plan.frames.start, point_count(job)?);
    let poses = job.take.read_poses_of(job.plan.frames)?;
    let read = |places: &Range<usize>| {
        let frames = FrameRange { start: start + places.start, end: start + places.end };
        job.take.read_sequence_part("smooth", frames, strands.clone())
    };
    let counts: Vec<u16> = job.take.store().read("smooth/counts", std::slice::from_ref(&strands))?;
    let stretches = stretches(poses.len());
    let mut fit = BlockFit::new(first, &counts, job.plan.mode, &job.plan.settings.fit);
    if stretches.len() > 1 {
        for Stretch { own, .. } in &stretches {
            fit.survey(&input_of(job, &read(own)?, &poses[own.clone()])).map_err(of_stage("fit"))?;
        }
    }
    for stretch in &stretches {
        let sequence = read(&stretch.frames)?;
        let settled =
            fit.fit(&input_of(job, &sequence, &poses[stretch.frames.clone()]), stretch).map_err(of_stage("fit"))?;
        strand_arrays::write_sequence(out, "fit", block, &settled, points)?;
    }
    let fitted = fit.finish(report);
    out.chunk("fit/counts", &[block], &padded(&fitted.counts, 1, 0))?;
    // Which strands are given up is known after the last stretch only.
    if (0..counts.len()).any(|n| fitted.counts[n] != counts[n]) {
        for settled in stretches.iter().map(|s| &s.settled).take(stretches.len() - 1) {
            for frame in settled.clone().map(|t| start + t) {
                let frames = FrameRange { start: frame, end: frame + 1 };
                let mut sequence = out.store().read_sequence_part("fit", frames, strands.clone())?;
                sequence.counts.clone_from(&fitted.counts);
                strand_arrays::write_sequence(out, "fit", block, &sequence, points)?;
            }
        }
    }

    out.chunk("fit/parameters", &[block, 0], &padded(fitted.parameters.as_flattened(), 9, f32::NAN))?;
    out.chunk("fit/residual_mm", &[block], &padded(&fitted.residual_mm, 1, f32::NAN))?;
    out.chunk("fit/windows", &[block, 0], &padded(fitted.windows.as_flattened(), 3, 0))?;
    let covariance = fitted.covariance.as_flattened().as_flattened();
    out.chunk("fit/covariance", &[block, 0, 0], &padded(covariance, 16, f32::NAN))?;
    out.chunk("fit/held_out_mm", &[block, 0], &padded(fitted.held_out_mm.as_flattened(), 2, f32::NAN))
}

fn input_of<'a>(job: &Job, sequence: &'a StrandSequence, world_from_head: &'a [RigidTransform]) -> FitInput<'a> {
    FitInput { sequence, world_from_head, gravity: job.take.gravity(), frame_secs: job.take.frame_secs() }
}
