//! Lengths of strands over time, added frame by frame, so that a take of any length needs the memory of one frame.

use glam::Vec3;
use strandflow_geometry::polyline;

/// Length \[mm\] of what a frame has of a strand; `None` with fewer than two points. Gaps are bridged.
pub fn present_length(points: &[Vec3]) -> Option<f64> {
    let present: Vec<Vec3> = points.iter().copied().filter(|p| p.is_finite()).collect();
    (present.len() > 1).then(|| f64::from(polyline::length(&present)))
}

/// How much the lengths of strands vary.
#[derive(Clone, Debug, PartialEq)]
pub struct LengthVariation(Vec<Running>);

/// Mean and sum of squared deviations so far (Welford).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Running {
    count: f64,
    mean: f64,
    squares: f64,
}

impl LengthVariation {
    /// Of so many strands, nothing added yet.
    pub fn new(strands: usize) -> Self {
        Self(vec![Running::default(); strands])
    }

    /// Adds a length of a strand \[mm\].
    pub fn add(&mut self, strand: usize, length: f64) {
        let Some(running) = self.0.get_mut(strand) else { return };
        running.count += 1.0;
        let before = length - running.mean;
        running.mean += before / running.count;
        running.squares += before * (length - running.mean);
    }

    /// Standard deviation over mean of each strand that three or more frames have.
    pub fn shares(&self) -> Vec<f64> {
        let enough = self.0.iter().filter(|r| r.count >= 3.0 && r.mean > 0.0);
        enough.map(|r| (r.squares / r.count).max(0.0).sqrt() / r.mean).collect()
    }
}

#[cfg(test)]
mod tests {
    use strandflow_core::StrandSequence;

    use super::*;
    use crate::dynamics::length_variation;

    #[test]
    fn as_the_whole_sequence_has_it() {
        let mut sequence = StrandSequence::missing(vec![0, 1, 2, 3], vec![3, 3], 3);
        for t in 0..4 {
            let range = sequence.range(t, 0);
            for (k, at) in range.enumerate().filter(|(k, _)| (t, *k) != (2, 1)) {
                sequence.points[at] = Vec3::X * (k as f32) * (10.0 + t as f32);
            }
        }
        let mut added = LengthVariation::new(2);
        (0..4).filter_map(|t| present_length(sequence.strand(t, 0))).for_each(|length| added.add(0, length));
        let whole = length_variation(&sequence, 0, 0..4).unwrap();
        let [share] = added.shares()[..] else { panic!("one strand has lengths") };
        assert!((share - whole).abs() < 1e-12 && share > 0.05, "{share} and {whole}");
    }
}
