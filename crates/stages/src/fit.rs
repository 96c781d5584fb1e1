//! Stage 11: every strand's motion explained by a simulation: parameters and averaged simulated positions (eq. 3, 4).
//!
//! Memory is that of a stretch of frames, however long the take ([`stretches`]).

mod evidence;
mod stretches;

use std::ops::Range;

use glam::{DMat4, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use strandflow_core::{Place, Provenance, Report, RigidTransform, StrandSequence};
use strandflow_dynamics::{
    Params,
    refine::{Body, RefineOptions, Refined, Take, Track, refine_stretch},
};

use crate::{Mode, SettingViolation, StageError};
use evidence::Evidence;
pub use stretches::{Stretch, stretches};

/// What one block of strands needs of a stretch of frames.
pub struct FitInput<'a> {
    /// The trimmed sequence of the block.
    pub sequence: &'a StrandSequence,
    /// The head's motion per frame of the sequence.
    pub world_from_head: &'a [RigidTransform],
    /// Gravity \[mm/s²\], world.
    pub gravity: DVec3,
    /// Frame interval \[s\].
    pub frame_secs: f64,
}

/// What was found of each strand of a block.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fitted {
    /// Particles of the strand in every frame; 0 where the strand was given up, or never seen.
    pub counts: Vec<u16>,
    /// Fitted parameters per strand, shape (N, 9): k_edge, k_bend, k_torsion, k_alt \[1/s²\], c_edge, c_bend, c_torsion,
    /// c_alt, drag \[1/s\], per unit mass. Geometric mean over the windows of the last outer pass.
    pub parameters: Vec<[f32; 9]>,
    /// Per strand: root mean square distance of the refined to the given points \[mm\].
    pub residual_mm: Vec<f32>,
    /// Per strand: windows fitted, windows whose last step made nothing better, windows that failed.
    pub windows: Vec<[u16; 3]>,
    /// Per strand: covariance of the logarithms of k_bend, k_torsion, k_alt and drag (the altitudes' and the others' damping
    /// follows their stiffness). NaN without Gauss–Newton and where nothing was fitted.
    pub covariance: Vec<[[f32; 4]; 4]>,
    /// Per strand \[mm\]: root mean square distance to samples of frames that the windows before had not seen, of the simulation
    /// and of velocities kept. NaN where there are none.
    pub held_out_mm: Vec<[f32; 2]>,
}

/// Settings of stage `fit`. Paper mode keeps the counts and takes the letter for the rest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitSettings {
    /// Passes over the whole take. Two are best; more do not hurt, since targets stay the original data.
    pub outer_passes: usize,
    /// Frames that a window predicts, robust mode.
    ///
    /// *Deviation*: paper mode takes five. Strands of real footage err alike over several frames, and six frames leave
    /// less of that in the motion; noise that is independent from frame to frame asks for five (`joint_table`: helix).
    pub window_frames: usize,
    /// σ of the Gaussian aging weights \[frames\]; 1 is bad.
    pub aging_frames: f64,
    /// Simulation steps per frame; five are 2 ms at 100 frames a second.
    pub substeps: usize,
    /// Gauss–Newton steps per window in robust mode; 0 takes the quasi-Newton search of paper mode.
    pub newton_steps: usize,
    /// Steps of the quasi-Newton search per window.
    pub iterations: usize,
    /// Evaluations of value and gradient per window in that search.
    pub evaluations: usize,
    /// Half the range of the log parameters around their start.
    pub log_range: f64,
    /// Weight of Σ (δv / 100 mm/s)² against the mean squared distance \[mm²\].
    pub velocity_prior: f64,
    /// Step of the prox \[s\]; longer gives stiffer strands.
    pub prox_secs: f64,
    /// Step of the prox after a pass \[s\], with edges four times as stiff.
    pub finish_secs: f64,
    /// Edge length where the data are too noisy to tell \[mm\].
    pub edge_mm: f64,
    /// Weight of points whose direction was filled in, against observed ones.
    pub diffused_weight: f64,
}

