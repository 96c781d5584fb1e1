//! The same number of points on every strand, evenly spaced along it.

use strandflow_core::{Provenance, StrandSequence};
use strandflow_geometry::polyline::even_places;

use super::{StrandFrames, is_known};
use crate::IoError;

/// Strands with the same number of points each, evenly spaced along their mean lengths.
///
/// A point is the same place on its strand in every frame: where it stands between two particles is found once, from the
/// lengths of the segments averaged over the frames that have both ends, so points do not slide when a strand stretches or a
/// frame lacks its tip. A point is missing where a particle beside it is; it has the provenance of the nearer particle and
/// the lesser confidence of the two.
pub struct Resampled<'a> {
    source: &'a dyn StrandFrames,
    points: usize,
    counts: Vec<u16>,
    /// Strand by strand, where its points stand: particle and part of the way to the next.
    places: Vec<(u16, f32)>,
}

impl<'a> Resampled<'a> {
    /// `points` (2 at least) on every strand that has two particles; reads every frame once.
    ///
    /// # Errors
    /// A frame cannot be read.
    pub fn new(source: &'a dyn StrandFrames, points: u16) -> Result<Self, IoError> {
        let points = points.max(2);
        let lengths = mean_segments(source)?;
        let counts = source.counts().iter().map(|&count| if count < 2 { 0 } else { points }).collect();
        let mut places = Vec::with_capacity(source.counts().len() * usize::from(points));
        for (n, &count) in source.counts().iter().enumerate() {
            let segments = usize::from(count.max(2)) - 1;
            let start = n * source.point_count();
            let lengths = &lengths[start..(start + segments).min(lengths.len())];
            places.extend(even_places(lengths, points.into()).map(|(segment, part)| (segment as u16, part)));
        }
        Ok(Self { source, points: usize::from(points), counts, places })
    }
}

/// Mean length of each segment over the frames that have both ends, shape (strands, point_count); 0 where none has.
fn mean_segments(source: &dyn StrandFrames) -> Result<Vec<f32>, IoError> {
    let size = source.counts().len() * source.point_count();
    let (mut sums, mut times) = (vec![0.0f32; size], vec![0u32; size]);
    for t in 0..source.frames().len() {
        let frame = source.frame(t)?;
        for n in 0..source.counts().len() {
            let range = frame.range(0, n);
            for at in range.start..range.end.saturating_sub(1) {
                if is_known(&frame, at) && is_known(&frame, at + 1) {
                    sums[at] += frame.points[at].distance(frame.points[at + 1]);
                    times[at] += 1;
                }
            }
        }
    }
    Ok(sums.into_iter().zip(times).map(|(sum, times)| if times > 0 { sum / times as f32 } else { 0.0 }).collect())
}

impl StrandFrames for Resampled<'_> {
    fn frames(&self) -> &[u32] {
        self.source.frames()
    }

    fn counts(&self) -> &[u16] {
        &self.counts
    }

    fn point_count(&self) -> usize {
        self.points
    }

    fn frame(&self, t: usize) -> Result<StrandSequence, IoError> {
        let source = self.source.frame(t)?;
        let mut out = StrandSequence::missing(source.frames.clone(), self.counts.clone(), self.points);
        for n in (0..self.counts.len()).filter(|&n| self.counts[n] > 0) {
            let first = source.range(0, n).start;
            for to in out.range(0, n) {
                let (particle, part) = self.places[to];
                put_point(&mut out, to, &source, first + usize::from(particle), part);
            }
        }
        Ok(out)
    }
}

fn put_point(out: &mut StrandSequence, to: usize, source: &StrandSequence, at: usize, part: f32) {
    // On a particle its neighbour does not matter.
    let (a, b) = match part {
        0.0 => (at, at),
        1.0 => (at + 1, at + 1),
        _ => (at, at + 1),
    };
    if !is_known(source, a) || !is_known(source, b) {
        return;
    }
    out.points[to] = source.points[a].lerp(source.points[b], part);
    out.provenance[to] = source.provenance[if part < 0.5 { a } else { b }];
    out.confidence[to] = source.confidence[a].min(source.confidence[b]);
    debug_assert!(out.provenance[to] != Provenance::Missing);
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::strands::{Interchange, sample};

    #[test]
    fn points_are_even_along_the_strand_and_ends_stay() {
        let mut sequence = sample();
        // Strand 0 runs around a corner with uneven particles: 9 mm down, then 3 mm aside.
        for t in 0..3 {
            for (at, (x, z)) in
                sequence.range(t, 0).zip([(0.0, 0.0), (0.0, -1.0), (0.0, -9.0), (1.0, -9.0), (3.0, -9.0)])
            {
                sequence.points[at] = Vec3::new(x, t as f32, z);
                sequence.provenance[at] = Provenance::Observed;
            }
        }
        let resampled = Resampled::new(&sequence, 5).unwrap();
        let frame = resampled.frame(1).unwrap();
        let expected = [(0.0, 0.0), (0.0, -3.0), (0.0, -6.0), (0.0, -9.0), (3.0, -9.0)];
        for (got, (x, z)) in frame.strand(0, 0).iter().zip(expected) {
            assert!(got.distance(Vec3::new(x, 1.0, z)) < 1e-5, "{got}");
        }
        assert_eq!(resampled.counts(), [5, 0, 5, 5]);
    }

    #[test]
    fn what_is_missing_stays_missing_and_points_do_not_slide() {
        let sequence = sample();
        let resampled = Resampled::new(&sequence, 9).unwrap();
        let (first, last) = (resampled.frame(0).unwrap(), resampled.frame(2).unwrap());
        // The last frame lacks particles 2 and 4 of strand 0: points 3 to 5 and 7 to 8 of nine.
        let known: Vec<bool> = last.range(0, 0).map(|at| last.valid(at)).collect();
        assert_eq!(known, [true, true, true, false, false, false, true, false, false]);
        for at in last.range(0, 0).filter(|&at| last.valid(at)) {
            assert!((first.points[at] + Vec3::Y * 2.0).distance(last.points[at]) < 1e-5);
        }
        let interchange = Interchange::new(&resampled).unwrap();
        assert_eq!((interchange.strands.as_slice(), interchange.counts()), ([0, 2, 3].as_slice(), vec![9; 3]));
        assert!(interchange.frame(1).unwrap().points.iter().all(|p| p.is_finite()));
    }
}
