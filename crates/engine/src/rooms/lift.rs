//! Stage 6.

use strandflow_core::Report;
use strandflow_stages::{lift::LiftInput, orient::OrientationMap};

use super::{frame_of, need_hull, need_masks, need_rig, of_stage, of_views, refs};
use crate::{EngineError, Needs, item::Item, store::Writer, table::Job};

pub(crate) fn prepare(_: &Job) -> Result<(), EngineError> {
    Ok(())
}

/// The orientation maps of a frame, of all views that take part.
pub(crate) fn need_maps(job: &Job, frame: usize, needs: &mut Needs) -> Result<(), EngineError> {
    job.take.views().taking_part().iter().try_for_each(|&view| {
        needs.item(&Item::ViewFrame(view, frame).key("orient/orient"), &["orient/angle", "orient/confidence"])
    })
}

pub(crate) fn read_maps(job: &Job, frame: usize) -> Result<Vec<OrientationMap>, EngineError> {
    of_views(job, |view| job.take.read_orientation(view, frame))
}

pub(crate) fn needs(job: &Job, item: Item, needs: &mut Needs) -> Result<(), EngineError> {
    let frame = frame_of(item)?;
    need_rig(job, needs);
    need_hull(frame, needs)?;
    need_maps(job, frame, needs)?;
    need_masks(job, frame, &["masks/hair"], needs)
}

pub(crate) fn run(job: &Job, item: Item, out: &mut Writer, report: &mut Report) -> Result<(), EngineError> {
    let frame = frame_of(item)?;
    let rig = job.take.views().rig();
    let hull = job.take.read_hull(frame)?;
    let maps = read_maps(job, frame)?;
    let hairs = of_views(job, |view| job.take.read_hair(view, frame))?;
    let input = LiftInput { rig, frame, hull: &hull, maps: &refs(&maps), hairs: &refs(&hairs) };
    let lines = strandflow_stages::lift::lift(&input, job.plan.mode, &job.plan.settings.lift, report)
        .map_err(of_stage("lift"))?;
    let count = lines.len();
    let array = |name: &str| format!("lift/{frame:06}/{name}");
    out.whole(&array("voxel"), &[count], &lines.indices)?;
    let directions: Vec<f32> = lines.values.iter().flat_map(|line| line.direction.to_array()).collect();
    out.whole(&array("direction"), &[count, 3], &directions)?;
    out.whole(&array("confidence"), &[count], &lines.values.iter().map(|l| l.confidence).collect::<Vec<_>>())?;
    out.whole(&array("residual"), &[count], &lines.values.iter().map(|l| l.residual).collect::<Vec<_>>())?;
    out.whole(&array("views"), &[count], &lines.values.iter().map(|l| l.views).collect::<Vec<_>>())
}