impl Default for FitSettings {
    fn default() -> Self {
        let options = RefineOptions::default();
        Self {
            outer_passes: options.outer_passes,
            window_frames: options.window_frames,
            aging_frames: options.aging_frames,
            substeps: options.substeps,
            newton_steps: options.newton_steps,
            iterations: options.iterations,
            evaluations: options.evaluations,
            log_range: options.log_range,
            velocity_prior: options.velocity_prior,
            prox_secs: options.prox_secs,
            finish_secs: options.finish_secs,
            edge_mm: options.edge_mm,
            diffused_weight: 0.5,
        }
    }
}

impl FitSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        let mut found = Vec::new();
        let mut count = |field: &str, value: usize, range: std::ops::RangeInclusive<usize>, reason: &str| {
            let text = format!("{}..={}", range.start(), range.end());
            SettingViolation::unless(range.contains(&value), &mut found, (field, value), (&text, reason));
        };
        count("fit.outer_passes", self.outer_passes, 0..=20, "0 keeps the cleaned strands");
        count("fit.window_frames", self.window_frames, 1..=50, "the memory of a window grows with it");
        count("fit.substeps", self.substeps, 1..=50, "five are 2 ms at 100 frames a second");
        count("fit.newton_steps", self.newton_steps, 0..=50, "one comes as far as eight of the quasi-Newton search");
        count("fit.iterations", self.iterations, 1..=200, "eight suffice");
        count("fit.evaluations", self.evaluations, 1..=400, "at least one per iteration is needed");
        let mut real = |field: &str, value: f64, (low, high): (f64, f64), reason: &str| {
            let ok = value >= low && value <= high;
            SettingViolation::unless(ok, &mut found, (field, value), (&format!("{low}..={high}"), reason));
        };
        real("fit.aging_frames", self.aging_frames, (0.5, 1e6), "below, only the first frame counts");
        real("fit.log_range", self.log_range, (0.0, 8.0), "the step becomes singular further out");
        real("fit.velocity_prior", self.velocity_prior, (0.0, 1e6), "a weight");
        real("fit.prox_secs", self.prox_secs, (1e-4, 0.1), "longer steps let gravity win over the data");
        real("fit.finish_secs", self.finish_secs, (1e-4, 0.1), "shorter steps leave the lengths to vary");
        real("fit.edge_mm", self.edge_mm, (0.1, 100.0), "the particle spacing");
        real("fit.diffused_weight", self.diffused_weight, (0.0, 1.0), "a share of an observed point's weight");
        found
    }

    /// The options of the chain in this mode.
    fn options(&self, mode: Mode) -> RefineOptions {
        RefineOptions {
            outer_passes: self.outer_passes,
            window_frames: if mode == Mode::Paper { PAPER_WINDOW_FRAMES } else { self.window_frames },
            aging_frames: self.aging_frames,
            substeps: self.substeps,
            newton_steps: self.newton_steps,
            iterations: self.iterations,
            evaluations: self.evaluations,
            log_range: self.log_range,
            velocity_prior: self.velocity_prior,
            prox_secs: self.prox_secs,
            finish_secs: self.finish_secs,
            edge_mm: self.edge_mm,
            letter: mode == Mode::Paper,
            ..RefineOptions::default()
        }
    }
}

/// Frames of a window as printed (section 5.2).
const PAPER_WINDOW_FRAMES: usize = 5;

/// Trust below which a present point still counts as this much: confidence is a guess.
const LEAST_WEIGHT: f64 = 0.05;

/// Strands that are refined at a time: a few packs for each core of a large machine, while what they hold of a stretch is small.
const GROUP: usize = 128;

/// The fit of one block of strands, a stretch of frames after the other.
///
/// A strand without any usable point stays missing and is reported; everything else that can be wrong with a strand
/// (gaps, jumps, windows that fail) is absorbed and counted in [`Fitted::windows`].
///
/// Reference: Zhang, Wu, Zhang et al. 2012, §5.1–5.2, eq. 3 and 4.
/// *Deviation*: see `strandflow_dynamics::refine`; paper mode follows the letter. Takes of more than one stretch:
/// see [`stretches`].
pub struct BlockFit<'a> {
    first_strand: usize,
    mode: Mode,
    settings: &'a FitSettings,
    options: RefineOptions,
    strands: Vec<Progress>,
}

