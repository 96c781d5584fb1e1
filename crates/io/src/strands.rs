//! Strands in the formats of other programs.
//!
//! | ending | format | what is written |
//! |---|---|---|
//! | `.npz` | NumPy archive (`npz`) | the whole sequence as it is, missing samples as NaN |
//! | `.ply` | polygon file, binary (`ply`) | one frame: points and edges, provenance, confidence |
//! | `.hair` | Cem Yuksel's (`hair`) | one frame |
//! | `.data` | USC's hair (`usc_data`) | one frame |
//! | `.usd`, `.usdc`, `.usda` | animated USD (`crate::usd`) | all frames, constant topology |
//!
//! All but `.npz` hold no missing points: see [`Interchange`].

use glam::Vec3;
use strandflow_core::{Provenance, StrandSequence};

pub mod hair;
pub mod npy;
pub mod npz;
pub mod ply;
pub mod usc_data;

/// A sequence as programs without a notion of missing points take it: the same strands with the same particles in every
/// frame, every position a number.
///
/// A strand takes part if it has two particles or more and a position anywhere in time. A particle that a frame lacks
/// stands at the strand's nearest particle that the frame has; a strand that a frame lacks stands as in the nearest frame
/// that has it. Such points are marked `Missing` with confidence 0.
pub struct Interchange<'a> {
    sequence: &'a StrandSequence,
    /// The numbers of the strands that take part, rising.
    pub strands: Vec<u32>,
}

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
    /// The strands of a sequence that take part.
    pub fn new(sequence: &'a StrandSequence) -> Self {
        let somewhere = |n: usize| (0..sequence.frame_count()).any(|t| present(sequence, t, n));
        let strands = (0..sequence.strand_count).filter(|&n| sequence.counts[n] >= 2 && somewhere(n));
        Self { sequence, strands: strands.map(|n| n as u32).collect() }
    }

    /// Frame numbers.
    pub fn frames(&self) -> &'a [u32] {
        &self.sequence.frames
    }

    /// Particles of each strand that takes part.
    pub fn counts(&self) -> Vec<u32> {
        self.strands.iter().map(|&n| u32::from(self.sequence.counts[n as usize])).collect()
    }

    /// The `t`-th frame.
    pub fn frame(&self, t: usize) -> InterchangeFrame {
        let mut frame = InterchangeFrame::default();
        for &strand in &self.strands {
            self.push_strand(&mut frame, t, strand as usize);
        }
        frame
    }

    fn push_strand(&self, frame: &mut InterchangeFrame, t: usize, strand: usize) {
        let last = self.sequence.frame_count();
        // Frames by distance from t; of two as far, the earlier one.
        let near = (0..last).flat_map(|d| [t.checked_sub(d), Some(t + d).filter(|t| *t < last)]).flatten();
        let Some(source) = { near }.find(|&near| present(self.sequence, near, strand)) else { return };
        let range = self.sequence.range(source, strand);
        let known: Vec<usize> = range.clone().filter(|&at| is_known(self.sequence, at)).collect();
        for at in range {
            let nearest = known.iter().copied().min_by_key(|k| k.abs_diff(at)).unwrap_or(at);
            let seen = nearest == at && source == t;
            frame.points.push(self.sequence.points[nearest]);
            frame.provenance.push(if seen { self.sequence.provenance[at] } else { Provenance::Missing });
            frame.confidence.push(if seen { finite(self.sequence.confidence[at]) } else { 0.0 });
        }
    }
}

fn is_known(sequence: &StrandSequence, at: usize) -> bool {
    sequence.valid(at) && sequence.points[at].is_finite()
}

fn present(sequence: &StrandSequence, t: usize, strand: usize) -> bool {
    sequence.range(t, strand).any(|at| is_known(sequence, at))
}

fn finite(x: f32) -> f32 {
    if x.is_finite() { x } else { 0.0 }
}

/// The Python interpreter with the foreign readers: `STRANDFLOW_PYTHON`, else the one on the path.
#[cfg(test)]
pub(crate) fn python() -> std::ffi::OsString {
    std::env::var_os("STRANDFLOW_PYTHON").unwrap_or_else(|| "python3".into())
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
        let interchange = Interchange::new(&sequence);
        assert_eq!(
            (interchange.strands.as_slice(), interchange.counts().as_slice()),
            ([0, 2, 3].as_slice(), [5, 3, 4].as_slice())
        );
        for t in 0..3 {
            let frame = interchange.frame(t);
            assert_eq!(frame.points.len(), 12);
            assert!(frame.points.iter().all(|p| p.is_finite()));
        }
        // Particle 4 of strand 0 in the last frame stands at particle 3; strand 2 in the middle frame stands as before.
        let (middle, last) = (interchange.frame(1), interchange.frame(2));
        assert_eq!(
            (last.points[4], last.provenance[4], last.confidence[4]),
            (last.points[3], Provenance::Missing, 0.0)
        );
        assert_eq!(middle.points[5..8], interchange.frame(0).points[5..8]);
        assert_eq!(middle.provenance[5..8], [Provenance::Missing; 3]);
        assert_eq!(middle.provenance[0], Provenance::Observed);
    }
}
