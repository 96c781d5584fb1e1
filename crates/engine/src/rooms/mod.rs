//! One room a stage: load the inputs, call the stage, store the outputs.
//!
//! A room has three functions: `prepare` makes the arrays, `needs` states what an item rests on, `run` does it.

pub mod blend;
pub mod field;
pub mod fit;
pub mod flow;
pub mod grow;
pub mod hull;
pub mod lift;
pub mod masks;
pub mod orient;
pub mod pose;
pub mod prune;
pub mod scalp;
pub mod smooth;

mod images;
mod strand_arrays;

use serde_json::Value;
use strandflow_stages::StageError;

use crate::{EngineError, Needs, item::Item, table::Job};

/// Makes an array; where one of another shape had to go, the phase's items have to be done again.
pub(crate) fn ensure(
    job: &Job,
    phase: &str,
    (path, more): (&str, Value),
    shape: &[usize],
    chunk: &[usize],
) -> Result<(), EngineError> {
    let store = job.take.store();
    if !store.matches(path, shape, chunk, more.clone())? {
        // Before the array goes: a run killed in between must not leave records of what is no longer there.
        if store.must_remove(path, shape, chunk, more.clone())? {
            if job.is_task {
                return Err(EngineError::store(
                    path,
                    "is there in another shape; a task among many does not remove it",
                ));
            }
            store.forget_phase(phase)?;
        }
        store.ensure(path, shape, chunk, more)?;
    }
    Ok(())
}

/// Names the stage in a stage's error.
pub(crate) fn of_stage(stage: &'static str) -> impl Fn(StageError) -> EngineError {
    move |error| EngineError::Stage { stage: stage.to_owned(), error: Box::new(error) }
}

/// The head's motion in a frame, by value: another frame's pose may change without this one's results going stale.
pub(crate) fn need_pose(job: &Job, frames: impl Iterator<Item = usize>, needs: &mut Needs) -> Result<(), EngineError> {
    let record = needs.finished("pose/pose/take")?;
    let motion = job.take.head_motion().of(job.take.store(), &record)?;
    for frame in frames {
        let pose = motion.get(frame.saturating_sub(job.take.frames().start));
        let pose = pose.ok_or_else(|| EngineError::store("pose/world_from_head", format!("has no frame {frame}")))?;
        needs.value("stage pose", "world_from_head", &pose.to_rows());
    }
    Ok(())
}

/// The scalp.
pub(crate) fn need_scalp(needs: &mut Needs) -> Result<(), EngineError> {
    needs.item("scalp/scalp/take", &["scalp/vertices", "scalp/faces", "scalp/roots", "scalp/normals"])
}

/// The take's grid.
pub(crate) fn need_grid(needs: &mut Needs) -> Result<(), EngineError> {
    needs.item("hull/grid/take", &["hull/grid/origin", "hull/grid/voxel_mm", "hull/grid/dims"])
}

/// The hull of a frame and the grid it lies on.
pub(crate) fn need_hull(frame: usize, needs: &mut Needs) -> Result<(), EngineError> {
    need_grid(needs)?;
    needs.item(&Item::Frame(frame).key("hull/hull"), &["hull/occupancy"])
}

/// Some mask arrays of a frame, of all views that take part.
pub(crate) fn need_masks(job: &Job, frame: usize, arrays: &[&str], needs: &mut Needs) -> Result<(), EngineError> {
    for &view in job.take.views().taking_part() {
        needs.item(&Item::ViewFrame(view, frame).key("masks/masks"), arrays)?;
    }
    Ok(())
}

/// The cameras that take part.
pub(crate) fn need_rig(job: &Job, needs: &mut Needs) {
    needs.value("values", "rig", job.take.views().rig());
}

/// The same thing of every view that takes part.
pub(crate) fn of_views<T>(job: &Job, read: impl Fn(usize) -> Result<T, EngineError>) -> Result<Vec<T>, EngineError> {
    job.take.views().taking_part().iter().map(|&view| read(view)).collect()
}

/// The frame of a frame item.
pub(crate) fn frame_of(item: Item) -> Result<usize, EngineError> {
    match item {
        Item::Frame(frame) => Ok(frame),
        _ => Err(EngineError::Missing { item: format!("frame of {item:?}") }),
    }
}

/// View and frame of a view × frame item.
pub(crate) fn view_frame_of(item: Item) -> Result<(usize, usize), EngineError> {
    match item {
        Item::ViewFrame(view, frame) => Ok((view, frame)),
        _ => Err(EngineError::Missing { item: format!("view and frame of {item:?}") }),
    }
}

/// The block of a block item.
pub(crate) fn block_of(item: Item) -> Result<usize, EngineError> {
    match item {
        Item::Block(block) => Ok(block),
        _ => Err(EngineError::Missing { item: format!("block of {item:?}") }),
    }
}

/// References to all elements.
pub(crate) fn refs<T>(items: &[T]) -> Vec<&T> {
    items.iter().collect()
}