/// One strand on its way through the stretches.
#[derive(Default)]
struct Progress {
    count: u16,
    /// What the stretches know together of its body; none where there is but one stretch.
    body: Option<Body>,
    evidence: Evidence,
    /// Its way past the settled frames, which the next stretch is to join: shape (frames of a seam, n).
    tail: Vec<DVec3>,
    /// What each stretch found.
    found: Vec<Found>,
    /// Squared distances of the refined to the given points, and how many.
    square: f64,
    given: u32,
}

/// What a stretch found of a strand.
struct Found {
    params: Params,
    /// Fitted, stopped without converging, failed.
    windows: [usize; 3],
    covariance: Option<[[f64; 4]; 4]>,
    held_out_mm: Option<[f64; 2]>,
}

impl Found {
    /// How much it counts.
    fn weight(&self) -> f64 {
        (self.windows[0] + self.windows[1]) as f64
    }
}

impl<'a> BlockFit<'a> {
    /// A block of strands of these particle counts; `first_strand` is its first one's number in the take, for messages.
    pub fn new(first_strand: usize, counts: &[u16], mode: Mode, settings: &'a FitSettings) -> Self {
        let strands = counts.iter().map(|&count| Progress { count, ..Progress::default() }).collect();
        Self { first_strand, mode, settings, options: settings.options(mode), strands }
    }

    /// Looks at the samples of a stretch: rest shape, median shape and noise are those of the whole take. To be called with the
    /// frames that are each stretch's own before the first of several is fitted.
    ///
    /// # Errors
    /// As [`BlockFit::fit`].
    pub fn survey(&mut self, input: &FitInput) -> Result<(), StageError> {
        self.check(input)?;
        let take = take_of(input);
        let seen: Vec<Option<Body>> = (0..self.strands.len())
            .into_par_iter()
            .map(|n| Body::of(&track_of(input.sequence, n, self.settings), &take, &self.options))
            .collect();
        for (strand, seen) in self.strands.iter_mut().zip(seen) {
            strand.body = match (strand.body.take(), seen) {
                (Some(body), Some(seen)) => Some(body.pooled(&seen)),
                (body, seen) => body.or(seen),
            };
        }
        Ok(())
    }

    /// Fits a stretch, of which `input` holds the frames; the stretches must come in their order. Returns the frames that are now
    /// settled; provenance `Simulated` where the frame had no point. After the last stretch strands that are given up have no
    /// particle in it; in frames returned before they are still there.
    ///
    /// # Errors
    /// Frames, head motion and array lengths that do not fit together; a head motion that is not finite.
    pub fn fit(&mut self, input: &FitInput, stretch: &Stretch) -> Result<StrandSequence, StageError> {
        self.check(input)?;
        let take = take_of(input);
        let settled = stretch.settled_places();
        let mut out = frames_of(input.sequence, settled.clone());
        let mut order: Vec<usize> = (0..self.strands.len()).filter(|&n| self.strands[n].count > 0).collect();
        order.sort_by_key(|&n| (self.strands[n].count, n));
        for group in order.chunks(GROUP) {
            let tracks: Vec<Track> = group.iter().map(|&n| track_of(input.sequence, n, self.settings)).collect();
            let bodies: Vec<Option<Body>> = group.iter().map(|&n| self.strands[n].body.clone()).collect();
            let refined = refine_stretch(&tracks, &bodies, &take, &self.options);
            for ((&n, track), refined) in group.iter().zip(&tracks).zip(refined) {
                if let Some(refined) = refined {
                    let ways = self.strands[n].go_on(refined, track, stretch, self.settings);
                    self.strands[n].write(&ways, n, &settled, input.sequence, &mut out, self.settings);
                }
            }
        }
        if stretch.is_last() {
            let given_up = (0..self.strands.len()).filter(|&n| !self.strands[n].stays(self.mode));
            given_up.for_each(|n| remove(&mut out, n));
        }
        Ok(out)
    }

