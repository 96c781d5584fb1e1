//! Blocks of strands as they lie in the store, the last ones kept.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, PoisonError},
    time::SystemTime,
};

use glam::Vec3;
use strandflow_core::Provenance;
use strandflow_engine::{item::BLOCK_STRANDS, store::Store};
use strandflow_view::Refusal;

use super::{
    sets::{Kind, Set, of_set},
    source::Source,
};

/// Memory for blocks \[bytes\]: some 38 frames of 8,000 strands of 61 points, so that going to and fro, speeds and two
/// colours of one frame read once. The browser keeps what it shows itself.
const KEPT_BYTES: usize = 256 << 20;

/// The strands of one chunk in one frame; of the truth all strands.
pub struct Part {
    /// Number of its first strand.
    pub first: usize,
    /// Points a strand.
    pub width: usize,
    /// World \[mm\], NaN where missing; shape (strands, width), as all below.
    pub points: Vec<Vec3>,
    /// By number.
    pub provenance: Vec<u8>,
    /// Times 255.
    pub confidence: Vec<u8>,
}

impl Part {
    /// Indices of a strand's points.
    pub fn range(&self, strand: usize) -> std::ops::Range<usize> {
        let at = (strand - self.first) * self.width;
        at..at + self.width
    }

    fn bytes(&self) -> usize {
        self.points.len() * (size_of::<Vec3>() + 2)
    }
}

/// Set, frame, block.
type Key = (String, usize, usize);

struct Kept {
    part: Arc<Part>,
    /// When the chunk was written: a run may replace it.
    written: Option<SystemTime>,
    used: u64,
}

#[derive(Default)]
struct Cache {
    kept: HashMap<Key, Kept>,
    bytes: usize,
    clock: u64,
}

/// Reads blocks and keeps the last used.
#[derive(Default)]
pub struct Parts(Mutex<Cache>);

impl Parts {
    /// The number of the block that holds a strand.
    pub fn block_of(set: &Set, strand: usize) -> usize {
        if set.kind == Kind::Truth { 0 } else { strand / BLOCK_STRANDS }
    }

    /// A block of a frame that is there.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn part(&self, source: &Source, set: &Set, frame: usize, block: usize) -> Result<Arc<Part>, Refusal> {
        let key = (set.id.clone(), frame, block);
        let written = written(source, set, frame, block);
        if let Some(part) = self.kept(&key, written) {
            return Ok(part);
        }
        let part = Arc::new(match (&set.kind, source.truth()) {
            (Kind::Truth, Some(truth)) => truth.part(frame)?,
            _ => read(&source.store()?, set, frame, block)?,
        });
        self.keep(key, part.clone(), written);
        Ok(part)
    }

    /// A block that is kept.
    pub fn kept(&self, key: &Key, written: Option<SystemTime>) -> Option<Arc<Part>> {
        let mut cache = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        cache.clock += 1;
        let now = cache.clock;
        let kept = cache.kept.get_mut(key).filter(|kept| kept.written == written)?;
        kept.used = now;
        Some(kept.part.clone())
    }

    fn keep(&self, key: Key, part: Arc<Part>, written: Option<SystemTime>) {
        let mut cache = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        cache.clock += 1;
        cache.bytes += part.bytes();
        let used = cache.clock;
        if let Some(before) = cache.kept.insert(key, Kept { part, written, used }) {
            cache.bytes -= before.part.bytes();
        }
        while cache.bytes > KEPT_BYTES && cache.kept.len() > 1 {
            let Some(oldest) = cache.kept.iter().min_by_key(|(_, kept)| kept.used).map(|(key, _)| key.clone()) else {
                break;
            };
            if let Some(gone) = cache.kept.remove(&oldest) {
                cache.bytes -= gone.part.bytes();
            }
        }
    }
}

/// When a chunk of positions was written.
fn written(source: &Source, set: &Set, frame: usize, block: usize) -> Option<SystemTime> {
    if set.kind == Kind::Truth {
        return None;
    }
    let chunk = format!("{}/points/c/{frame}/{block}/0/0", set.id);
    std::fs::metadata(source.store().ok()?.root().join(chunk)).ok()?.modified().ok()
}

/// Reads a block.
fn read(store: &Store, set: &Set, frame: usize, block: usize) -> Result<Part, Refusal> {
    let first = block * BLOCK_STRANDS;
    rows(store, set, frame, first..(first + BLOCK_STRANDS).min(set.strands))
}

/// Reads some strands of one block.
///
/// # Errors
/// The arrays cannot be read.
pub fn rows(store: &Store, set: &Set, frame: usize, strands: std::ops::Range<usize>) -> Result<Part, Refusal> {
    let failed = of_set(set);
    let (first, width) = (strands.start, set.points);
    let samples = [frame..frame + 1, strands, 0..width];
    let mut positions = samples.to_vec();
    positions.push(0..3);
    let points: Vec<f32> = store.read(&format!("{}/points", set.id), &positions).map_err(&failed)?;
    let points: Vec<Vec3> = points.chunks_exact(3).map(Vec3::from_slice).collect();
    let (provenance, confidence) = match set.kind {
        // A simulated point is as sure as any other of its animation.
        Kind::Animation => {
            let there = |yes: u8, no: u8| points.iter().map(|p| if p.is_finite() { yes } else { no }).collect();
            (there(Provenance::Simulated as u8, Provenance::Missing as u8), there(255, 0))
        }
        _ => {
            let marks = |name: &str| store.read(&format!("{}/{name}", set.id), &samples).map_err(&failed);
            (marks("provenance")?, marks("confidence")?)
        }
    };
    Ok(Part { first, width, points, provenance, confidence })
}
