//! The truth of a synthetic capture, a frame at a time, and how far points are from it.

use std::{
    collections::VecDeque,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
};

use glam::Vec3;
use strandflow_core::{FrameRange, Provenance};
use strandflow_eval::{
    TruthError,
    index::{SampleIndex, StrandSample, sample_polyline},
    truth,
};
use strandflow_view::Refusal;

use super::{
    parts::Part,
    sets::{Kind, Set, TRUTH},
};
use crate::failure::Failed;

/// Farthest distance that is looked for \[mm\]: what is farther off is given as this. Hair a hand's breadth off is wrong
/// either way, and a search without an end is slow.
pub const FARTHEST_MM: f32 = 50.0;
/// Spacing of the samples by which the nearest strand is found \[mm\]; distances are those to its segments.
const SPACING_MM: f32 = 4.0;
/// Frames kept in memory: the one shown, its neighbours, and one to come.
const KEPT: usize = 4;

/// True strands, read when they are asked for.
pub struct TruthFrames {
    folder: PathBuf,
    set: Set,
    kept: Mutex<VecDeque<(usize, Arc<TrueFrame>)>>,
}

/// The true strands of a frame, ready for distances.
pub struct TrueFrame {
    points: Vec<Vec3>,
    offsets: Vec<u32>,
    index: SampleIndex,
}

impl TruthFrames {
    /// Looks at the first frame.
    ///
    /// # Errors
    /// Bad input where the folder holds no truth.
    pub fn open(folder: &Path) -> Result<Self, Failed> {
        let hint = "give the gt/ folder of a capture that `strandflow synth` made, with strands_000000.npz and on";
        let wrong = |error: TruthError| Failed::input(error.to_string(), hint);
        let frames = truth::frames(folder).map_err(wrong)?;
        let (first, last) = (frames[0] as usize, frames[frames.len() - 1] as usize);
        let (_, offsets) = truth::read_strands(folder, frames[0]).map_err(wrong)?;
        let set = Set {
            id: TRUTH.to_owned(),
            kind: Kind::Truth,
            strands: offsets.len().saturating_sub(1),
            points: offsets.windows(2).map(|o| (o[1] - o[0]) as usize).max().unwrap_or(0),
            frames: FrameRange { start: first, end: last + 1 },
        };
        Ok(Self { folder: folder.to_owned(), set, kept: Mutex::default() })
    }

    /// The true strands as a set.
    pub fn set(&self) -> Set {
        self.set.clone()
    }

    /// All strands of a frame as one block.
    ///
    /// # Errors
    /// The file cannot be read or has other strands than the first.
    pub fn part(&self, frame: usize) -> Result<Part, Refusal> {
        let (points, offsets) = self.strands(frame)?;
        let (width, size) = (self.set.points, self.set.points * self.set.strands);
        let mut part = Part {
            first: 0,
            width,
            points: vec![Vec3::NAN; size],
            provenance: vec![Provenance::Missing as u8; size],
            confidence: vec![0; size],
        };
        for (n, ends) in offsets.windows(2).enumerate() {
            for (k, point) in points[ends[0] as usize..ends[1] as usize].iter().enumerate() {
                part.points[n * width + k] = *point;
                (part.provenance[n * width + k], part.confidence[n * width + k]) = (Provenance::Observed as u8, 255);
            }
        }
        Ok(part)
    }

    /// The true strands of a frame; `None` where the truth does not have it.
    ///
    /// # Errors
    /// As [`TruthFrames::part`].
    pub fn frame(&self, frame: usize) -> Result<Option<Arc<TrueFrame>>, Refusal> {
        if !self.set.frames.contains(frame) {
            return Ok(None);
        }
        // Held while reading, so that requests for the same frame do not all read it.
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = kept.iter().position(|(known, _)| *known == frame) {
            let found = kept.remove(at);
            kept.extend(found);
        } else {
            let (points, offsets) = self.strands(frame)?;
            kept.push_back((frame, Arc::new(TrueFrame::new(points, offsets))));
            while kept.len() > KEPT {
                kept.pop_front();
            }
        }
        Ok(kept.back().map(|(_, found)| found.clone()))
    }

    /// The true points of a frame and where each strand begins.
    fn strands(&self, frame: usize) -> Result<(Vec<Vec3>, Vec<u32>), Refusal> {
        let hint = "make the capture again, or leave --truth away";
        let read = truth::read_strands(&self.folder, frame as u32);
        let (points, offsets) = read.map_err(|error| Refusal::broken(error.to_string(), hint))?;
        let fits = offsets.len() == self.set.strands + 1
            && offsets.windows(2).all(|ends| (ends[1] - ends[0]) as usize <= self.set.points);
        if fits {
            Ok((points, offsets))
        } else {
            Err(Refusal::broken(format!("truth, frame {frame}: other strands than in the first"), hint))
        }
    }