    /// What was found, after the last stretch.
    pub fn finish(self, report: &mut Report) -> Fitted {
        let of = |value: fn(&Progress) -> bool| self.strands.iter().filter(|s| s.count > 0 && value(s)).count();
        let empty = of(|s| s.found.is_empty());
        let given_up = self.strands.iter().filter(|s| !s.found.is_empty() && !s.stays(self.mode)).count();
        let failed: usize = self.strands.iter().map(|s| s.windows()[2]).sum();
        if empty + failed + given_up > 0 {
            let fact = format!(
                "{empty} strands without a usable point, {given_up} strands that no simulation explains, {failed} windows failed"
            );
            let place = Place { strand: Some(self.first_strand), ..Place::default() };
            report.warn(
                place,
                fact,
                "those strands are left to stage blend to complete; failed windows keep the cleaned positions",
            );
        }
        let mut out = Fitted::default();
        for strand in &self.strands {
            let stays = strand.stays(self.mode);
            let residual = if stays { (strand.square / f64::from(strand.given.max(1))).sqrt() } else { 0.0 };
            out.counts.push(if stays { strand.count } else { 0 });
            out.parameters.push(strand.params(&self.options).to_array().map(|p| p as f32));
            out.residual_mm.push(residual as f32);
            out.windows.push(strand.windows().map(|w| w.min(u16::MAX.into()) as u16));
            out.covariance.push(strand.covariance().to_cols_array_2d().map(|row| row.map(|c| c as f32)));
            out.held_out_mm.push(strand.held_out_mm().map(|d| d as f32));
        }
        out
    }
}

impl Progress {
    /// Takes up a refined stretch, joined to the one before over their seam: the strand's way over the settled frames.
    fn go_on(&mut self, refined: Refined, track: &Track, stretch: &Stretch, settings: &FitSettings) -> Vec<DVec3> {
        let n = track.particle_count;
        let Refined { mut points, params, windows, covariance, held_out_mm, .. } = refined;
        let settled = stretch.settled_places();
        stretches::join(&self.tail, &mut points[settled.start * n..], n);
        self.tail = points[settled.end * n..].iter().take(stretches::SEAM * n).copied().collect();
        self.found.push(Found { params, windows, covariance, held_out_mm });
        for t in settled.clone() {
            let at = t * n..(t + 1) * n;
            self.evidence.add(&points[at.clone()], &track.points[at.clone()], &track.weights[at], settings);
        }
        points.truncate(settled.end * n);
        points.drain(..settled.start * n);
        points
    }

    /// Writes the strand's way over the settled frames.
    fn write(
        &mut self,
        way: &[DVec3],
        strand: usize,
        settled: &Range<usize>,
        given: &StrandSequence,
        out: &mut StrandSequence,
        settings: &FitSettings,
    ) {
        let points = mended(way, self.count.into(), settings);
        let from = settled.clone().flat_map(|t| given.range(t, strand));
        let to: Vec<usize> = (0..settled.len()).flat_map(|t| out.range(t, strand)).collect();
        for ((e, o), point) in from.zip(to).zip(points) {
            out.points[o] = point.as_vec3();
            if given.valid(e) && given.points[e].is_finite() {
                self.square += given.points[e].as_dvec3().distance_squared(point);
                self.given += 1;
            } else {
                out.provenance[o] = Provenance::Simulated;
                out.confidence[o] = 0.0;
            }
        }
    }

    /// Windows of all stretches: fitted, stopped without converging, failed.
    fn windows(&self) -> [usize; 3] {
        std::array::from_fn(|k| self.found.iter().map(|found| found.windows[k]).sum())
    }

