//! The strands of a stage, one frame at a time.

use strandflow_core::{FrameRange, StrandSequence};
use strandflow_io::{At, IoError, strands::StrandFrames};

use crate::{EngineError, Take};

/// Strands after `smooth`, `fit` or `blend`; a frame is read when it is asked for.
pub struct StageStrands<'a> {
    take: &'a Take,
    stage: &'a str,
    numbers: Vec<u32>,
    counts: Vec<u16>,
    point_count: usize,
}

impl Take {
    /// The strands of a stage over some frames, to be read frame by frame.
    ///
    /// # Errors
    /// `Store` or `Missing` where the stage has no results.
    pub fn strands_of<'a>(&'a self, stage: &'a str, frames: FrameRange) -> Result<StageStrands<'a>, EngineError> {
        Ok(StageStrands {
            take: self,
            stage,
            numbers: (frames.start as u32..frames.end as u32).collect(),
            counts: self.read_counts(stage, frames, 0..self.strand_count()?)?,
            point_count: self.store().shape(&format!("{stage}/provenance"))?[2],
        })
    }
}

impl StrandFrames for StageStrands<'_> {
    fn frames(&self) -> &[u32] {
        &self.numbers
    }

    fn counts(&self) -> &[u16] {
        &self.counts
    }

    fn point_count(&self) -> usize {
        self.point_count
    }

    fn frame(&self, t: usize) -> Result<StrandSequence, IoError> {
        let start = self.numbers[t] as usize;
        let frames = FrameRange { start, end: start + 1 };
        let read = self.take.read_sequence_part(self.stage, frames, 0..self.counts.len());
        let mut sequence = read.map_err(|error| {
            let at = At { frame: Some(start), ..At::FILE };
            IoError::content(self.take.store().root(), at, error.to_string(), error.hint())
        })?;
        // After `blend` a frame alone knows its own counts only.
        sequence.counts.clone_from(&self.counts);
        Ok(sequence)
    }
}
