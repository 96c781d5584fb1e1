//! Stage 5.

use strandflow_core::{Place, Report};

use super::{images, of_stage, view_frame_of};
use crate::{EngineError, Needs, item::Item, read::ANGLE_STEPS, store::Writer, table::Job};

const PHASE: &str = "orient/orient";
const ARRAYS: [&str; 2] = ["orient/angle", "orient/confidence"];

pub(crate) fn prepare(job: &Job) -> Result<(), EngineError> {
    images::ensure_images(job, PHASE, &ARRAYS)
}

pub(crate) fn needs(job: &Job, item: Item, needs: &mut Needs) -> Result<(), EngineError> {
    let (view, frame) = view_frame_of(item)?;
    needs.file(&job.take.sources().image_file(view, frame)?)?;
    needs.item(&item.key("masks/masks"), &["masks/subject", "masks/hair"])
}

pub(crate) fn run(job: &Job, item: Item, out: &mut Writer, report: &mut Report) -> Result<(), EngineError> {
    let (view, frame) = view_frame_of(item)?;
    let place = Place::view_frame(&job.take.rig().cameras[view].name, frame);
    let image = job.take.images().image(view, frame)?;
    let masks = job.take.read_masks(view, frame)?;
    let (mode, settings) = (job.plan.mode, &job.plan.settings.orient);
    let map = strandflow_stages::orient::orient(&place, &image, &masks.hair, &masks.subject, mode, settings, report)
        .map_err(of_stage("orient"))?;
    // An angle just below π rounds to π, which is 0 for an undirected line: the wrap to u16 is the right one.
    let steps = map.angle.map(|&a| ((a / std::f32::consts::PI * ANGLE_STEPS).round() as i64).rem_euclid(65536) as u16);
    images::write_image(job, out, ARRAYS[0], (view, frame), &steps)?;
    let trust = map.confidence.map(|&c| (c.clamp(0.0, 1.0) * 255.0).round() as u8);
    images::write_image(job, out, ARRAYS[1], (view, frame), &trust)
}
