//! Stage 10: each frame smoothed, the take's point count, then each block trimmed.

/// Points of a strand, by its row of provenances.
fn present(row: &[u8]) -> usize {
    row.iter().rposition(|&p| p != 0).map_or(0, |last| last + 1)
}

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

/// Phase 2: the particle count that nearly all strands keep within, and the limits that neighbours set.
pub mod topology {
    use strandflow_core::Report;
    use strandflow_stages::smooth::longest_among_neighbours;

    use super::{super::need_scalp, present};

    use crate::{EngineError, Needs, item::Item, store::Writer, table::Job};

    pub(crate) fn prepare(_: &Job) -> Result<(), EngineError> {
        Ok(())
    }

    pub(crate) fn needs(job: &Job, _: Item, needs: &mut Needs) -> Result<(), EngineError> {
        need_scalp(needs)?;
        (job.plan.frames.start..job.plan.frames.end)
            .try_for_each(|t| needs.item(&Item::Frame(t).key("smooth/frames"), &["smooth/frames/provenance"]))
    }

    /// Longer strands than this share lose their tips: on 3 frames of straight hair of 240 mm one strand in ten thousand
    /// runs on to the longest length there is (121 particles, 99.9 % have at most 62), and would double every array.
    const KEPT_SHARE: f64 = 0.999;

    pub(crate) fn run(job: &Job, _: Item, out: &mut Writer, _: &mut Report) -> Result<(), EngineError> {
        let strands = job.take.strand_count()?;
        let width = job.take.store().shape("smooth/frames/provenance")?[2];
        // How often each strand has each count: its size does not grow with the frames.
        let mut often = vec![0u32; strands * (width + 1)];
        for frame in job.plan.frames.start..job.plan.frames.end {
            let range = [frame..frame + 1, 0..strands, 0..width];
            let provenance: Vec<u8> = job.take.store().read("smooth/frames/provenance", &range)?;
            for (n, row) in provenance.chunks(width).enumerate() {
                often[n * (width + 1) + present(row)] += 1;
            }
        }
        let of_strand = |n: usize| &often[n * (width + 1)..(n + 1) * (width + 1)];
        let lengths = |n: usize| -> Vec<usize> {
            of_strand(n)
                .iter()
                .enumerate()
                .flat_map(|(count, &times)| std::iter::repeat_n(count, times as usize))
                .collect()
        };
        let roots = job.take.read_scalp()?.roots;
        let longest = longest_among_neighbours(&roots, lengths, job.plan.mode, &job.plan.settings.smooth);
        let mut with_count = vec![0usize; width + 1];
        for (n, &longest) in longest.iter().enumerate() {
            for (count, &times) in of_strand(n).iter().enumerate() {
                with_count[count.min(longest.into())] += times as usize;
            }
        }
        out.whole("smooth/longest", &[strands], &longest)?;
        out.whole("smooth/point_count", &[1], &[quantile(&with_count[1..]) as u32])
    }

    /// The smallest count that the kept share of strands does not exceed; `with_count[i]` strands have `i + 1` points.
    fn quantile(with_count: &[usize]) -> usize {
        let all: usize = with_count.iter().sum();
        let kept = (all as f64 * KEPT_SHARE).ceil() as usize;
        let mut below = 0;
        let at = with_count.iter().position(|&n| {
            below += n;
            below >= kept
        });
        if all == 0 { 1 } else { at.map_or(with_count.len(), |i| i + 1) }
    }

    #[cfg(test)]
    mod tests {
        #[test]
        fn one_strand_in_ten_thousand_does_not_set_the_width() {
            let mut with_count = vec![0; 121];
            (with_count[33], with_count[61], with_count[120]) = (9900, 99, 1);
            assert_eq!(super::quantile(&with_count), 62);
            assert_eq!(super::quantile(&[0, 3, 1]), 3);
            assert_eq!(super::quantile(&[0, 0]), 1);
        }
    }
}

/// Phase 3: fixed counts, block by block.
pub mod trim {
    use serde_json::Value;
    use strandflow_core::Report;
    use strandflow_stages::smooth::{fixed_counts, trim};

    use super::{
        super::{block_of, ensure, of_stage, strand_arrays},
        present,
    };
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
        needs.item("smooth/topology/take", &["smooth/point_count", "smooth/longest"])?;
        let arrays = ["smooth/frames/points", "smooth/frames/provenance", "smooth/frames/confidence"];
        frames.into_iter().try_for_each(|t| needs.item(&Item::Frame(t).key("smooth/frames"), &arrays))
    }

    pub(crate) fn run(job: &Job, item: Item, out: &mut Writer, _: &mut Report) -> Result<(), EngineError> {
        let block = block_of(item)?;
        let first = block * BLOCK_STRANDS;
        let strands = first..(first + BLOCK_STRANDS).min(job.take.strand_count()?);
        let (store, points) = (job.take.store(), point_count(job)?);
        let frames = job.plan.frames.start..job.plan.frames.end;
        let width = store.shape("smooth/frames/provenance")?[2];
        let mut lengths = vec![Vec::with_capacity(frames.len()); strands.len()];
        for frame in frames.clone() {
            let provenance: Vec<u8> =
                store.read("smooth/frames/provenance", &[frame..frame + 1, strands.clone(), 0..width])?;
            for (row, lengths) in provenance.chunks(width).zip(&mut lengths) {
                lengths.push(present(row) as u16);
            }
        }
        let longest: Vec<u16> = store.read("smooth/longest", std::slice::from_ref(&strands))?;
        let lengths = |n: usize| lengths[n].iter().map(|&len| len.into()).collect();
        let counts = fixed_counts(lengths, &longest, points, job.plan.mode, &job.plan.settings.smooth);
        for frame in frames {
            let strands = job.take.read_strand_range("smooth", frame, strands.clone())?;
            let trimmed = trim(&[frame as u32], &[strands], &counts, points).map_err(of_stage("smooth"))?;
            strand_arrays::write_sequence(out, "smooth", block, &trimmed, points)?;
        }
        out.chunk("smooth/counts", &[block], &strand_arrays::padded(&counts, 1, 0))
    }
}
