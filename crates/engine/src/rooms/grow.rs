//! Stage 8.

use strandflow_core::Report;
use strandflow_stages::grow::GrowInput;

use super::{frame_of, need_pose, need_scalp, of_stage, strand_arrays};
use crate::{EngineError, Needs, item::Item, store::Writer, table::Job};

pub(crate) fn prepare(job: &Job) -> Result<(), EngineError> {
    strand_arrays::ensure_strands(job, "grow/grow", "grow", job.plan.settings.grow.max_points())
}

pub(crate) fn needs(job: &Job, item: Item, needs: &mut Needs) -> Result<(), EngineError> {
    let frame = frame_of(item)?;
    super::need_grid(needs)?;
    need_scalp(needs)?;
    need_pose(job, [frame].into_iter(), needs)?;
    needs.value("values", "gravity", &job.take.manifest().gravity);
    let arrays = ["voxel", "direction", "trust", "observed"].map(|name| format!("field/{frame:06}/{name}"));
    needs.item(&item.key("field/field"), &arrays.each_ref().map(String::as_str))
}

pub(crate) fn run(job: &Job, item: Item, out: &mut Writer, report: &mut Report) -> Result<(), EngineError> {
    let frame = frame_of(item)?;
    let (take, settings) = (job.take, &job.plan.settings.grow);
    let scalp = take.read_scalp()?;
    let input = GrowInput {
        frame,
        field: &take.read_field(frame)?,
        roots: &scalp.roots,
        normals: &scalp.normals,
        world_from_head: take.read_pose(frame)?,
        gravity: take.gravity(),
    };
    let strands = strandflow_stages::grow::grow(&input, job.plan.mode, settings, report).map_err(of_stage("grow"))?;
    strand_arrays::write_strands(out, "grow", frame, &strands, settings.max_points())
}
