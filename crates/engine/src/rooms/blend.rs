//! Stage 13.

use serde_json::Value;
use strandflow_core::Report;
use strandflow_stages::blend::BlendInput;

use super::{
    ensure, flow, frame_of, need_hull, need_pose, need_scalp, of_stage, refs, smooth::trim::point_count, strand_arrays,
};
use crate::{EngineError, Needs, item::Item, store::Writer, table::Job};

const PHASE: &str = "blend/blend";

pub(crate) fn prepare(job: &Job) -> Result<(), EngineError> {
    let strands = job.take.strand_count()?;
    strand_arrays::ensure_strands(job, PHASE, "blend", point_count(job)?)?;
    ensure(job, PHASE, ("blend/counts", Value::Null), &[job.plan.end, strands], &[1, strands])
}

pub(crate) fn needs(job: &Job, item: Item, needs: &mut Needs) -> Result<(), EngineError> {
    let frame = frame_of(item)?;
    let frames = flow::around(job, frame);
    needs.value("values", "fps", &job.take.manifest().fps);
    needs.value("values", "edge_mm", &job.plan.settings.smooth.edge_mm);
    needs.value("values", "around", &frames);
    need_hull(frame, needs)?;
    need_scalp(needs)?;
    need_pose(job, frames.start..frames.end, needs)?;
    flow::need_fit(job, &["fit/residual_mm"], needs)?;
    (frames.start..frames.end).try_for_each(|t| {
        let arrays = ["voxel", "velocity"].map(|name| format!("flow/{t:06}/{name}"));
        needs.item(&Item::Frame(t).key("flow/flow"), &arrays.each_ref().map(String::as_str))
    })
}

pub(crate) fn run(job: &Job, item: Item, out: &mut Writer, report: &mut Report) -> Result<(), EngineError> {
    let frame = frame_of(item)?;
    let take = job.take;
    let frames = flow::around(job, frame);
    let sequence = take.read_sequence_part("fit", frames, 0..take.strand_count()?)?;
    let fields = (frames.start..frames.end).map(|t| take.read_flow(t)).collect::<Result<Vec<_>, _>>()?;
    let poses = take.read_poses_of(frames)?;
    let input = BlendInput {
        at: frame - frames.start,
        sequence: &sequence,
        fields: &refs(&fields),
        world_from_head: &poses,
        roots: &take.read_scalp()?.roots,
        residual_mm: &take.store().read_all::<f32>("fit/residual_mm")?,
        hull: &take.read_hull(frame)?,
        frame_secs: take.frame_secs(),
        edge_mm: job.plan.settings.smooth.edge_mm,
    };
    let blended = strandflow_stages::blend::blend(&input, job.plan.mode, &job.plan.settings.blend, report)
        .map_err(of_stage("blend"))?;
    strand_arrays::write_sequence(out, "blend", 0, &blended, point_count(job)?)?;
    out.chunk("blend/counts", &[frame, 0], &blended.counts)
}