    /// The geometric mean of the stretches' parameters, by their windows.
    fn params(&self, options: &RefineOptions) -> Params {
        let (mut sum, mut total) = ([0.0; 6], 0.0);
        match &self.found[..] {
            [] => return options.start,
            [found] => return found.params,
            _ => {}
        }
        for found in &self.found {
            let weight = found.weight();
            found.params.to_log().iter().zip(&mut sum).for_each(|(p, sum)| *sum += weight * p);
            total += weight;
        }
        if total > 0.0 { Params::from_log(&sum.map(|s| s / total)) } else { options.start }
    }

    /// The stretches' covariances together: what each knows adds up. NaN where there is none.
    fn covariance(&self) -> DMat4 {
        let each: Vec<DMat4> =
            self.found.iter().filter_map(|found| found.covariance).map(|c| DMat4::from_cols_array_2d(&c)).collect();
        match &each[..] {
            [] => DMat4::NAN,
            [covariance] => *covariance,
            _ => each.iter().map(DMat4::inverse).sum::<DMat4>().inverse(),
        }
    }

    /// The stretches' errors on frames held out, by their windows. NaN where there are none.
    fn held_out_mm(&self) -> [f64; 2] {
        let (mut squares, mut total) = ([0.0; 2], 0.0);
        for (found, errors) in self.found.iter().filter_map(|found| Some((found, found.held_out_mm?))) {
            squares.iter_mut().zip(errors).for_each(|(sum, error)| *sum += found.weight() * error * error);
            total += found.weight();
        }
        squares.map(|sum| if total > 0.0 { (sum / total).sqrt() } else { f64::NAN })
    }

    /// Whether the refined strand can be passed on.
    fn stays(&self, mode: Mode) -> bool {
        !self.found.is_empty() && (mode == Mode::Paper || self.evidence.is_believable(self.windows()))
    }
}

/// Edges outside these shares of the particle spacing are torn.
const EDGE_RANGE: (f64, f64) = (0.7, 1.4);

/// The strands of all frames with torn edges brought back to the range; what hangs on an edge moves with it.
fn mended(points: &[DVec3], particles: usize, settings: &FitSettings) -> Vec<DVec3> {
    let (least, most) = (EDGE_RANGE.0 * settings.edge_mm, EDGE_RANGE.1 * settings.edge_mm);
    let mut out = Vec::with_capacity(points.len());
    for frame in points.chunks(particles.max(1)) {
        let mut at = frame[0];
        out.push(at);
        for pair in frame.windows(2) {
            let edge = pair[1] - pair[0];
            let length = edge.length();
            at += edge * (length.clamp(least, most) / length.max(1e-9));
            out.push(at);
        }
    }
    out
}

/// Takes a strand out of the sequence: no particle in any frame.
pub fn remove(sequence: &mut StrandSequence, strand: usize) {
    for t in 0..sequence.frame_count() {
        for e in sequence.range(t, strand) {
            sequence.points[e] = glam::Vec3::NAN;
            sequence.provenance[e] = Provenance::Missing;
            sequence.confidence[e] = 0.0;
        }
    }
    sequence.counts[strand] = 0;
}

impl BlockFit<'_> {
    fn check(&self, input: &FitInput) -> Result<(), StageError> {
        let s = input.sequence;
        let samples = s.frame_count() * s.strand_count * s.point_count;
        let wrong = |fact: String, hint: &str| {
            Err(StageError::Input { place: Place::strand(self.first_strand), fact, hint: hint.into() })
        };
        if [s.points.len(), s.provenance.len(), s.confidence.len()] != [samples; 3] || s.counts.len() != s.strand_count
        {
            return wrong("the sequence's arrays do not fit its shape".into(), "run the stage before again");
        }
        if !s.counts.iter().eq(self.strands.iter().map(|strand| &strand.count)) {
            return wrong(
                "the sequence's particle counts are not those of the block".into(),
                "run the stage before again",
            );
        }
        if s.counts.iter().any(|&c| usize::from(c) > s.point_count) {
            return wrong(
                "a strand counts more particles than the sequence holds".into(),
                "run the stage before again",
            );
        }
        if input.world_from_head.len() != s.frame_count() {
            let fact = format!("{} head poses for {} frames", input.world_from_head.len(), s.frame_count());
            return wrong(fact, "give one head pose per frame");
        }
        if !(input.frame_secs > 0.0 && input.frame_secs.is_finite()) {
            return wrong(format!("frame interval {} s", input.frame_secs), "give the take's frame rate");
        }
        for (t, pose) in input.world_from_head.iter().enumerate() {
            if !(pose.rotation.is_finite() && pose.translation.is_finite()) {
                let place = Place::frame(s.frames.get(t).map_or(t, |&f| f as usize));
                return Err(StageError::NonFinite { place, what: "the head pose".into() });
            }
        }
        Ok(())
    }
}

