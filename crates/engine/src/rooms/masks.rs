//! Stage 1.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, PoisonError},
};

use strandflow_core::{Place, Report};
use strandflow_stages::{
    Mode, StageError,
    hair_edge::HairEdge,
    hair_look::{HairLesson, HairLook},
    key_frame::KeyView,
    masks::{MasksInput, MasksSettings, NeighbourFrame},
};

use super::{images, of_stage, view_frame_of};
use crate::{EngineError, Needs, item::Item, store::Writer, table::Job};

const PHASE: &str = "masks/masks";
const ARRAYS: [&str; 2] = ["masks/subject", "masks/hair"];

pub(crate) fn prepare(job: &Job) -> Result<(), EngineError> {
    images::ensure_images(job, PHASE, &ARRAYS, images::FULL)
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
        needs_key(job, (view, key), needs)?;
    }
    teachers(job, view, frame).into_iter().try_for_each(|key| needs_key(job, key, needs))?;
    if let Some(neighbour) = neighbour(job, view, frame) {
        needs.file(&sources.image_file(view, neighbour)?)?;
        needs.item(&Item::ViewFrame(view, neighbour).key(PHASE), &ARRAYS)?;
    }
    Ok(())
}

/// The frames of a view in the order of their making: each key frame, then those after it that are nearest to it, then those
/// before it.
pub(crate) fn in_order(job: &Job, view: usize) -> Vec<usize> {
    let mut frames: Vec<usize> = (job.plan.lead.start..job.plan.lead.end).collect();
    let place = |&frame: &usize| match key_frame(job, view, frame) {
        Some(key) => (key, frame < key, frame.abs_diff(key)),
        None => (0, false, frame),
    };
    frames.sort_by_cached_key(place);
    frames
}

/// The nearest frame for which the user gave a hair mask; of two, the earlier.
fn key_frame(job: &Job, view: usize, frame: usize) -> Option<usize> {
    let (given, lead) = (job.take.sources().hair_files(view), job.plan.lead);
    let before = given.range(lead.start..=frame).next_back();
    let after = given.range(frame + 1..lead.end.max(frame + 1)).next();
    before.into_iter().chain(after).map(|(&key, _)| key).min_by_key(|key| key.abs_diff(frame))
}

/// The frame from which the hair mask of this one is carried: the next one towards the key frame.
fn neighbour(job: &Job, view: usize, frame: usize) -> Option<usize> {
    match key_frame(job, view, frame) {
        Some(key) if key == frame => None,
        Some(key) if key > frame => Some(frame + 1),
        _ => (frame > job.plan.lead.start).then(|| frame - 1),
    }
}

/// The first one.
fn first_key_frame(job: &Job, view: usize, frame: usize) -> Option<usize> {
    job.take.sources().hair_files(view).range(job.plan.lead.start..=frame).next().map(|(&key, _)| key)
}

/// All that a key frame shows.
fn needs_key(job: &Job, (view, key): (usize, usize), needs: &mut Needs) -> Result<(), EngineError> {
    let sources = job.take.sources();
    needs.file(sources.plate_file(view))?;
    needs.file(&sources.image_file(view, key)?)?;
    let given = [sources.hair_file(view, key), sources.subject_file(view, key)];
    given.into_iter().flatten().try_for_each(|file| needs.file(&file))
}

/// The first key frames of all views that take part and of the view itself, which comes first: (view, frame). What they teach
/// stays when later frames are corrected. Nothing in paper mode or where the view has no key frame yet.
fn teachers(job: &Job, view: usize, frame: usize) -> Vec<(usize, usize)> {
    let own = first_key_frame(job, view, frame).filter(|_| job.plan.mode == Mode::Robust);
    let Some(own) = own else { return Vec::new() };
    let others = job.take.views().taking_part().iter().copied().filter(|&other| other != view);
    let others = others.filter_map(|other| Some((other, first_key_frame(job, other, frame)?)));
    let others = others.filter(|&(other, key)| job.take.sources().image_file(other, key).is_ok());
    std::iter::once((view, own)).chain(others).collect()
}

