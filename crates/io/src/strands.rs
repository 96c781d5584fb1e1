//! Strands in the formats of other programs.
//!
//! | ending | format | what is written |
//! |---|---|---|
//! | `.npz` | NumPy archive (`npz`) | the whole sequence as it is, missing samples as NaN |
//! | `.ply` | polygon file, binary (`ply`) | one frame: points and edges, provenance, confidence |
//! | `.hair` | Cem Yuksel's (`hair`) | one frame |
//! | `.data` | USC's hair (`usc_data`) | one frame |
//! | `.usd`, `.usdc`, `.usda` | animated USD (`crate::usd`) | all frames, constant topology |
//! | `.abc` | animated Alembic (`crate::alembic`) | all frames, constant topology |
//!
//! All but `.npz` hold no missing points: see [`Interchange`].

use std::{cell::RefCell, collections::BTreeMap, collections::VecDeque, ops::Range, rc::Rc};

use glam::Vec3;
use strandflow_core::{Provenance, StrandSequence};

use crate::IoError;

pub(crate) mod bare_hair;
pub mod choose;
pub mod hair;
pub mod npy;
pub mod npz;
pub(crate) mod npz_groom;
pub mod ply;
mod ply_elements;
pub(crate) mod ply_groom;
pub mod resample;
pub mod usc_data;

/// Strands of fixed topology that are read one frame at a time, so that a long take need not fit into memory.
pub trait StrandFrames: Sync {
    /// Frame numbers.
    fn frames(&self) -> &[u32];

    /// Particles of each strand over all frames (0: the strand is absent).
    fn counts(&self) -> &[u16];

    /// The largest particle count.
    fn point_count(&self) -> usize;

    /// The `t`-th frame as a sequence of one frame, with these counts.
    ///
    /// # Errors
    /// It cannot be read.
    fn frame(&self, t: usize) -> Result<StrandSequence, IoError>;
}

impl StrandFrames for StrandSequence {
    fn frames(&self) -> &[u32] {
        &self.frames
    }

    fn counts(&self) -> &[u16] {
        &self.counts
    }

    fn point_count(&self) -> usize {
        self.point_count
    }

    fn frame(&self, t: usize) -> Result<StrandSequence, IoError> {
        let size = self.strand_count * self.point_count;
        let range = t * size..(t + 1) * size;
        Ok(StrandSequence {
            frames: vec![self.frames[t]],
            counts: self.counts.clone(),
            points: self.points[range.clone()].to_vec(),
            provenance: self.provenance[range.clone()].to_vec(),
            confidence: self.confidence[range].to_vec(),
            ..*self
        })
    }
}

/// A sequence as programs without a notion of missing points take it: the same strands with the same particles in every
/// frame, every position a number.
///
/// A strand takes part if it has two particles or more and a position anywhere in time. A particle that a frame lacks
/// stands at the strand's nearest particle that the frame has; a strand that a frame lacks stands as in the nearest frame
/// that has it. Such points are marked `Missing` with confidence 0.
///
/// Memory: a few frames, and one bit a strand and frame.
pub struct Interchange<'a> {
    source: &'a dyn StrandFrames,
    /// The numbers of the strands that take part, rising.
    pub strands: Vec<u32>,
    /// By frame, which strands have a position.
    present: Vec<Bits>,
    kept: RefCell<VecDeque<(usize, Rc<StrandSequence>)>>,
}

/// Frames kept: the one asked for with its neighbours (for velocities), and one from which a gap is filled.
const KEPT_FRAMES: usize = 4;

/// One frame of an [`Interchange`], strands one after the other, root first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InterchangeFrame {
    /// World \[mm\].
    pub points: Vec<Vec3>,
    /// As `points`.
    pub provenance: Vec<Provenance>,
    /// As `points`, 0 to 1.
    pub confidence: Vec<f32>,
}

