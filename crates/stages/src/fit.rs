//! Stage 11: every strand's motion explained by a simulation: parameters and averaged simulated positions (eq. 3, 4).

use glam::DVec3;
use serde::{Deserialize, Serialize};
use strandflow_core::{Place, Provenance, Report, RigidTransform, StrandSequence};
use strandflow_dynamics::refine::{RefineOptions, Refined, Take, Track, refine};

use crate::{Mode, SettingViolation, StageError};

/// What one block of strands needs.
pub struct FitInput<'a> {
    /// The trimmed sequence of the block, all frames.
    pub sequence: &'a StrandSequence,
    /// The head's motion per frame.
    pub world_from_head: &'a [RigidTransform],
    /// Gravity \[mm/s²\], world.
    pub gravity: DVec3,
    /// Frame interval \[s\].
    pub frame_secs: f64,
    /// Number of the block's first strand in the take, for messages.
    pub first_strand: usize,
}

/// The refined block. Every particle below a strand's count is present in every frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// Refined strands; provenance `Simulated` where the frame had no point.
    pub sequence: StrandSequence,
    /// Fitted parameters per strand, shape (N, 9): k_edge, k_bend, k_torsion, k_alt \[1/s²\], c_edge, c_bend, c_torsion,
    /// c_alt, drag \[1/s\], per unit mass. Geometric mean over the windows of the last outer pass.
    pub parameters: Vec<[f32; 9]>,
    /// Per strand: root mean square distance of the refined to the given points \[mm\].
    pub residual_mm: Vec<f32>,
    /// Per strand: windows fitted, windows whose last step made nothing better, windows that failed.
    pub windows: Vec<[u16; 3]>,
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

/// Fits one block of strands.
///
/// A strand without any usable point stays missing and is reported; everything else that can be wrong with a strand
/// (gaps, jumps, windows that fail) is absorbed and counted in `windows`.
///
/// Errors: frames, head motion and array lengths that do not fit together; a head motion that is not finite.
/// Reference: Zhang, Wu, Zhang et al. 2012, §5.1–5.2, eq. 3 and 4.
/// Deviation: see `strandflow_dynamics::refine`; paper mode follows the letter.
pub fn fit(input: &FitInput, mode: Mode, settings: &FitSettings, report: &mut Report) -> Result<Fitted, StageError> {
    check_shapes(input)?;
    let tracks: Vec<Track> = (0..input.sequence.strand_count).map(|n| track_of(input.sequence, n, settings)).collect();
    let take = Take { world_from_head: input.world_from_head, gravity: input.gravity, frame_secs: input.frame_secs };
    let options = settings.options(mode);
    let refined = refine(&tracks, &take, &options);
    let mut out = Fitted {
        sequence: input.sequence.clone(),
        parameters: Vec::with_capacity(tracks.len()),
        residual_mm: Vec::with_capacity(tracks.len()),
        windows: Vec::with_capacity(tracks.len()),
    };
    let (mut empty, mut failed, mut given_up) = (0, 0, 0);
    for (n, strand) in refined.iter().enumerate() {
        let params = strand.as_ref().map_or(options.start, |s| s.params);
        out.parameters.push(params.to_array().map(|p| p as f32));
        out.windows.push(strand.as_ref().map_or([0; 3], |s| s.windows.map(|w| w.min(u16::MAX.into()) as u16)));
        failed += out.windows[n][2] as usize;
        let believed = strand.as_ref().filter(|s| mode == Mode::Paper || is_believable(s, &tracks[n], settings));
        out.residual_mm.push(match believed {
            Some(strand) => {
                let points = mended(&strand.points, usize::from(input.sequence.counts[n]), settings);
                write_back(input.sequence, &mut out.sequence, n, &points)
            }
            None => 0.0,
        });
        if believed.is_none() && input.sequence.counts[n] > 0 {
            empty += usize::from(strand.is_none());
            given_up += usize::from(strand.is_some());
            remove(&mut out.sequence, n);
        }
    }
    if empty + failed + given_up > 0 {
        let fact = format!(
            "{empty} strands without a usable point, {given_up} strands that no simulation explains, {failed} windows failed"
        );
        let place = Place { strand: Some(input.first_strand), ..Place::default() };
        report.warn(
            place,
            fact,
            "those strands are left to stage blend to complete; failed windows keep the cleaned positions",
        );
    }
    Ok(out)
}