    /// Mean distance \[mm\] of a few points to the true strands of a frame, without an index; `None` where the truth does not
    /// have the frame or no point is finite.
    ///
    /// # Errors
    /// As [`TruthFrames::part`].
    pub fn mean_distance(&self, frame: usize, points: &[Vec3]) -> Result<Option<f64>, Refusal> {
        if !self.set.frames.contains(frame) || !points.iter().any(|p| p.is_finite()) {
            return Ok(None);
        }
        let (truth, offsets) = self.strands(frame)?;
        let mut squares: Vec<(Vec3, f32)> =
            points.iter().filter(|p| p.is_finite()).map(|p| (*p, FARTHEST_MM * FARTHEST_MM)).collect();
        for ends in offsets.windows(2) {
            for pair in truth[ends[0] as usize..ends[1] as usize].windows(2) {
                squares.iter_mut().for_each(|(p, least)| *least = least.min(to_segment_squared(*p, pair[0], pair[1])));
            }
        }
        let sum: f64 = squares.iter().map(|(_, square)| f64::from(square.sqrt())).sum();
        Ok(Some(sum / squares.len() as f64))
    }
}

impl TrueFrame {
    fn new(points: Vec<Vec3>, offsets: Vec<u32>) -> Self {
        let mut samples = Vec::new();
        for (n, ends) in offsets.windows(2).enumerate() {
            sample_polyline(&points[ends[0] as usize..ends[1] as usize], n as u32, SPACING_MM, &mut samples);
        }
        let index = SampleIndex::new(&samples, SPACING_MM);
        Self { points, offsets, index }
    }

    /// Distance of each point of a strand to the nearest true strand \[mm\], at most [`FARTHEST_MM`]; NaN of points that are
    /// missing. The true strand is that of the nearest sample, so a distance may be too large by less than 2 mm where strands
    /// cross.
    pub fn distances(&self, points: &[Vec3], distances: &mut [f32]) {
        // Neighbours on a strand are about as far off: where the search begins. Too wide a search is most of the work.
        let mut before = 0.0f32;
        for (point, distance) in points.iter().zip(distances) {
            *distance = if point.is_finite() { self.distance(*point, before) } else { f32::NAN };
            before = if point.is_finite() { *distance } else { before };
        }
    }

    /// Distance of a point whose neighbour is `before` away.
    fn distance(&self, point: Vec3, before: f32) -> f32 {
        let mut radius = (0.7 * before).clamp(SPACING_MM, FARTHEST_MM);
        let (sample, squared) = loop {
            let mut best: Option<(StrandSample, f32)> = None;
            self.index.within(point, radius, |sample, squared| {
                if best.is_none_or(|(_, least)| squared < least) {
                    best = Some((*sample, squared));
                }
                true
            });
            match best {
                Some(best) => break best,
                None if radius >= FARTHEST_MM => return FARTHEST_MM,
                None => radius = (radius * 1.4).min(FARTHEST_MM),
            }
        };
        let n = sample.strand as usize;
        let strand = &self.points[self.offsets[n] as usize..self.offsets[n + 1] as usize];
        let at = sample.parameter as usize;
        let (first, last) = (at.saturating_sub(1), (at + 2).min(strand.len().saturating_sub(1)));
        let near = strand[first..=last].windows(2).map(|pair| to_segment_squared(point, pair[0], pair[1]));
        near.fold(squared, f32::min).sqrt()
    }
}

fn to_segment_squared(point: Vec3, a: Vec3, b: Vec3) -> f32 {
    let (along, to) = (b - a, point - a);
    let part = (to.dot(along) / along.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
    to.distance_squared(along * part)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_to_segments() {
        let points: Vec<Vec3> =
            [[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [0.0, 30.0, 0.0], [0.0, 30.0, 90.0]].map(Vec3::from_array).to_vec();
        let truth = TrueFrame::new(points, vec![0, 2, 4]);
        let cases = [
            ([51.3, 3.0, 4.0], 5.0),
            ([-3.0, 0.0, -4.0], 5.0),
            ([0.0, 28.0, 47.1], 2.0),
            ([50.0, 49.0, 0.0], 49.0),
            ([50.0, 900.0, 0.0], FARTHEST_MM),
        ];
        let mut points: Vec<Vec3> = cases.iter().map(|(point, _)| Vec3::from_array(*point)).collect();
        points.insert(2, Vec3::NAN);
        let mut found = vec![0.0; points.len()];
        truth.distances(&points, &mut found);
        assert!(found.remove(2).is_nan());
        for ((point, expected), found) in cases.iter().zip(found) {
            assert!((found - expected).abs() < 1e-4, "{point:?}: {found} instead of {expected}");
        }
    }
}