pub(crate) fn run(job: &Job, item: Item, out: &mut Writer, report: &mut Report) -> Result<(), EngineError> {
    let (view, frame) = view_frame_of(item)?;
    let take = job.take;
    let image = take.images().image(view, frame)?;
    let plate = take.plate(view)?;
    let (subject, hair) = (take.given_subject(view, frame)?, take.given_hair(view, frame)?);
    let neighbour = match neighbour(job, view, frame) {
        Some(frame) => Some((take.images().image(view, frame)?, take.read_masks(view, frame)?)),
        None => None,
    };
    let teachers = teachers(job, view, frame);
    let key = key_frame(job, view, frame);
    let (look, edge) = match (key, teachers.split_first()) {
        (Some(key), Some((first, others))) => {
            let from = std::iter::once((view, key)).chain(others.iter().copied()).collect();
            let (looks, settings) = (take.looks(), &job.plan.settings.masks);
            // What is wrong with another view is said by its own items; here it teaches nothing.
            let lesson = |&(other, key): &(usize, usize)| {
                let lesson =
                    looks.lesson.once(job, other, vec![(other, key)], |_, own| Ok(HairLesson::of(own, settings)));
                lesson.ok().flatten()
            };
            let look = looks.hair.once(job, view, from, |place, own| {
                let lessons: Vec<_> = others.iter().filter_map(lesson).collect();
                HairLook::learn(place, own, lessons.iter().map(|lesson| &lesson.what), settings)
            })?;
            let edge = looks.edge.once(job, view, vec![*first], |place, own| HairEdge::learn(place, own, settings))?;
            (look, edge)
        }
        _ => (None, None),
    };
    let key = key.map_or(Ok(None), |key| take.given_hair(view, key))?;
    let input = MasksInput {
        place: Place::view_frame(&take.rig().cameras[view].name, frame),
        image: &image,
        plate: &plate,
        given_subject: subject.as_ref(),
        given_hair: hair.as_ref(),
        neighbour: neighbour.as_ref().map(|(image, masks)| NeighbourFrame { image, masks }),
        key: key.as_ref(),
        look: look.as_ref().map(|learnt| &learnt.what),
        edge: edge.as_ref().map(|learnt| &learnt.what),
    };
    let masks = strandflow_stages::masks::masks(&input, job.plan.mode, &job.plan.settings.masks, report)
        .map_err(of_stage("masks"))?;
    images::write_image(job, out, (ARRAYS[0], images::FULL), (view, frame), &masks.subject)?;
    images::write_image(job, out, (ARRAYS[1], images::FULL), (view, frame), &masks.hair)
}

/// What was learnt of the hair in each view: its frames share it.
#[derive(Default)]
pub(crate) struct Looks {
    lesson: LearntOnce<HairLesson>,
    hair: LearntOnce<HairLook>,
    edge: LearntOnce<HairEdge>,
}

/// What was learnt last in each view.
struct LearntOnce<T>(Mutex<HashMap<usize, Arc<Learnt<T>>>>);

/// Something learnt, and from which (view, key frame); files keep their content as long as a take is open.
struct Learnt<T> {
    keys: Vec<(usize, usize)>,
    settings: MasksSettings,
    what: T,
}

impl<T> Default for LearntOnce<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<T> LearntOnce<T> {
    /// What is learnt in a view from a key frame, and by way of what these teach from others after it; as before where all
    /// are the same.
    fn once(
        &self,
        job: &Job,
        view: usize,
        keys: Vec<(usize, usize)>,
        learn: impl FnOnce(&Place, &KeyView) -> Result<T, StageError>,
    ) -> Result<Option<Arc<Learnt<T>>>, EngineError> {
        let (take, settings) = (job.take, &job.plan.settings.masks);
        let known = self.0.lock().unwrap_or_else(PoisonError::into_inner).get(&view).cloned();
        if let Some(known) = known.filter(|l| l.keys == keys && l.settings == *settings) {
            return Ok(Some(known));
        }
        let (view, key) = keys[0];
        let Some(hair) = take.given_hair(view, key)? else { return Ok(None) };
        let (image, plate, subject) =
            (take.images().image(view, key)?, take.plate(view)?, take.given_subject(view, key)?);
        let own = KeyView { image: &image, plate: &plate, hair: &hair, subject: subject.as_ref() };
        let what = learn(&Place::view_frame(&take.rig().cameras[view].name, key), &own).map_err(of_stage("masks"))?;
        let learnt = Arc::new(Learnt { keys, settings: settings.clone(), what });
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(view, learnt.clone());
        Ok(Some(learnt))
    }
}
