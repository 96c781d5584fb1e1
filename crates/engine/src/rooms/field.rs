//! Stage 7.

use std::sync::{Arc, Mutex, PoisonError};

use strandflow_core::{Report, TriMesh};
use strandflow_geometry::signed_distance::SignedDistance;
use strandflow_stages::field::{FieldInput, head_distance};

use super::{frame_of, need_hull, need_masks, need_pose, need_rig, need_scalp, of_stage, of_views, refs};
use crate::{EngineError, Needs, Take, item::Item, store::Writer, table::Job};

/// The distance to the scalp, which is that of all frames: sampled once.
#[derive(Default)]
pub(crate) struct HeadShape(Mutex<Option<Sampled>>);

/// A scalp, the edge of the grid's voxels \[mm\], and the distance that was sampled for them.
type Sampled = (TriMesh, f64, Arc<SignedDistance>);

impl HeadShape {
    fn of(&self, take: &Take) -> Result<Arc<SignedDistance>, EngineError> {
        let (scalp, voxel_mm) = (take.read_scalp()?.mesh, take.read_grid()?.voxel_mm);
        let kept = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((.., distance)) = kept().as_ref().filter(|kept| kept.0 == scalp && kept.1 == voxel_mm) {
            return Ok(distance.clone());
        }
        // Not under the lock: while the samples are taken this thread may be given another frame, which would wait for it.
        let distance = Arc::new(head_distance(&scalp, voxel_mm));
        *kept() = Some((scalp, voxel_mm, distance.clone()));
        Ok(distance)
    }
}

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
        head: &*take.head_shape().of(take)?,
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

/// The second phase: how the hair moved since the frame before.
pub mod motion {
    use strandflow_core::Report;
    use strandflow_stages::field::motion::{MotionInput, motion};

    use super::super::{frame_of, lift, need_grid, need_masks, need_pose, need_rig, need_scalp, of_views, refs};
    use crate::{EngineError, Needs, item::Item, store::Writer, table::Job};

    pub(crate) fn prepare(_: &Job) -> Result<(), EngineError> {
        Ok(())
    }

    /// The frame before, if the take has one.
    fn before(job: &Job, frame: usize) -> Option<usize> {
        (frame > job.plan.lead.start).then(|| frame - 1)
    }

    pub(crate) fn needs(job: &Job, item: Item, needs: &mut Needs) -> Result<(), EngineError> {
        let frame = frame_of(item)?;
        need_rig(job, needs);
        need_grid(needs)?;
        need_scalp(needs)?;
        lift::need_maps(job, frame, needs)?;
        needs.item(
            &item.key("field/field"),
            &[&format!("field/{frame:06}/voxel"), &format!("field/{frame:06}/direction")],
        )?;
        let frames = before(job, frame).into_iter().chain([frame]);
        need_pose(job, frames.clone(), needs)?;
        for frame in frames {
            need_masks(job, frame, &["masks/hair"], needs)?;
            for &view in job.take.views().taking_part() {
                needs.file(&job.take.sources().image_file(view, frame)?)?;
            }
        }
        Ok(())
    }

    pub(crate) fn run(job: &Job, item: Item, out: &mut Writer, _: &mut Report) -> Result<(), EngineError> {
        let frame = frame_of(item)?;
        let take = job.take;
        let field = take.read_field(frame)?;
        let array = format!("field/{frame:06}/motion");
        let Some(before) = before(job, frame) else {
            return out.whole(&array, &[field.len(), 3], &vec![0.0f32; 3 * field.len()]);
        };
        let images = |frame: usize| of_views(job, |view| Ok(take.images().image(view, frame)?));
        let hairs = |frame: usize| of_views(job, |view| take.read_hair(view, frame));
        let (images_now, images_before) = (images(frame)?, images(before)?);
        let (hairs_now, hairs_before) = (hairs(frame)?, hairs(before)?);
        let maps = lift::read_maps(job, frame)?;
        let input = MotionInput {
            rig: take.views().rig(),
            field: &field,
            maps: &refs(&maps),
            images: &images_now.iter().map(|image| &**image).collect::<Vec<_>>(),
            images_before: &images_before.iter().map(|image| &**image).collect::<Vec<_>>(),
            hairs: &refs(&hairs_now),
            hairs_before: &refs(&hairs_before),
            roots: &take.read_scalp()?.roots,
            world_from_head: take.read_pose(frame)?,
            world_from_head_before: take.read_pose(before)?,
        };
        let moved = motion(&input, &job.plan.settings.field);
        let samples: Vec<f32> = moved.values.iter().flat_map(|v| v.to_array()).collect();
        out.whole(&array, &[moved.len(), 3], &samples)
    }
}
