//! Stage 1.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, PoisonError},
};

use strandflow_core::{Place, Report};
use strandflow_stages::{
    Mode,
    hair_look::{HairLook, KeyView},
    masks::{MasksInput, MasksSettings, PreviousFrame},
};

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
    for (view, key) in key_views(job, view, frame) {
        needs.file(sources.plate_file(view))?;
        needs.file(&sources.image_file(view, key)?)?;
        for given in [sources.hair_file(view, key), sources.subject_file(view, key)] {
            given.map_or(Ok(()), |file| needs.file(&file))?;
        }
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

/// The views whose key frames teach the look of hair in a view, with those frames: the latest of the view itself first, then
/// the first of all others that take part. Later key frames of another view are corrections, and repeat nothing here.
/// Nothing where the view has no key frame yet.
fn key_views(job: &Job, view: usize, frame: usize) -> Vec<(usize, usize)> {
    let Some(own) = key_frame(job, view, frame) else { return Vec::new() };
    let others = job.take.views().taking_part().iter().copied().filter(|&other| other != view);
    let first = |other| (job.plan.lead.start..=frame).find(|&f| job.take.sources().hair_file(other, f).is_some());
    let others = others.filter_map(|other| Some((other, first(other)?)));
    std::iter::once((view, own)).chain(others).collect()
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
    let look = look(job, view, frame)?;
    let key = match key_frame(job, view, frame) {
        Some(at) => take.given_hair(view, at)?,
        None => None,
    };
    let input = MasksInput {
        place: Place::view_frame(&take.rig().cameras[view].name, frame),
        image: &image,
        plate: &plate,
        given_subject: subject.as_ref(),
        given_hair: hair.as_ref(),
        previous: previous.as_ref().map(|(image, masks)| PreviousFrame { image, masks }),
        key: key.as_ref().map(|mask| (mask, look.as_ref().map(|l| &l.look))),
    };
    let masks = strandflow_stages::masks::masks(&input, job.plan.mode, &job.plan.settings.masks, report)
        .map_err(of_stage("masks"))?;
    images::write_image(job, out, ARRAYS[0], (view, frame), &masks.subject)?;
    images::write_image(job, out, ARRAYS[1], (view, frame), &masks.hair)
}

/// What was learnt of the hair in each view on its latest key frame: the frames that follow share it.
#[derive(Default)]
pub(crate) struct Looks(Mutex<HashMap<usize, Arc<Learnt>>>);

/// A look and what it was learnt from; files keep their content as long as a take is open.
struct Learnt {
    keys: Vec<(usize, usize)>,
    settings: MasksSettings,
    look: HairLook,
}

/// The look of hair in a view, learnt on key frames; none in paper mode or where the view has no key frame yet.
fn look(job: &Job, view: usize, frame: usize) -> Result<Option<Arc<Learnt>>, EngineError> {
    let keys = key_views(job, view, frame);
    if job.plan.mode == Mode::Paper || keys.is_empty() {
        return Ok(None);
    }
    let (take, settings) = (job.take, &job.plan.settings.masks);
    let known = take.looks().0.lock().unwrap_or_else(PoisonError::into_inner).get(&view).cloned();
    if let Some(known) = known.filter(|l| l.keys == keys && l.settings == *settings) {
        return Ok(Some(known));
    }
    let mut shown = Vec::with_capacity(keys.len());
    for &(view, key) in &keys {
        if let Some(hair) = take.given_hair(view, key)? {
            let images = (take.images().image(view, key)?, take.plate(view)?);
            shown.push((images, hair, take.given_subject(view, key)?));
        }
    }
    let shown: Vec<KeyView> = shown
        .iter()
        .map(|((image, plate), hair, subject)| KeyView { image, plate, hair, subject: subject.as_ref() })
        .collect();
    let Some((own, others)) = shown.split_first() else { return Ok(None) };
    let place = Place::view_frame(&take.rig().cameras[view].name, keys[0].1);
    let look = HairLook::learn(&place, own, others, settings).map_err(of_stage("masks"))?;
    let learnt = Arc::new(Learnt { keys, settings: settings.clone(), look });
    take.looks().0.lock().unwrap_or_else(PoisonError::into_inner).insert(view, learnt.clone());
    Ok(Some(learnt))
}
