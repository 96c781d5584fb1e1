//! Stage 11.

use serde_json::{Value, json};
use strandflow_core::Report;
use strandflow_dynamics::Params;
use strandflow_stages::fit::FitInput;

use super::{block_of, ensure, need_pose, of_stage, smooth::trim::point_count, strand_arrays};
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
    ensure(job, PHASE, ("fit/windows", Value::Null), &[strands, 3], &[BLOCK_STRANDS, 3])
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
    let frames = job.plan.frames;
    let poses = (frames.start..frames.end).map(|t| job.take.read_pose(t)).collect::<Result<Vec<_>, _>>()?;
    let input = FitInput {
        sequence: &job.take.read_sequence_part("smooth", frames, strands)?,
        world_from_head: &poses,
        gravity: job.take.gravity(),
        frame_secs: job.take.frame_secs(),
        first_strand: first,
    };
    let fitted =
        strandflow_stages::fit::fit(&input, job.plan.mode, &job.plan.settings.fit, report).map_err(of_stage("fit"))?;
    strand_arrays::write_sequence(out, "fit", block, &fitted.sequence, point_count(job)?)?;
    let padded = strand_arrays::padded;
    out.chunk("fit/counts", &[block], &padded(&fitted.sequence.counts, 1, 0))?;
    out.chunk("fit/parameters", &[block, 0], &strand_arrays::padded(fitted.parameters.as_flattened(), 9, f32::NAN))?;
    out.chunk("fit/residual_mm", &[block], &strand_arrays::padded(&fitted.residual_mm, 1, f32::NAN))?;
    out.chunk("fit/windows", &[block, 0], &padded(fitted.windows.as_flattened(), 3, 0))
}