impl<'a> Interchange<'a> {
    /// The strands of a sequence that take part; reads every frame once.
    ///
    /// # Errors
    /// A frame cannot be read.
    pub fn new(source: &'a dyn StrandFrames) -> Result<Self, IoError> {
        let counts = source.counts();
        let mut present = Vec::with_capacity(source.frames().len());
        let mut somewhere = vec![false; counts.len()];
        for t in 0..source.frames().len() {
            let frame = source.frame(t)?;
            let mut bits = Bits::new(counts.len());
            for n in (0..counts.len()).filter(|&n| frame.range(0, n).any(|at| is_known(&frame, at))) {
                bits.set(n);
                somewhere[n] = true;
            }
            present.push(bits);
        }
        let strands = (0..counts.len()).filter(|&n| counts[n] >= 2 && somewhere[n]).map(|n| n as u32).collect();
        Ok(Self { source, strands, present, kept: RefCell::default() })
    }

    /// Frame numbers.
    pub fn frames(&self) -> &'a [u32] {
        self.source.frames()
    }

    /// Particles of each strand that takes part.
    pub fn counts(&self) -> Vec<u32> {
        self.strands.iter().map(|&n| u32::from(self.source.counts()[n as usize])).collect()
    }

    /// Where the points of each strand that takes part lie in a frame.
    pub fn ranges(&self) -> Vec<Range<usize>> {
        let ranges = self.counts().into_iter().scan(0, |next, count| {
            let start = *next;
            *next += count as usize;
            Some(start..*next)
        });
        ranges.collect()
    }

    /// The roots in the `t`-th frame, world \[mm\]; none where there is no frame.
    ///
    /// # Errors
    /// As [`Interchange::frame`].
    pub fn roots(&self, t: usize) -> Result<Vec<Vec3>, IoError> {
        let frame = if t < self.frames().len() { self.frame(t)? } else { return Ok(Vec::new()) };
        Ok(self.ranges().into_iter().map(|range| frame.points[range.start]).collect())
    }

    /// The `t`-th frame.
    ///
    /// # Errors
    /// It, or a frame from which a gap is filled, cannot be read.
    pub fn frame(&self, t: usize) -> Result<InterchangeFrame, IoError> {
        // Strands by the frame that has them: each such frame is read once, however many strands come from it.
        let mut from: BTreeMap<usize, Vec<(usize, usize)>> = BTreeMap::new();
        let mut size = 0;
        for &strand in &self.strands {
            let strand = strand as usize;
            from.entry(self.nearest(t, strand)).or_default().push((strand, size));
            size += usize::from(self.source.counts()[strand]);
        }
        let mut frame = InterchangeFrame {
            points: vec![Vec3::ZERO; size],
            provenance: vec![Provenance::Missing; size],
            confidence: vec![0.0; size],
        };
        for (source, strands) in from {
            let sequence = self.load(source)?;
            for (strand, start) in strands {
                put_strand(&mut frame, start, &sequence, strand, source == t);
            }
        }
        Ok(frame)
    }

    /// The frame nearest to `t` that has a strand; of two as far, the earlier one.
    fn nearest(&self, t: usize, strand: usize) -> usize {
        let last = self.present.len();
        let mut near = (0..last).flat_map(|d| [t.checked_sub(d), Some(t + d).filter(|t| *t < last)]).flatten();
        near.find(|&near| self.present[near].get(strand)).unwrap_or(t)
    }

    fn load(&self, t: usize) -> Result<Rc<StrandSequence>, IoError> {
        let mut kept = self.kept.borrow_mut();
        if let Some((_, frame)) = kept.iter().find(|(number, _)| *number == t) {
            return Ok(frame.clone());
        }
        let frame = Rc::new(self.source.frame(t)?);
        kept.push_back((t, frame.clone()));
        if kept.len() > KEPT_FRAMES {
            kept.pop_front();
        }
        Ok(frame)
    }
}

/// Puts a strand of a sequence of one frame at `start`; `own`: the sequence is of the frame that is made.
fn put_strand(frame: &mut InterchangeFrame, start: usize, sequence: &StrandSequence, strand: usize, own: bool) {
    let range = sequence.range(0, strand);
    let known: Vec<usize> = range.clone().filter(|&at| is_known(sequence, at)).collect();
    for (to, at) in (start..).zip(range) {
        let nearest = known.iter().copied().min_by_key(|k| k.abs_diff(at)).unwrap_or(at);
        frame.points[to] = sequence.points[nearest];
        if nearest == at && own {
            frame.provenance[to] = sequence.provenance[at];
            frame.confidence[to] = finite(sequence.confidence[at]);
        }
    }
}

