//! What the strands of all frames tell, gathered in one pass: a frame is in memory at a time, never the take.

use glam::Vec3;
use strandflow_core::{FrameRange, RigidTransform, StrandSequence};
use strandflow_engine::store::Store;
use strandflow_eval::{
    lengths::{LengthVariation, present_length},
    spectrum::{MeanSpectrum, Spectrum},
    statistics::evenly,
};

use super::{opened::Opened, percent};

/// Stages whose strands keep their numbers over time, in order.
const STAGES: [&str; 3] = ["smooth", "fit", "blend"];
/// Strands whose lengths are drawn over time.
const LONGEST: usize = 12;
/// Strands whose spectra are taken, evenly chosen; fewer and the mean is that of a few.
const SAMPLED: usize = 600;
/// Frames of a spectrum: at 100 frames a second, down to 1.6 Hz. A shorter take is one window.
const WINDOW: usize = 64;
/// Below this many frames a spectrum has no more than three frequencies.
const LEAST_WINDOW: usize = 8;

/// One stage over all frames.
pub struct StageMotion {
    /// The stage.
    pub stage: &'static str,
    /// Points by provenance number in each frame of the take; all zero where the frame is not there.
    pub provenance: Vec<[usize; 5]>,
    /// Strands with two or more points, on the mean over the frames that are there.
    pub strands: f64,
    /// Length of each of the longest strands in each frame \[mm\]; NaN where it is not there.
    pub longest: Vec<Vec<f64>>,
    /// Standard deviation over mean of every strand's length.
    pub variation: Vec<f64>,
    /// Mean power of the sampled points' positions in head space.
    pub spectrum: Option<Spectrum>,
}

/// The strands of a take over time.
pub struct Motion {
    /// The frames.
    pub frames: FrameRange,
    /// The stages that are there, in order.
    pub stages: Vec<StageMotion>,
    /// Roots, that is strands the take could have.
    pub roots: usize,
    /// Series of positions that each spectrum rests on.
    pub series: usize,
}

impl Motion {
    /// Reads all strands; `None` before stage `smooth` is there. A frame that cannot be read counts as absent.
    pub fn of(take: &Opened) -> Option<Self> {
        let (store, frames) = (take.store()?, take.frames()?);
        let first = take.last_run()?.lead.start;
        let there = |stage: &&str| (frames.start..frames.end).any(|frame| take.has_strands(stage, frame));
        let stages: Vec<&'static str> = STAGES.into_iter().filter(there).collect();
        let counts = store.read_sequence_part(stages.first()?, one(frames.start), 0..roots(store)?).ok()?.counts;
        let window = frames.len().min(WINDOW);
        let samples = samples(&counts);
        let mut gathered: Vec<Gathered> =
            stages.iter().map(|_| Gathered::new(&counts, frames.len(), window, 1.0 / take.manifest().fps)).collect();
        for frame in frames.start..frames.end {
            let pose = store.read_pose(frame - first.min(frame)).ok().map(|pose| pose.inverse());
            for (stage, gathered) in stages.iter().zip(&mut gathered) {
                let strands = take
                    .has_strands(stage, frame)
                    .then(|| store.read_sequence_part(stage, one(frame), 0..counts.len()));
                gathered.add(strands.and_then(Result::ok).as_ref(), frame - frames.start, pose.as_ref(), &samples);
            }
            close_window(&mut gathered, window);
        }
        let series = gathered.first().map_or(0, |g| g.spectrum.count());
        let stages = stages.into_iter().zip(gathered).map(|(stage, gathered)| gathered.finish(stage)).collect();
        Some(Self { frames, stages, roots: counts.len(), series })
    }

    /// The last stage that is there.
    pub fn last(&self) -> Option<&StageMotion> {
        self.stages.last()
    }

    /// Strands and provenance in words.
    pub fn in_words(&self) -> Vec<String> {
        let mut said = Vec::new();
        for stage in &self.stages {
            let share = percent(stage.strands / self.roots.max(1) as f64);
            let (stage, strands) = (stage.stage, stage.strands);
            said.push(format!(
                "After {stage}: {strands:.0} of {} strands in a frame on the mean, {share}.",
                self.roots
            ));
        }
        if let Some(last) = self.last() {
            let [observed, diffused, simulated, completed] = last.shares();
            said.push(format!(
                "Of the points after {}, {} were observed, {} took their direction from around them, {} come from the \
                 simulation, {} from neighbouring strands.",
                last.stage,
                percent(observed),
                percent(diffused),
                percent(simulated),
                percent(completed)
            ));
        }
        said
    }
}

impl StageMotion {
    /// Shares of observed, diffused, simulated and completed points over all frames.
    pub fn shares(&self) -> [f64; 4] {
        let sum = |kind: usize| self.provenance.iter().map(|p| p[kind]).sum::<usize>() as f64;
        let all: f64 = (1..5).map(sum).sum();
        [1, 2, 3, 4].map(|kind| if all > 0.0 { sum(kind) / all } else { 0.0 })
    }
}

/// A strand and a particle of it, whose way is looked at.
type Sample = (usize, usize);

/// The middle and the tip of evenly chosen strands.
fn samples(counts: &[u16]) -> Vec<Sample> {
    let usable: Vec<usize> = (0..counts.len()).filter(|n| counts[*n] > 5).collect();
    let of_strand = |n: usize| [usize::from(counts[n]) / 2, usize::from(counts[n]) - 1].map(|particle| (n, particle));
    evenly(usable.len(), SAMPLED).into_iter().flat_map(|i| of_strand(usable[i])).collect()
}