fn take_of<'a>(input: &FitInput<'a>) -> Take<'a> {
    Take { world_from_head: input.world_from_head, gravity: input.gravity, frame_secs: input.frame_secs }
}

/// Some frames of a sequence, by their places.
fn frames_of(sequence: &StrandSequence, places: Range<usize>) -> StrandSequence {
    let samples = sequence.strand_count * sequence.point_count;
    let range = places.start * samples..places.end * samples;
    StrandSequence {
        frames: sequence.frames[places].to_vec(),
        strand_count: sequence.strand_count,
        point_count: sequence.point_count,
        counts: sequence.counts.clone(),
        points: sequence.points[range.clone()].to_vec(),
        provenance: sequence.provenance[range.clone()].to_vec(),
        confidence: sequence.confidence[range].to_vec(),
    }
}

/// One strand of the sequence with the trust in its samples.
fn track_of(sequence: &StrandSequence, strand: usize, settings: &FitSettings) -> Track {
    let count = usize::from(sequence.counts[strand]);
    let samples = (0..sequence.frame_count()).flat_map(|t| sequence.range(t, strand));
    let (points, weights) = samples
        .map(|e| {
            let confidence = f64::from(sequence.confidence[e]);
            let trust = if confidence.is_finite() { confidence.clamp(LEAST_WEIGHT, 1.0) } else { LEAST_WEIGHT };
            let weight = match sequence.provenance[e] {
                Provenance::Missing => 0.0,
                Provenance::Observed => trust,
                _ => trust * settings.diffused_weight,
            };
            (sequence.points[e].as_dvec3(), weight)
        })
        .unzip();
    Track { particle_count: count, points, weights }
}

#[cfg(test)]
mod tests {
    use strandflow_dynamics::{Forces, Model, RestShape, State, Workspace, step};

    use super::*;

    #[test]
    fn a_torn_edge_is_mended_and_its_tail_keeps_its_shape() {
        let settings = FitSettings::default();
        let edge = settings.edge_mm;
        let straight: Vec<DVec3> = (0..6).map(|i| DVec3::X * edge * f64::from(i)).collect();
        let mut torn = straight.clone();
        torn[3..].iter_mut().for_each(|p| p.x += 3.0 * edge);
        let both: Vec<DVec3> = straight.iter().chain(&torn).copied().collect();
        let found = mended(&both, 6, &settings);
        assert_eq!(found[..6], straight);
        let lengths: Vec<f64> = found[6..].windows(2).map(|p| p[0].distance(p[1]) / edge).collect();
        for (length, expected) in lengths.iter().zip([1.0, 1.0, EDGE_RANGE.1, 1.0, 1.0]) {
            assert!((length - expected).abs() < 1e-12, "{lengths:?}");
        }
    }