/// One bit a strand.
struct Bits(Vec<u64>);

impl Bits {
    fn new(len: usize) -> Self {
        Self(vec![0; len.div_ceil(64)])
    }

    fn set(&mut self, at: usize) {
        self.0[at / 64] |= 1 << (at % 64);
    }

    fn get(&self, at: usize) -> bool {
        self.0[at / 64] >> (at % 64) & 1 == 1
    }
}

fn is_known(sequence: &StrandSequence, at: usize) -> bool {
    sequence.valid(at) && sequence.points[at].is_finite()
}

fn finite(x: f32) -> f32 {
    if x.is_finite() { x } else { 0.0 }
}

/// The Python interpreter with the foreign readers: `STRANDFLOW_PYTHON`, else the one on the path.
#[cfg(test)]
pub(crate) fn python() -> std::ffi::OsString {
    std::env::var_os("STRANDFLOW_PYTHON").unwrap_or_else(|| "python3".into())
}

/// What a script says that gets a path as its argument; `None`, with a line that says so, where Python or the foreign reader
/// is not installed.
#[cfg(test)]
pub(crate) fn ask_python(script: &str, path: &std::path::Path) -> Option<String> {
    let Ok(out) = std::process::Command::new(python()).args(["-c", script]).arg(path).output() else {
        println!("skipped: no Python 3");
        return None;
    };
    let errors = String::from_utf8_lossy(&out.stderr);
    if errors.contains("No module named") {
        println!("skipped: {}", errors.trim().lines().last().unwrap_or_default());
        return None;
    }
    assert!(out.status.success(), "{}: {errors}", path.display());
    Some(String::from_utf8_lossy(&out.stdout).into_owned())
}

/// A small sequence with a short strand, an absent one, gaps in a strand and gaps in time, for the tests of the formats.
#[cfg(test)]
pub(crate) fn sample() -> StrandSequence {
    let mut sequence = StrandSequence::missing(vec![4, 5, 6], vec![5, 0, 3, 4], 5);
    for t in 0..3 {
        for n in [0usize, 2, 3] {
            for (p, at) in sequence.range(t, n).enumerate() {
                if (t == 1 && n == 2) || (t == 2 && n == 0 && (p == 2 || p == 4)) {
                    continue;
                }
                sequence.points[at] = Vec3::new(n as f32 * 10.0, t as f32 + 0.5, -5.0 * p as f32);
                sequence.provenance[at] = Provenance::from_number(1 + (p % 4) as u8);
                sequence.confidence[at] = 0.25 * (p % 4) as f32;
            }
        }
    }
    sequence
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_filled_and_marked() {
        let sequence = sample();
        let interchange = Interchange::new(&sequence).unwrap();
        assert_eq!(
            (interchange.strands.as_slice(), interchange.counts().as_slice()),
            ([0, 2, 3].as_slice(), [5, 3, 4].as_slice())
        );
        for t in 0..3 {
            let frame = interchange.frame(t).unwrap();
            assert_eq!(frame.points.len(), 12);
            assert!(frame.points.iter().all(|p| p.is_finite()));
        }
        // Particle 4 of strand 0 in the last frame stands at particle 3; strand 2 in the middle frame stands as before.
        let (middle, last) = (interchange.frame(1).unwrap(), interchange.frame(2).unwrap());
        assert_eq!(
            (last.points[4], last.provenance[4], last.confidence[4]),
            (last.points[3], Provenance::Missing, 0.0)
        );
        assert_eq!(middle.points[5..8], interchange.frame(0).unwrap().points[5..8]);
        assert_eq!(middle.provenance[5..8], [Provenance::Missing; 3]);
        assert_eq!(middle.provenance[0], Provenance::Observed);
    }
}
