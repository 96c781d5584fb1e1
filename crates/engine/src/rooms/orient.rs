//! Stage 5.

use strandflow_core::Report;
use strandflow_stages::{
    Mode,
    orient::{OrientationMap, steady::steady},
};

use super::{
    images::{self, FULL, Scale},
    view_frame_of,
};
use crate::{EngineError, Needs, item::Item, read::ANGLE_STEPS, store::Writer, table::Job};

const PHASE: &str = "orient/orient";
const ARRAYS: [&str; 2] = ["orient/angle", "orient/confidence"];

pub(crate) fn prepare(job: &Job) -> Result<(), EngineError> {
    images::ensure_images(job, PHASE, &ARRAYS, FULL)
}

pub(crate) fn needs(job: &Job, item: Item, needs: &mut Needs) -> Result<(), EngineError> {
    let (view, frame) = view_frame_of(item)?;
    let own = item.key(frames::PHASE);
    let (before, after) = around(job, view, frame)?;
    if before.is_empty() && after.is_empty() {
        return needs.item(&own, &frames::MAP);
    }
    needs.item(&own, &[frames::MAP, frames::BACK].concat())?;
    let seen = [frames::HALF, frames::BACK].concat();
    before.into_iter().chain(after).try_for_each(|t| needs.item(&Item::ViewFrame(view, t).key(frames::PHASE), &seen))
}

pub(crate) fn run(job: &Job, item: Item, out: &mut Writer, _: &mut Report) -> Result<(), EngineError> {
    let at @ (view, frame) = view_frame_of(item)?;
    let own = job.take.read_lone_orientation(view, frame)?;
    let (before, after) = around(job, view, frame)?;
    let moments =
        |frames: &[usize]| frames.iter().map(|&t| job.take.read_moment(view, t)).collect::<Result<Vec<_>, _>>();
    let map = if before.is_empty() && after.is_empty() {
        own
    } else {
        let back = job.take.read_flow_back(view, frame)?;
        steady(&own, &back, &moments(&before)?, &moments(&after)?)
    };
    write_map(job, out, (ARRAYS, FULL), at, &map)
}

/// The frames before and after one that it is averaged with, nearest first: as many as the settings say, up to the first that
/// never will have a map.
fn around(job: &Job, view: usize, frame: usize) -> Result<(Vec<usize>, Vec<usize>), EngineError> {
    let (start, end, reach) = (job.plan.frames.start, job.plan.frames.end, reach(job));
    let there = |t: usize| neighbour(job, frames::PHASE, view, t).transpose();
    let before = (start.max(frame.saturating_sub(reach))..frame).rev().map_while(there);
    let after = (frame + 1..end.min(frame + 1 + reach)).map_while(there);
    Ok((before.collect::<Result<_, _>>()?, after.collect::<Result<_, _>>()?))
}

/// Angles and confidences, as the store has them.
fn write_map(
    job: &Job,
    out: &mut Writer,
    ([angle, confidence], scale): ([&str; 2], Scale),
    at: (usize, usize),
    map: &OrientationMap,
) -> Result<(), EngineError> {
    // An angle just below π rounds to π, which is 0 for an undirected line: the wrap to u16 is the right one.
    let steps = map.angle.map(|&a| nearest(a * (ANGLE_STEPS / std::f32::consts::PI)) as u16);
    images::write_image(job, out, (angle, scale), at, &steps)?;
    let trust = map.confidence.map(|&c| nearest(c.clamp(0.0, 1.0) * 255.0) as u8);
    images::write_image(job, out, (confidence, scale), at, &trust)
}

/// The integer nearest to a value in 0..2²²; only the low 22 bits count. A sum with 1.5 · 2²³ keeps no fraction and ends in its
/// bits: unlike a conversion that minds what no integer holds, many at once on any machine.
#[inline]
fn nearest(value: f32) -> u32 {
    (value + 12_582_912.0).to_bits()
}