    /// A strand of straight rest shape under a head that shakes; shape (T, n), and the head's motion.
    fn shaken(frames: usize, n: usize) -> (Vec<DVec3>, Vec<RigidTransform>) {
        let rest: Vec<DVec3> = (0..n).map(|i| DVec3::new(90.0, 0.0, -5.0 * i as f64)).collect();
        let head = |secs: f64| RigidTransform {
            rotation: glam::DMat3::from_rotation_z(0.5 * (9.0 * secs).sin()),
            translation: DVec3::ZERO,
        };
        let model = Model::new(RestShape::from_positions(&rest, 5.0), 3);
        let (mut state, mut workspace) = (State::at_rest(&rest), Workspace::new(&model));
        let (mut points, mut poses) = (vec![], vec![]);
        for t in 0..frames {
            poses.push(head(t as f64 * 0.01));
            points.extend_from_slice(&state.x);
            for k in 1..=5 {
                let at = head((t as f64 + f64::from(k) / 5.0) * 0.01);
                let roots: Vec<DVec3> = rest[..3].iter().map(|p| at.point(*p)).collect();
                step(&model, &Params::default(), &mut state, &mut workspace, 0.002, &roots, &Forces::default());
            }
        }
        (points, poses)
    }

    fn input<'a>(sequence: &'a StrandSequence, world_from_head: &'a [RigidTransform]) -> FitInput<'a> {
        FitInput { sequence, world_from_head, gravity: strandflow_dynamics::GRAVITY, frame_secs: 0.01 }
    }

    fn fitted(sequence: &StrandSequence, poses: &[RigidTransform], stretches: &[Stretch]) -> (StrandSequence, Fitted) {
        let settings = FitSettings::default();
        let mut block = BlockFit::new(0, &sequence.counts, Mode::Robust, &settings);
        if stretches.len() > 1 {
            for Stretch { own, .. } in stretches {
                block.survey(&input(&frames_of(sequence, own.clone()), &poses[own.clone()])).unwrap();
            }
        }
        let mut out = StrandSequence::missing(vec![], sequence.counts.clone(), sequence.point_count);
        for stretch in stretches {
            let part = frames_of(sequence, stretch.frames.clone());
            let more = block.fit(&input(&part, &poses[stretch.frames.clone()]), stretch).unwrap();
            out.frames.extend(more.frames);
            out.points.extend(more.points);
            out.provenance.extend(more.provenance);
            out.confidence.extend(more.confidence);
        }
        (out, block.finish(&mut Report::default()))
    }

