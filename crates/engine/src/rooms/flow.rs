//! Stage 12.

use glam::Vec3;
use strandflow_core::{FrameRange, Report};
use strandflow_stages::flow::FlowInput;

use super::{frame_of, need_hull, of_stage};
use crate::{EngineError, Needs, item::Item, store::Writer, table::Job};

pub(crate) fn prepare(_: &Job) -> Result<(), EngineError> {
    Ok(())
}

/// The fitted strands of all blocks, and more of what `fit` found of them.
pub(crate) fn need_fit(job: &Job, more: &[&str], needs: &mut Needs) -> Result<(), EngineError> {
    let arrays = [&["fit/points", "fit/provenance", "fit/confidence", "fit/counts"], more].concat();
    (0..job.take.block_count()?).try_for_each(|block| needs.item(&Item::Block(block).key("fit/fit"), &arrays))
}

/// The frame before, the frame, the frame after, as far as they are asked for.
pub(crate) fn around(job: &Job, frame: usize) -> FrameRange {
    let all = job.plan.frames;
    FrameRange { start: frame.saturating_sub(1).max(all.start), end: (frame + 2).min(all.end) }
}

pub(crate) fn needs(job: &Job, item: Item, needs: &mut Needs) -> Result<(), EngineError> {
    let frame = frame_of(item)?;
    needs.value("values", "fps", &job.take.manifest().fps);
    needs.value("values", "around", &around(job, frame));
    need_hull(frame, needs)?;
    need_fit(job, &[], needs)
}

pub(crate) fn run(job: &Job, item: Item, out: &mut Writer, report: &mut Report) -> Result<(), EngineError> {
    let frame = frame_of(item)?;
    let range = around(job, frame);
    let sequence = job.take.read_sequence_part("fit", range, 0..job.take.strand_count()?)?;
    let size = sequence.strand_count * sequence.point_count;
    let points = |t: usize| &sequence.points[(t - range.start) * size..(t - range.start + 1) * size];
    let hull = job.take.read_hull(frame)?;
    let input = FlowInput {
        frame,
        grid: hull.grid,
        hull: &hull,
        points: [points(range.start), points(frame), points(range.end - 1)],
        point_count: sequence.point_count,
        span_secs: (range.len() - 1).max(1) as f64 * job.take.frame_secs(),
    };
    let flow = strandflow_stages::flow::flow(&input, job.plan.mode, &job.plan.settings.flow, report)
        .map_err(of_stage("flow"))?;
    let velocities: Vec<f32> = flow.values.iter().flat_map(|v: &Vec3| v.to_array()).collect();
    out.whole(&format!("flow/{frame:06}/voxel"), &[flow.len()], &flow.indices)?;
    out.whole(&format!("flow/{frame:06}/velocity"), &[flow.len(), 3], &velocities)
}
