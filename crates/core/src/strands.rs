//! Strands of one frame, and sequences of strands with a fixed topology. Root first.

use glam::Vec3;

use crate::Provenance;

/// The strands of one frame, ragged.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Strands {
    /// Points of all strands, root first, world \[mm\].
    pub points: Vec<Vec3>,
    /// Where each strand starts in `points`; strand_count + 1 entries.
    pub offsets: Vec<u32>,
    /// How each point came to be; as long as `points`.
    pub provenance: Vec<Provenance>,
    /// Trust in each point, 0 to 1; as long as `points`.
    pub confidence: Vec<f32>,
}

impl Strands {
    /// No strands; ready for `push`.
    pub fn new() -> Self {
        Self { offsets: vec![0], ..Self::default() }
    }

    /// Number of strands, empty ones included.
    pub fn strand_count(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// The range of a strand's points.
    pub fn range(&self, strand: usize) -> std::ops::Range<usize> {
        self.offsets[strand] as usize..self.offsets[strand + 1] as usize
    }

    /// The points of a strand.
    pub fn strand(&self, strand: usize) -> &[Vec3] {
        &self.points[self.range(strand)]
    }

    /// Adds a strand; an empty one keeps its number.
    pub fn push(&mut self, points: &[Vec3], provenance: &[Provenance], confidence: &[f32]) {
        debug_assert!(points.len() == provenance.len() && points.len() == confidence.len());
        if self.offsets.is_empty() {
            self.offsets.push(0);
        }
        self.points.extend_from_slice(points);
        self.provenance.extend_from_slice(provenance);
        self.confidence.extend_from_slice(confidence);
        self.offsets.push(self.points.len() as u32);
    }
}

/// Strands of fixed topology over time. Sample (t, n, p) is at index (t · strand_count + n) · point_count + p.
///
/// A strand has `counts[n]` ≤ `point_count` particles in every frame. Samples at or past that count, and samples that a
/// frame does not have, carry `Provenance::Missing`; their positions are NaN.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StrandSequence {
    /// Frame numbers; their count is T.
    pub frames: Vec<u32>,
    /// N.
    pub strand_count: usize,
    /// P, the largest particle count.
    pub point_count: usize,
    /// Particles of each strand, length N (0: the strand is absent).
    pub counts: Vec<u16>,
    /// World positions \[mm\], shape (T, N, P).
    pub points: Vec<Vec3>,
    /// Shape (T, N, P).
    pub provenance: Vec<Provenance>,
    /// Trust 0 to 1, shape (T, N, P).
    pub confidence: Vec<f32>,
}

impl StrandSequence {
    /// A sequence in which every sample is missing.
    pub fn missing(frames: Vec<u32>, counts: Vec<u16>, point_count: usize) -> Self {
        let len = frames.len() * counts.len() * point_count;
        Self {
            frames,
            strand_count: counts.len(),
            point_count,
            counts,
            points: vec![Vec3::NAN; len],
            provenance: vec![Provenance::Missing; len],
            confidence: vec![0.0; len],
        }
    }

    /// T.
    pub fn frame_count(&self) -> usize {
        self.frames.len()
    }

    /// Index range of a strand's particles (up to its count) in the `t`-th frame.
    pub fn range(&self, t: usize, strand: usize) -> std::ops::Range<usize> {
        let start = (t * self.strand_count + strand) * self.point_count;
        start..start + self.counts[strand] as usize
    }

    /// The particles of a strand in the `t`-th frame.
    pub fn strand(&self, t: usize, strand: usize) -> &[Vec3] {
        &self.points[self.range(t, strand)]
    }

    /// Whether a sample is present.
    pub fn valid(&self, index: usize) -> bool {
        self.provenance[index] != Provenance::Missing
    }
}
