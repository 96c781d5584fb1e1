//! Stage 1.

use strandflow_core::{Place, Report};
use strandflow_stages::masks::{MasksInput, PreviousFrame};

use super::{images, of_stage, view_frame_of};
use crate::{EngineError, Needs, item::Item, store::Writer, table::Job};

const PHASE: &str = "masks/masks";
const ARRAYS: [&str; 2] = ["masks/subject", "masks/hair"];

pub(crate) fn prepare(job: &Job) -> Result<(), EngineError> {
    images::ensure_images(job, PHASE, &ARRAYS)
}

pub(crate) fn needs(job: &Job, item: Item, needs: &mut Needs) -> Result<(), EngineError> {
    let (view, frame) = view_frame_of(item)?;
    let sources = job.take.sources();
    needs.value("values", "camera", &job.take.rig().cameras[view].name);
    needs.file(sources.plate_file(view))?;
    needs.file(&sources.image_file(view, frame)?)?;
    for given in [sources.hair_file(view, frame), sources.subject_file(view, frame)] {
        needs.value("files", "given", &given.is_some());
        given.map_or(Ok(()), |file| needs.file(&file))?;
    }
    if let Some(key) = key_frame(job, view, frame) {
        needs.file(&sources.image_file(view, key)?)?;
        sources.hair_file(view, key).map_or(Ok(()), |file| needs.file(&file))?;
    }
    if frame > job.plan.lead.start {
        needs.file(&sources.image_file(view, frame - 1)?)?;
        needs.item(&Item::ViewFrame(view, frame - 1).key(PHASE), &ARRAYS)?;
    }
    Ok(())
}

/// The latest frame at or before this one for which the user gave a hair mask.
fn key_frame(job: &Job, view: usize, frame: usize) -> Option<usize> {
    (job.plan.lead.start..=frame).rev().find(|&f| job.take.sources().hair_file(view, f).is_some())
}

pub(crate) fn run(job: &Job, item: Item, out: &mut Writer, report: &mut Report) -> Result<(), EngineError> {
    let (view, frame) = view_frame_of(item)?;
    let take = job.take;
    let image = take.images().image(view, frame)?;
    let plate = take.plate(view)?;
    let (subject, hair) = (take.given_subject(view, frame)?, take.given_hair(view, frame)?);
    let previous = if frame > job.plan.lead.start {
        Some((take.images().image(view, frame - 1)?, take.read_masks(view, frame - 1)?))
    } else {
        None
    };
    let key = match key_frame(job, view, frame) {
        Some(at) => take.given_hair(view, at)?.map(|mask| Ok::<_, EngineError>((take.images().image(view, at)?, mask))),
        None => None,
    }
    .transpose()?;
    let input = MasksInput {
        place: Place::view_frame(&take.rig().cameras[view].name, frame),
        image: &image,
        plate: &plate,
        given_subject: subject.as_ref(),
        given_hair: hair.as_ref(),
        previous: previous.as_ref().map(|(image, masks)| PreviousFrame { image, masks }),
        key: key.as_ref().map(|(image, mask)| (&**image, mask)),
    };
    let masks = strandflow_stages::masks::masks(&input, job.plan.mode, &job.plan.settings.masks, report)
        .map_err(of_stage("masks"))?;
    images::write_image(job, out, ARRAYS[0], (view, frame), &masks.subject)?;
    images::write_image(job, out, ARRAYS[1], (view, frame), &masks.hair)
}
