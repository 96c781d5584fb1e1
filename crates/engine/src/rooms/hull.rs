//! Stage 2.

use serde_json::json;
use strandflow_core::Report;

use super::{ensure, frame_of, need_grid, need_masks, need_rig, of_stage, of_views, refs};
use crate::{EngineError, Needs, item::Item, store::Writer, table::Job};

/// Phase 1: the take's grid.
pub mod grid {
    use strandflow_core::{Mask, Report};

    use super::{super::of_stage, need_masks, need_rig, of_views};
    use crate::{EngineError, Needs, item::Item, store::Writer, table::Job};

    pub(crate) fn prepare(_: &Job) -> Result<(), EngineError> {
        Ok(())
    }

    pub(crate) fn needs(job: &Job, _: Item, needs: &mut Needs) -> Result<(), EngineError> {
        need_rig(job, needs);
        let frames = job.plan.lead;
        (frames.start..frames.end).try_for_each(|frame| need_masks(job, frame, &["masks/subject"], needs))
    }

    pub(crate) fn run(job: &Job, _: Item, out: &mut Writer, report: &mut Report) -> Result<(), EngineError> {
        let rig = job.take.views().rig();
        let unions = of_views(job, |view| union(job, view))?;
        let grid = strandflow_stages::hull::grid_of_take(rig, &unions, &job.plan.settings.hull, report)
            .map_err(of_stage("hull"))?;
        out.whole("hull/grid/origin", &[3], &grid.origin.to_array())?;
        out.whole("hull/grid/voxel_mm", &[1], &[grid.voxel_mm])?;
        out.whole("hull/grid/dims", &[3], &grid.dims.map(|n| n as u32))
    }

    /// Everything that the subject covers in a view in any frame.
    fn union(job: &Job, view: usize) -> Result<Mask, EngineError> {
        let frames = job.plan.lead;
        let mut union = job.take.read_subject(view, frames.start)?;
        for frame in frames.start + 1..frames.end {
            let mask = job.take.read_subject(view, frame)?;
            union.data.iter_mut().zip(&mask.data).for_each(|(all, &one)| *all = one.max(*all));
        }
        Ok(union)
    }
}

const PHASE: &str = "hull/hull";
const OCCUPANCY: &str = "hull/occupancy";

pub(crate) fn prepare(job: &Job) -> Result<(), EngineError> {
    let grid = job.take.read_grid()?;
    let [nx, ny, nz] = grid.dims;
    let more = json!({ "origin_mm": grid.origin.to_array(), "voxel_mm": grid.voxel_mm });
    ensure(job, PHASE, (OCCUPANCY, more), &[job.plan.end, nz, ny, nx], &[1, nz, ny, nx])
}

pub(crate) fn needs(job: &Job, item: Item, needs: &mut Needs) -> Result<(), EngineError> {
    need_rig(job, needs);
    need_grid(needs)?;
    need_masks(job, frame_of(item)?, &["masks/subject"], needs)
}

pub(crate) fn run(job: &Job, item: Item, out: &mut Writer, report: &mut Report) -> Result<(), EngineError> {
    let frame = frame_of(item)?;
    let (take, rig) = (job.take, job.take.views().rig());
    let subjects = of_views(job, |view| take.read_subject(view, frame))?;
    let grid = take.read_grid()?;
    let hull = strandflow_stages::hull::hull(rig, &refs(&subjects), &grid, frame, &job.plan.settings.hull, report)
        .map_err(of_stage("hull"))?;
    let samples: Vec<u8> = (0..grid.len()).map(|i| u8::from(hull.get(i))).collect();
    out.chunk(OCCUPANCY, &[frame, 0, 0, 0], &samples)
}
