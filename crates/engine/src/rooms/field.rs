//! Stage 7.

use strandflow_core::Report;
use strandflow_stages::field::FieldInput;

use super::{frame_of, need_hull, need_masks, need_pose, need_rig, need_scalp, of_stage, of_views, refs};
use crate::{EngineError, Needs, item::Item, store::Writer, table::Job};

pub(crate) fn prepare(_: &Job) -> Result<(), EngineError> {
    Ok(())
}

pub(crate) fn needs(job: &Job, item: Item, needs: &mut Needs) -> Result<(), EngineError> {
    let frame = frame_of(item)?;
    need_rig(job, needs);
    need_hull(frame, needs)?;
    need_scalp(needs)?;
    need_pose(job, [frame].into_iter(), needs)?;
    need_masks(job, frame, &["masks/hair"], needs)?;
    let arrays =
        ["voxel", "direction", "confidence", "residual", "views"].map(|name| format!("lift/{frame:06}/{name}"));
    needs.item(&item.key("lift/lift"), &arrays.each_ref().map(String::as_str))
}

pub(crate) fn run(job: &Job, item: Item, out: &mut Writer, report: &mut Report) -> Result<(), EngineError> {
    let frame = frame_of(item)?;
    let (take, rig) = (job.take, job.take.views().rig());
    let hairs = of_views(job, |view| take.read_hair(view, frame))?;
    let input = FieldInput {
        rig,
        frame,
        hull: &take.read_hull(frame)?,
        lines: &take.read_lines(frame)?,
        hairs: &refs(&hairs),
        scalp: &take.read_scalp()?.mesh,
        world_from_head: take.read_pose(frame)?,
    };
    let field = strandflow_stages::field::field(&input, job.plan.mode, &job.plan.settings.field, report)
        .map_err(of_stage("field"))?;
    let count = field.len();
    let array = |name: &str| format!("field/{frame:06}/{name}");
    out.whole(&array("voxel"), &[count], &field.indices)?;
    let directions: Vec<f32> = field.values.iter().flat_map(|v| v.direction.to_array()).collect();
    out.whole(&array("direction"), &[count, 3], &directions)?;
    out.whole(&array("trust"), &[count], &field.values.iter().map(|v| v.trust).collect::<Vec<_>>())?;
    out.whole(&array("observed"), &[count], &field.values.iter().map(|v| u8::from(v.observed)).collect::<Vec<_>>())
}
