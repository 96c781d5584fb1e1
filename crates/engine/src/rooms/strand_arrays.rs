//! Strands as padded arrays in chunks of one block of one frame.

use glam::Vec3;
use serde_json::Value;
use strandflow_core::{Place, Provenance, StrandSequence, Strands};
use strandflow_stages::StageError;

use super::ensure;
use crate::{EngineError, item::BLOCK_STRANDS, store::Writer, table::Job};

/// Makes `points`, `provenance` and `confidence` in a folder of the store.
pub(crate) fn ensure_strands(job: &Job, phase: &str, folder: &str, point_count: usize) -> Result<(), EngineError> {
    let strands = job.take.strand_count()?;
    let (shape, chunk) = ([job.plan.end, strands, point_count], [1, BLOCK_STRANDS, point_count]);
    ensure(job, phase, (&format!("{folder}/provenance"), Value::Null), &shape, &chunk)?;
    ensure(job, phase, (&format!("{folder}/confidence"), Value::Null), &shape, &chunk)?;
    let (shape, chunk) = ([shape[0], shape[1], shape[2], 3], [1, BLOCK_STRANDS, point_count, 3]);
    ensure(job, phase, (&format!("{folder}/points"), Value::Null), &shape, &chunk)
}

/// One chunk in the making.
struct Chunk {
    points: Vec<f32>,
    provenance: Vec<u8>,
    confidence: Vec<u8>,
}

impl Chunk {
    fn missing(point_count: usize) -> Self {
        let len = BLOCK_STRANDS * point_count;
        Self { points: vec![f32::NAN; len * 3], provenance: vec![0; len], confidence: vec![0; len] }
    }

    fn set(&mut self, at: usize, point: Vec3, provenance: Provenance, confidence: f32) {
        self.points[3 * at..3 * at + 3].copy_from_slice(&point.to_array());
        self.provenance[at] = provenance as u8;
        self.confidence[at] = (confidence.clamp(0.0, 1.0) * 255.0).round() as u8;
    }

    fn write(&self, out: &mut Writer, folder: &str, frame: usize, block: usize) -> Result<(), EngineError> {
        out.chunk(&format!("{folder}/points"), &[frame, block, 0, 0], &self.points)?;
        out.chunk(&format!("{folder}/provenance"), &[frame, block, 0], &self.provenance)?;
        out.chunk(&format!("{folder}/confidence"), &[frame, block, 0], &self.confidence)
    }
}

/// Writes the strands of one frame.
///
/// # Errors
/// `Stage` where a point is not finite; `Store` where a strand has more points than the array holds.
pub(crate) fn write_strands(
    out: &mut Writer,
    folder: &'static str,
    frame: usize,
    strands: &Strands,
    point_count: usize,
) -> Result<(), EngineError> {
    for block in 0..strands.strand_count().div_ceil(BLOCK_STRANDS) {
        let first = block * BLOCK_STRANDS;
        let last = (first + BLOCK_STRANDS).min(strands.strand_count());
        let mut chunk = Chunk::missing(point_count);
        for strand in first..last {
            let range = strands.range(strand);
            if range.len() > point_count {
                let fact = format!("frame {frame}, strand {strand}: {} points, at most {point_count} fit", range.len());
                return Err(EngineError::store(folder, fact));
            }
            for (p, i) in range.enumerate() {
                finite(strands.points[i], folder, frame, strand)?;
                let at = (strand - first) * point_count + p;
                chunk.set(at, strands.points[i], strands.provenance[i], strands.confidence[i]);
            }
        }
        chunk.write(out, folder, frame, block)?;
    }
    Ok(())
}

/// Writes a sequence whose strands are those of block `block` on, for all its frames.
///
/// # Errors
/// As [`write_strands`].
pub(crate) fn write_sequence(
    out: &mut Writer,
    folder: &'static str,
    block: usize,
    sequence: &StrandSequence,
    point_count: usize,
) -> Result<(), EngineError> {
    if sequence.point_count > point_count {
        let fact = format!("{} points a strand, {point_count} expected", sequence.point_count);
        return Err(EngineError::store(folder, fact));
    }
    for (t, &frame) in sequence.frames.iter().enumerate() {
        for part in 0..sequence.strand_count.div_ceil(BLOCK_STRANDS) {
            let first = part * BLOCK_STRANDS;
            let last = (first + BLOCK_STRANDS).min(sequence.strand_count);
            let mut chunk = Chunk::missing(point_count);
            for strand in first..last {
                for (p, i) in sequence.range(t, strand).enumerate() {
                    if sequence.valid(i) {
                        finite(sequence.points[i], folder, frame as usize, block * BLOCK_STRANDS + strand)?;
                        let at = (strand - first) * point_count + p;
                        chunk.set(at, sequence.points[i], sequence.provenance[i], sequence.confidence[i]);
                    }
                }
            }
            chunk.write(out, folder, frame as usize, block + part)?;
        }
    }
    Ok(())
}

/// Pads per-strand values of one block to a chunk.
pub(crate) fn padded<T: Clone>(values: &[T], per_strand: usize, fill: T) -> Vec<T> {
    let mut out = values.to_vec();
    out.resize(BLOCK_STRANDS * per_strand, fill);
    out
}

fn finite(point: Vec3, folder: &str, frame: usize, strand: usize) -> Result<(), EngineError> {
    if point.is_finite() {
        return Ok(());
    }
    let place = Place { view: None, frame: Some(frame), strand: Some(strand) };
    let stage = folder.split('/').next().unwrap_or_default().to_owned();
    Err(EngineError::Stage { stage, error: Box::new(StageError::NonFinite { place, what: "a point".into() }) })
}