/// What is gathered of one stage.
struct Gathered {
    provenance: Vec<[usize; 5]>,
    strands: usize,
    longest: Vec<(usize, Vec<f64>)>,
    variation: LengthVariation,
    spectrum: MeanSpectrum,
    /// Positions of the samples in head space since the window began, by frame.
    ways: Vec<Vec<Vec3>>,
}

impl Gathered {
    fn new(counts: &[u16], frames: usize, window: usize, frame_secs: f64) -> Self {
        let mut order: Vec<usize> = (0..counts.len()).collect();
        order.sort_by_key(|n| (std::cmp::Reverse(counts[*n]), *n));
        order.truncate(LONGEST);
        Self {
            provenance: vec![[0; 5]; frames],
            strands: 0,
            longest: order.into_iter().map(|n| (n, vec![f64::NAN; frames])).collect(),
            variation: LengthVariation::new(counts.len()),
            spectrum: MeanSpectrum::new(window, frame_secs),
            ways: Vec::new(),
        }
    }

    /// Adds a frame; `strands` is absent where the frame is.
    fn add(&mut self, strands: Option<&StrandSequence>, t: usize, head: Option<&RigidTransform>, samples: &[Sample]) {
        let Some(strands) = strands else {
            return self.ways.push(vec![Vec3::NAN; samples.len()]);
        };
        for n in 0..strands.strand_count {
            strands.range(0, n).for_each(|at| self.provenance[t][strands.provenance[at] as usize] += 1);
            if let Some(length) = present_length(strands.strand(0, n)) {
                self.strands += 1;
                self.variation.add(n, length);
                self.longest.iter_mut().filter(|(strand, _)| *strand == n).for_each(|(_, lengths)| lengths[t] = length);
            }
        }
        let in_head = |(n, particle): &Sample| {
            let point = strands.strand(0, *n).get(*particle).copied().unwrap_or(Vec3::NAN);
            head.map_or(Vec3::NAN, |head_from_world| head_from_world.point(point.as_dvec3()).as_vec3())
        };
        self.ways.push(samples.iter().map(in_head).collect());
    }

    fn finish(self, stage: &'static str) -> StageMotion {
        let frames = self.provenance.iter().filter(|counts| counts.iter().any(|n| *n > 0)).count();
        StageMotion {
            stage,
            strands: self.strands as f64 / frames.max(1) as f64,
            provenance: self.provenance,
            longest: self.longest.into_iter().map(|(_, lengths)| lengths).collect(),
            variation: self.variation.shares(),
            spectrum: self.spectrum.mean(),
        }
    }
}

/// At the end of a window, takes the spectra of the points that all stages have in all its frames, so that the stages are
/// compared on the same points.
fn close_window(stages: &mut [Gathered], window: usize) {
    if stages.iter().any(|stage| stage.ways.len() < window) {
        return;
    }
    let samples = stages.first().and_then(|stage| stage.ways.first()).map_or(0, Vec::len);
    for i in (0..samples).filter(|_| window >= LEAST_WINDOW) {
        let whole = stages.iter().all(|stage| stage.ways.iter().all(|points| points[i].is_finite()));
        for stage in stages.iter_mut().filter(|_| whole) {
            let series: Vec<Vec3> = stage.ways.iter().map(|points| points[i]).collect();
            stage.spectrum.add(&series);
        }
    }
    stages.iter_mut().for_each(|stage| stage.ways.clear());
}

fn one(frame: usize) -> FrameRange {
    FrameRange { start: frame, end: frame + 1 }
}

fn roots(store: &Store) -> Option<usize> {
    store.shape("scalp/roots").ok().map(|shape| shape[0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use strandflow_core::Provenance;

    /// Strands along x of 10 mm edges; strand 1 lacks its tip.
    fn frame(counts: Vec<u16>) -> StrandSequence {
        let mut sequence = StrandSequence::missing(vec![0], counts, 8);
        for n in 0..sequence.strand_count {
            for (k, at) in sequence.range(0, n).enumerate().filter(|(k, _)| (n, *k) != (1, 5)) {
                sequence.points[at] = Vec3::X * 10.0 * k as f32;
                sequence.provenance[at] = if n == 0 { Provenance::Observed } else { Provenance::Completed };
            }
        }
        sequence
    }

    #[test]
    fn stages_are_compared_on_points_that_all_have() {
        let counts = [6, 6, 0];
        let samples = samples(&counts);
        assert_eq!(samples, [(0, 3), (0, 5), (1, 3), (1, 5)]);
        let mut stages = [0, 1].map(|_| Gathered::new(&counts, 16, 8, 0.01));
        let strands = frame(counts.to_vec());
        for t in 0..16 {
            let lacks_second = (t < 12).then_some(&strands);
            stages[0].add(Some(&strands), t, Some(&RigidTransform::IDENTITY), &samples);
            stages[1].add(lacks_second, t, Some(&RigidTransform::IDENTITY), &samples);
            close_window(&mut stages, 8);
        }
        // Of the first window three of the four points are whole in both stages, of the second none.
        assert_eq!(stages.each_ref().map(|stage| stage.spectrum.count()), [3, 3]);
        let [_, second] = stages.map(|stage| stage.finish("fit"));
        assert_eq!((second.strands, second.longest[0][0], second.longest[1][0]), (2.0, 50.0, 40.0));
        assert!(second.longest[0][12].is_nan() && second.variation.iter().all(|v| *v < 1e-9));
        assert_eq!((second.provenance[0], second.provenance[12]), ([1, 6, 0, 0, 5], [0; 5]));
        assert!((second.shares()[0] - 6.0 / 11.0).abs() < 1e-12);
    }
}