    #[test]
    fn stretches_of_a_long_take_agree_with_the_whole_and_show_no_seam() {
        let (frames, n, strands) = (240, 16, 3);
        let (truth, poses) = shaken(frames, n);
        let mut sequence = StrandSequence::missing((0..frames as u32).collect(), vec![n as u16; strands], n);
        let noise = |e: usize| {
            let unit = |k: usize| {
                let h = ((3 * e + k + 1) as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
                ((h ^ (h >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 40) as f64 / f64::from(1 << 24) - 0.5
            };
            4.0 * DVec3::new(unit(0), unit(1), unit(2))
        };
        for e in 0..sequence.points.len() {
            let (t, i) = (e / (n * strands), e % n);
            sequence.points[e] = (truth[t * n + i] + if i < 3 { DVec3::ZERO } else { noise(e) }).as_vec3();
            // The last strand is lost for longer than a stretch.
            let is_lost = e / n % strands == 2 && (60..170).contains(&t);
            sequence.provenance[e] = if is_lost { Provenance::Missing } else { Provenance::Observed };
            sequence.confidence[e] = 1.0;
        }
        let cut = stretches::cut(frames, 60);
        assert_eq!(cut.len(), 4);
        let (whole, in_one) = fitted(&sequence, &poses, &stretches::cut(frames, frames));
        let (parts, in_parts) = fitted(&sequence, &poses, &cut);
        assert_eq!((&parts.frames, &in_parts.counts), (&whole.frames, &vec![n as u16; strands]));
        assert_eq!(in_one.counts, in_parts.counts);
        let error = |out: &StrandSequence, from: usize, to: usize, strand: usize| {
            let square = |t: usize, i: usize| out.strand(t, strand)[i].as_dvec3().distance_squared(truth[t * n + i]);
            let sum: f64 = (from..to).flat_map(|t| (3..n).map(move |i| (t, i))).map(|(t, i)| square(t, i)).sum();
            (sum / ((to - from) * (n - 3)) as f64).sqrt()
        };
        for strand in 0..2 {
            let (one, all) = (error(&whole, 0, frames, strand), error(&parts, 0, frames, strand));
            assert!(one < 0.7 && all < 1.1 * one, "strand {strand}: {one} {all}");
            for border in [60, 120, 180] {
                let at = error(&parts, border - 9, border + 9, strand);
                assert!(at < 1.5 * one, "strand {strand}, seam at {border}: {at} {one}");
                // No jump where one settles and the other begins.
                for t in border - 10..border + 10 {
                    let second = |out: &[DVec3]| (out[0] - 2.0 * out[1] + out[2]).length();
                    let tip = |t: usize| parts.strand(t, strand)[n - 1].as_dvec3();
                    let of_truth = second(&[t - 1, t, t + 1].map(|t| truth[(t + 1) * n - 1]));
                    assert!(second(&[tip(t - 1), tip(t), tip(t + 1)]) < of_truth + 1.0, "{t}");
                }
            }
            let drag = |found: &Fitted| f64::from(found.parameters[strand][8]).ln();
            assert!((drag(&in_one) - drag(&in_parts)).abs() < 0.5, "{:?} {:?}", in_one.parameters, in_parts.parameters);
        }
        // Where nothing was seen for a whole stretch the strand hangs from the head all the same.
        assert!(error(&parts, 60, 170, 2) < 12.0, "{}", error(&parts, 60, 170, 2));
        assert!(in_one.residual_mm.iter().zip(&in_parts.residual_mm).all(|(a, b)| (a - b).abs() < 0.1 * a));
        let edge = |t: usize| (1..n).map(|i| parts.strand(t, 0)[i].distance(parts.strand(t, 0)[i - 1])).sum::<f32>();
        let lengths: Vec<f32> = (0..frames).map(edge).collect();
        let (least, most) = lengths.iter().fold((f32::MAX, 0f32), |(a, b), l| (a.min(*l), b.max(*l)));
        assert!(most - least < 0.02 * most, "{least} {most}");
    }

    #[test]
    fn a_strand_that_is_elsewhere_than_it_was_seen_or_runs_away_is_given_up() {
        let settings = FitSettings::default();
        let (frames, particles) = (20, 8);
        let point = |e: usize| DVec3::X * settings.edge_mm * (e % particles) as f64;
        let points: Vec<DVec3> = (0..frames * particles).map(point).collect();
        let swung = |mm: f64| {
            let aside = |e: usize| DVec3::Y * mm * (1.3 * (e / particles) as f64).sin();
            (0..points.len()).map(|e| points[e] + aside(e)).collect::<Vec<_>>()
        };
        let is_believed = |refined: &[DVec3], given: &[DVec3], weights: &[f64]| {
            let mut evidence = Evidence::default();
            for at in (0..frames).map(|t| t * particles..(t + 1) * particles) {
                evidence.add(&refined[at.clone()], &given[at.clone()], &weights[at], &settings);
            }
            evidence.is_believable([40, 0, 0])
        };
        // Seen in the first frames where it is, in the last ones 40 mm aside; the rest was not seen.
        let weights = |here: usize, aside: usize| -> Vec<f64> {
            let is_seen = |t: usize| t < here || t >= frames - aside;
            (0..points.len()).map(|e| f64::from(u8::from(is_seen(e / particles)))).collect()
        };
        let seen = |here: usize, aside: usize| {
            let off = |e: usize| if e / particles >= frames - aside { DVec3::Y * 40.0 } else { DVec3::ZERO };
            let given: Vec<DVec3> = (0..points.len()).map(|e| points[e] + off(e)).collect();
            is_believed(&points, &given, &weights(here, aside))
        };
        assert!(seen(12, 0));
        assert!(seen(12, 1), "one frame astray costs no strand");
        assert!(!seen(9, 6));
        // It swings aside and back by 0.8 mm: twice as far as that is lively, ten times has run away.
        assert!(is_believed(&swung(1.6), &swung(0.8), &weights(12, 0)));
        assert!(!is_believed(&swung(8.0), &swung(0.8), &weights(12, 0)));
    }
}
