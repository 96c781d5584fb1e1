//! Stage 8.

use strandflow_core::Report;
use strandflow_stages::{
    Mode,
    grow::{Before, GrowInput},
};

use super::{frame_of, need_pose, need_scalp, of_stage, strand_arrays};
use crate::{EngineError, Needs, item::Item, store::Writer, table::Job};

pub(crate) fn prepare(job: &Job) -> Result<(), EngineError> {
    strand_arrays::ensure_strands(job, "grow/grow", "grow", job.plan.settings.grow.max_points())
}

pub(crate) fn needs(job: &Job, item: Item, needs: &mut Needs) -> Result<(), EngineError> {
    let frame = frame_of(item)?;
    super::need_grid(needs)?;
    need_scalp(needs)?;
    need_pose(job, [frame].into_iter(), needs)?;
    needs.value("values", "gravity", &job.take.manifest().gravity);
    let arrays = ["voxel", "direction", "trust", "observed"].map(|name| format!("field/{frame:06}/{name}"));
    needs.item(&item.key("field/field"), &arrays.each_ref().map(String::as_str))?;
    let Some(before) = before(job, frame)? else { return Ok(()) };
    need_pose(job, [before].into_iter(), needs)?;
    needs.item(&item.key("field/motion"), &[&format!("field/{frame:06}/motion")])?;
    needs.item(&Item::Frame(before).key("grow/grow"), &["grow/points", "grow/provenance"])
}

/// The frame whose strands are followed: none in the first frame, nor where every frame grows by itself, nor after a frame
/// that could not be grown: one bad frame must not cost all after it. The frame before settles first, and what an item
/// rests on tells the two cases apart, so a frame put right is followed again. A frame before that is neither done nor at fault is
/// missing: another process may be making it, and nobody may take that for a bad one.
fn before(job: &Job, frame: usize) -> Result<Option<usize>, EngineError> {
    let follows = job.plan.mode == Mode::Robust && job.plan.settings.grow.follow > 0.0;
    if !follows || frame == job.plan.frames.start {
        return Ok(None);
    }
    let (store, before) = (job.take.store(), frame - 1);
    let key = |phase| Item::Frame(before).key(phase);
    if store.finished(&key("grow/grow"))?.is_some() {
        return Ok(Some(before));
    }
    let is_blocked = store.finished(&key("field/field"))?.is_none() || store.finished(&key("field/motion"))?.is_none();
    if is_blocked || store.failure(&key("grow/grow")).is_some() {
        return Ok(None);
    }
    Err(EngineError::Missing { item: key("grow/grow") })
}

pub(crate) fn run(job: &Job, item: Item, out: &mut Writer, report: &mut Report) -> Result<(), EngineError> {
    let frame = frame_of(item)?;
    let (take, settings) = (job.take, &job.plan.settings.grow);
    let scalp = take.read_scalp()?;
    let before = before(job, frame)?
        .map(|before| Ok::<_, EngineError>((take.read_strands("grow", before)?, take.read_pose(before)?)))
        .transpose()?;
    let motion = before.as_ref().map(|_| take.read_motion(frame)).transpose()?;
    let before = before.as_ref().zip(motion.as_ref()).map(|((strands, pose), motion)| Before {
        strands,
        motion,
        world_from_head: *pose,
    });
    let input = GrowInput {
        frame,
        field: &take.read_field(frame)?,
        roots: &scalp.roots,
        normals: &scalp.normals,
        world_from_head: take.read_pose(frame)?,
        gravity: take.gravity(),
        before,
    };
    let strands = strandflow_stages::grow::grow(&input, job.plan.mode, settings, report).map_err(of_stage("grow"))?;
    strand_arrays::write_strands(out, "grow", frame, &strands, settings.max_points())
}