/// A frame whose item of a phase is finished. `None` where the input of the view is to blame that it is not: one bad image must
/// not cost its neighbours.
///
/// # Errors
/// `Missing` where it is still to come: what went on without it would have to be done again.
fn neighbour(job: &Job, phase: &str, view: usize, frame: usize) -> Result<Option<usize>, EngineError> {
    let store = job.take.store();
    let item = Item::ViewFrame(view, frame).key(phase);
    if store.finished(&item)?.is_some() {
        return Ok(Some(frame));
    }
    let is_to_blame = |phase: &str, t: usize| {
        store.failure(&Item::ViewFrame(view, t).key(phase)).is_some_and(|failure| failure.input)
    };
    let mut frames = job.plan.lead.start..job.plan.frames.end;
    if frames.any(|t| is_to_blame("masks/masks", t) || is_to_blame(frames::PHASE, t)) {
        return Ok(None);
    }
    Err(EngineError::Missing { item })
}

/// How many frames to either side a frame is averaged with.
fn reach(job: &Job) -> usize {
    match job.plan.mode {
        Mode::Paper => 0,
        Mode::Robust => job.plan.settings.orient.over_frames,
    }
}

/// The first phase: every frame by itself, and what its neighbours need of it.
pub mod frames {
    use strandflow_core::{Place, Report};
    use strandflow_stages::orient::{
        orient,
        steady::{Flow, flow_back, flow_size, half, half_size},
    };

    use super::{
        super::{
            images::{self, FULL},
            of_stage, view_frame_of,
        },
        neighbour, reach, write_map,
    };
    use crate::{EngineError, Needs, item::Item, store::Writer, table::Job};

    pub(super) const PHASE: &str = "orient/frames";
    pub(crate) const MAP: [&str; 2] = ["orient/frames/angle", "orient/frames/confidence"];
    pub(crate) const HALF: [&str; 2] = ["orient/frames/half_angle", "orient/frames/half_confidence"];
    pub(crate) const BACK: [&str; 2] = ["orient/frames/back_u", "orient/frames/back_v"];

    pub(crate) fn prepare(job: &Job) -> Result<(), EngineError> {
        images::ensure_images(job, PHASE, &MAP, FULL)?;
        images::ensure_images(job, PHASE, &HALF, half_size)?;
        images::ensure_images(job, PHASE, &BACK, flow_size)
    }

    /// The frame before, where it has masks: an image that cannot be read costs its neighbours nothing.
    fn before(job: &Job, view: usize, frame: usize) -> Result<Option<usize>, EngineError> {
        if reach(job) == 0 || frame == job.plan.frames.start {
            return Ok(None);
        }
        neighbour(job, "masks/masks", view, frame - 1)
    }

    pub(crate) fn needs(job: &Job, item: Item, needs: &mut Needs) -> Result<(), EngineError> {
        let (view, frame) = view_frame_of(item)?;
        needs.file(&job.take.sources().image_file(view, frame)?)?;
        needs.item(&item.key("masks/masks"), &["masks/subject", "masks/hair"])?;
        let Some(before) = before(job, view, frame)? else { return Ok(()) };
        needs.finished(&Item::ViewFrame(view, before).key("masks/masks"))?;
        needs.file(&job.take.sources().image_file(view, before)?)
    }

    pub(crate) fn run(job: &Job, item: Item, out: &mut Writer, report: &mut Report) -> Result<(), EngineError> {
        let at @ (view, frame) = view_frame_of(item)?;
        let place = Place::view_frame(&job.take.rig().cameras[view].name, frame);
        let image = job.take.images().image(view, frame)?;
        let masks = job.take.read_masks(view, frame)?;
        let (mode, settings) = (job.plan.mode, &job.plan.settings.orient);
        let map =
            orient(&place, &image, &masks.hair, &masks.subject, mode, settings, report).map_err(of_stage("orient"))?;
        write_map(job, out, (MAP, FULL), at, &map)?;
        if reach(job) == 0 {
            return Ok(());
        }
        write_map(job, out, (HALF, half_size), at, &half(&map))?;
        let back = match before(job, view, frame)? {
            Some(before) => flow_back(&image, &*job.take.images().image(view, before)?, &masks.hair),
            None => {
                let (width, height) = flow_size((image.width, image.height));
                Flow::zero(width, height)
            }
        };
        images::write_image(job, out, (BACK[0], flow_size), at, &back.u)?;
        images::write_image(job, out, (BACK[1], flow_size), at, &back.v)
    }
}