/// A strand of which more than this share of the windows failed is given up and completed from its neighbours. A failed
/// window keeps the cleaned positions, so a strand survives many of them; much lower, and strands are replaced by their
/// neighbours that knew better themselves; near 1, strands that jump between different hair from frame to frame stay.
const FAILED_SHARE: f64 = 0.4;
/// Edges outside these shares of the particle spacing are torn.
const EDGE_RANGE: (f64, f64) = (0.7, 1.4);
/// A strand of which more than this share of the edges is torn shows a simulation that came apart. Fewer are mended: a
/// sample astray in one frame is no reason to lose a strand.
const TORN_SHARE: f64 = 0.03;

/// A strand of which more than this share of the samples lies beyond [`STRAY_MM`] from what it was made into is given up: it
/// shows several hairs, and the simulation of one goes its own way where the others were seen. At 0 every outlier costs a
/// strand.
const STRAY_SHARE: f64 = 0.15;
/// See [`STRAY_SHARE`] \[mm\].
const STRAY_MM: f64 = 10.0;

/// A strand that shakes more than this many times as much as where it was seen is given up: its simulation ran away, as a rule
/// in the windows at the take's ends. A simulation is to take shaking off; at 2, strands go that are only livelier than before.
const SHAKE_RATIO: f64 = 3.0;
/// Less shaking \[mm a frame²\] than this is none.
const LEAST_SHAKE_MM: f64 = 0.2;

/// Whether a refined strand can be passed on: most windows explain it, its edges kept their length, it is where it was seen,
/// and it does not shake.
fn is_believable(strand: &Refined, track: &Track, settings: &FitSettings) -> bool {
    let windows: usize = strand.windows.iter().sum();
    let particles = track.particle_count.max(1);
    let lengths = || strand.points.chunks(particles).flat_map(|f| f.windows(2).map(|p| p[0].distance(p[1])));
    let (least, most) = (EDGE_RANGE.0 * settings.edge_mm, EDGE_RANGE.1 * settings.edge_mm);
    let torn = lengths().filter(|length| !(least..=most).contains(length)).count();
    let is_seen = |e: usize| track.weights[e] > 0.0;
    let seen = || (0..track.points.len()).filter(|&e| is_seen(e));
    let stray = seen().filter(|&e| strand.points[e].distance(track.points[e]) > STRAY_MM).count();
    let (shake, seen_shake) = (shake(&strand.points, particles, |_| true), shake(&track.points, particles, is_seen));
    torn as f64 <= TORN_SHARE * lengths().count() as f64
        && seen_shake.is_none_or(|seen| shake.unwrap_or(0.0) <= SHAKE_RATIO * seen.max(LEAST_SHAKE_MM))
        && stray as f64 <= STRAY_SHARE * seen().count() as f64
        && strand.windows[2] as f64 <= FAILED_SHARE * windows as f64
}

/// Root mean square second difference over the frames of a strand's points, of those that count in three frames in a row;
/// `None` where there are none.
fn shake(points: &[DVec3], particles: usize, counts: impl Fn(usize) -> bool) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0);
    for [a, b, c] in (0..points.len().saturating_sub(2 * particles)).map(|e| [e, e + particles, e + 2 * particles]) {
        if counts(a) && counts(b) && counts(c) {
            sum += (points[c] - 2.0 * points[b] + points[a]).length_squared();
            count += 1;
        }
    }
    (count > 0).then(|| (sum / f64::from(count)).sqrt())
}

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
fn remove(sequence: &mut StrandSequence, strand: usize) {
    for t in 0..sequence.frame_count() {
        for e in sequence.range(t, strand) {
            sequence.points[e] = glam::Vec3::NAN;
            sequence.provenance[e] = Provenance::Missing;
            sequence.confidence[e] = 0.0;
        }
    }
    sequence.counts[strand] = 0;
}

