//! Stage 9.

use serde_json::Value;
use strandflow_core::Report;
use strandflow_stages::prune::PruneInput;

use super::{ensure, frame_of, lift, need_hull, need_rig, of_stage, refs, strand_arrays};
use crate::{EngineError, Needs, item::Item, store::Writer, table::Job};

const PHASE: &str = "prune/prune";

pub(crate) fn prepare(job: &Job) -> Result<(), EngineError> {
    strand_arrays::ensure_strands(job, PHASE, "prune", job.plan.settings.grow.max_points())?;
    let strands = job.take.strand_count()?;
    ensure(job, PHASE, ("prune/flags", Value::Null), &[job.plan.end, strands], &[1, strands])
}

pub(crate) fn needs(job: &Job, item: Item, needs: &mut Needs) -> Result<(), EngineError> {
    let frame = frame_of(item)?;
    need_rig(job, needs);
    need_hull(frame, needs)?;
    lift::need_maps(job, frame, needs)?;
    needs.item(&item.key("grow/grow"), &["grow/points", "grow/provenance", "grow/confidence"])
}

pub(crate) fn run(job: &Job, item: Item, out: &mut Writer, report: &mut Report) -> Result<(), EngineError> {
    let frame = frame_of(item)?;
    let maps = lift::read_maps(job, frame)?;
    let input = PruneInput {
        rig: job.take.views().rig(),
        frame,
        hull: &job.take.read_hull(frame)?,
        strands: &job.take.read_strands("grow", frame)?,
        maps: &refs(&maps),
    };
    let pruned = strandflow_stages::prune::prune(&input, job.plan.mode, &job.plan.settings.prune, report)
        .map_err(of_stage("prune"))?;
    strand_arrays::write_strands(out, "prune", frame, &pruned.strands, job.plan.settings.grow.max_points())?;
    out.chunk("prune/flags", &[frame, 0], &pruned.flags)
}
