//! Stage 10: each frame smoothed, the take's point count, then each block trimmed.

/// Phase 1: every frame by itself.
pub mod frames {
    use strandflow_core::Report;

    use super::super::{frame_of, of_stage, strand_arrays};
    use crate::{EngineError, Needs, item::Item, store::Writer, table::Job};

    pub(crate) fn prepare(job: &Job) -> Result<(), EngineError> {
        let width = job.plan.settings.max_smooth_points();
        strand_arrays::ensure_strands(job, "smooth/frames", "smooth/frames", width)
    }

    pub(crate) fn needs(_: &Job, item: Item, needs: &mut Needs) -> Result<(), EngineError> {
        needs.item(&item.key("prune/prune"), &["prune/points", "prune/provenance", "prune/confidence"])
    }

    pub(crate) fn run(job: &Job, item: Item, out: &mut Writer, report: &mut Report) -> Result<(), EngineError> {
        let frame = frame_of(item)?;
        let strands = job.take.read_strands("prune", frame)?;
        let (mode, settings) = (job.plan.mode, &job.plan.settings);
        let smooth = strandflow_stages::smooth::smooth_frame(&strands, frame, mode, &settings.smooth, report)
            .map_err(of_stage("smooth"))?;
        strand_arrays::write_strands(out, "smooth/frames", frame, &smooth, settings.max_smooth_points())
    }
}

/// Phase 2: the largest particle count.
pub mod topology {
    use strandflow_core::Report;

    use crate::{EngineError, Needs, item::Item, store::Writer, table::Job};

    pub(crate) fn prepare(_: &Job) -> Result<(), EngineError> {
        Ok(())
    }

    pub(crate) fn needs(job: &Job, _: Item, needs: &mut Needs) -> Result<(), EngineError> {
        (job.plan.frames.start..job.plan.frames.end)
            .try_for_each(|t| needs.item(&Item::Frame(t).key("smooth/frames"), &["smooth/frames/provenance"]))
    }

    pub(crate) fn run(job: &Job, _: Item, out: &mut Writer, _: &mut Report) -> Result<(), EngineError> {
        let strands = job.take.strand_count()?;
        let width = job.take.store().shape("smooth/frames/provenance")?[2];
        let mut most = 1;
        for frame in job.plan.frames.start..job.plan.frames.end {
            let range = [frame..frame + 1, 0..strands, 0..width];
            let provenance: Vec<u8> = job.take.store().read("smooth/frames/provenance", &range)?;
            let longest = provenance.chunks(width).filter_map(|row| row.iter().rposition(|&p| p != 0)).max();
            most = most.max(longest.map_or(1, |last| last + 1));
        }
        out.whole("smooth/point_count", &[1], &[most as u32])
    }
}

/// Phase 3: fixed counts, block by block.
pub mod trim {
    use serde_json::Value;
    use strandflow_core::Report;

    use super::super::{block_of, ensure, need_pose, of_stage, strand_arrays};
    use crate::{
        EngineError, Needs,
        item::{BLOCK_STRANDS, Item},
        store::Writer,
        table::Job,
    };

    const PHASE: &str = "smooth/trim";

    pub(crate) fn point_count(job: &Job) -> Result<usize, EngineError> {
        Ok(job.take.store().read_all::<u32>("smooth/point_count")?[0] as usize)
    }

    pub(crate) fn prepare(job: &Job) -> Result<(), EngineError> {
        strand_arrays::ensure_strands(job, PHASE, "smooth", point_count(job)?)?;
        ensure(job, PHASE, ("smooth/counts", Value::Null), &[job.take.strand_count()?], &[BLOCK_STRANDS])
    }

    pub(crate) fn needs(job: &Job, _: Item, needs: &mut Needs) -> Result<(), EngineError> {
        let frames = job.plan.frames.start..job.plan.frames.end;
        need_pose(job, frames.clone(), needs)?;
        needs.item("smooth/topology/take", &["smooth/point_count"])?;
        let arrays = ["smooth/frames/points", "smooth/frames/provenance", "smooth/frames/confidence"];
        frames.into_iter().try_for_each(|t| needs.item(&Item::Frame(t).key("smooth/frames"), &arrays))
    }

    pub(crate) fn run(job: &Job, item: Item, out: &mut Writer, report: &mut Report) -> Result<(), EngineError> {
        let block = block_of(item)?;
        let first = block * BLOCK_STRANDS;
        let strands = first..(first + BLOCK_STRANDS).min(job.take.strand_count()?);
        let numbers: Vec<u32> = (job.plan.frames.start as u32..job.plan.frames.end as u32).collect();
        let read = |&frame: &u32| job.take.read_strand_range("smooth", frame as usize, strands.clone());
        let frames = numbers.iter().map(read).collect::<Result<Vec<_>, _>>()?;
        let poses = numbers.iter().map(|&t| job.take.read_pose(t as usize)).collect::<Result<Vec<_>, _>>()?;
        let (points, mode, settings) = (point_count(job)?, job.plan.mode, &job.plan.settings.smooth);
        let sequence = strandflow_stages::smooth::trim_block(&numbers, &frames, &poses, points, mode, settings, report)
            .map_err(of_stage("smooth"))?;
        strand_arrays::write_sequence(out, "smooth", block, &sequence, points)?;
        out.chunk("smooth/counts", &[block], &strand_arrays::padded(&sequence.counts, 1, 0))
    }
}