fn check_shapes(input: &FitInput) -> Result<(), StageError> {
    let s = input.sequence;
    let samples = s.frame_count() * s.strand_count * s.point_count;
    let wrong = |fact: String, hint: &str| {
        Err(StageError::Input { place: Place::strand(input.first_strand), fact, hint: hint.into() })
    };
    if [s.points.len(), s.provenance.len(), s.confidence.len()] != [samples; 3] || s.counts.len() != s.strand_count {
        return wrong("the sequence's arrays do not fit its shape".into(), "run the stage before again");
    }
    if s.counts.iter().any(|&c| usize::from(c) > s.point_count) {
        return wrong("a strand counts more particles than the sequence holds".into(), "run the stage before again");
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

/// Writes a refined strand and returns its root mean square distance to the points that were given \[mm\].
fn write_back(given: &StrandSequence, out: &mut StrandSequence, strand: usize, refined: &[DVec3]) -> f32 {
    let (mut sum, mut count) = (0.0, 0);
    let samples = (0..given.frame_count()).flat_map(|t| given.range(t, strand));
    for (e, point) in samples.zip(refined) {
        out.points[e] = point.as_vec3();
        if given.valid(e) && given.points[e].is_finite() {
            sum += given.points[e].as_dvec3().distance_squared(*point);
            count += 1;
        } else {
            out.provenance[e] = Provenance::Simulated;
            out.confidence[e] = 0.0;
        }
    }
    (sum / f64::from(count.max(1))).sqrt() as f32
}

#[cfg(test)]
mod tests {
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
    #[test]
    fn a_strand_that_is_elsewhere_than_it_was_seen_or_runs_away_is_given_up() {
        let settings = FitSettings::default();
        let (frames, particles) = (20, 8);
        let point = |e: usize| DVec3::X * settings.edge_mm * (e % particles) as f64;
        let points: Vec<DVec3> = (0..frames * particles).map(point).collect();
        let windows = [40, 0, 0];
        let strand = Refined { points: points.clone(), cleaned: points.clone(), params: Default::default(), windows };
        // Seen in the first frames where it is, in the last ones 40 mm aside; the rest was not seen.
        let seen = |here: usize, aside: usize| Track {
            particle_count: particles,
            points: (0..points.len())
                .map(|e| points[e] + if e / particles >= frames - aside { DVec3::Y * 40.0 } else { DVec3::ZERO })
                .collect(),
            weights: (0..points.len())
                .map(|e| f64::from(u8::from(e / particles < here || e / particles >= frames - aside)))
                .collect(),
        };
        assert!(is_believable(&strand, &seen(12, 0), &settings));
        assert!(is_believable(&strand, &seen(12, 1), &settings), "one frame astray costs no strand");
        assert!(!is_believable(&strand, &seen(9, 6), &settings));
        // It swings aside and back by 0.8 mm: twice as far as that is lively, ten times has run away.
        let swung = |mm: f64| {
            let aside = |e: usize| DVec3::Y * mm * (1.3 * (e / particles) as f64).sin();
            (0..points.len()).map(|e| points[e] + aside(e)).collect::<Vec<_>>()
        };
        let moved = |mm: f64| Refined { points: swung(mm), ..strand.clone() };
        let track = Track { points: swung(0.8), ..seen(12, 0) };
        assert!(is_believable(&moved(1.6), &track, &settings));
        assert!(!is_believable(&moved(8.0), &track, &settings));
    }
}
