//! Stage 10: strands resampled to 5 mm and smoothed (eq. 2), then trimmed to a fixed topology over the take.

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use strandflow_core::{Place, Provenance, Report, StrandSequence, Strands};
use strandflow_dynamics::eq2::{self, Reading};
use strandflow_geometry::polyline::{arc_parameters, at_parameter};

use crate::{Mode, SettingViolation, StageError, neighbours::nearest_roots};

/// Settings of stage `smooth`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SmoothSettings {
    /// Edge length after resampling \[mm\].
    pub edge_mm: f64,
    /// w_s of eq. 2.
    pub smoothness: f64,
    /// What eq. 2 penalises. The printed form smooths nothing (see `strandflow_dynamics::eq2`).
    pub reading: Reading,
    /// The particle count of a strand is this quantile of its counts over the frames that have it (robust mode). Particles
    /// that most frames lack are simulated without anything to go by, and stray.
    pub count_quantile: f64,
    /// A strand present in a smaller share of the frames is left to completion (robust mode).
    pub least_presence: f64,
    /// A strand of fewer particles is left to completion: three particles follow the head, and the springs need a few
    /// free ones after them.
    pub least_particles: usize,
    /// A strand ends where it has this many times the particles of the strands around it (robust mode).
    pub outgrown: f64,
}

impl Default for SmoothSettings {
    fn default() -> Self {
        Self {
            edge_mm: 5.0,
            smoothness: 0.5,
            reading: Reading::Curvature,
            count_quantile: 0.5,
            least_presence: 0.3,
            least_particles: 6,
            outgrown: 1.25,
        }
    }
}

impl SmoothSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        let mut found = Vec::new();
        let mut need =
            |ok, field: &str, value: f64, rule| SettingViolation::unless(ok, &mut found, (field, value), rule);
        let range = ("0.5..=50", "the springs are tuned for 5 mm; a strand needs several edges");
        need((0.5..=50.0).contains(&self.edge_mm), "smooth.edge_mm", self.edge_mm, range);
        let range = ("0..=0.99", "at 1 nothing ties the strand to the data");
        need((0.0..=0.99).contains(&self.smoothness), "smooth.smoothness", self.smoothness, range);
        let share = ("0..=1", "it is a share");
        need((0.0..=1.0).contains(&self.count_quantile), "smooth.count_quantile", self.count_quantile, share);
        need((0.0..=1.0).contains(&self.least_presence), "smooth.least_presence", self.least_presence, share);
        let range = ("1..=1000", "half of all strands are longer than the median of those around them");
        need((1.0..=1000.0).contains(&self.outgrown), "smooth.outgrown", self.outgrown, range);
        let range = ("4 or more", "a tetrahedron of springs has four particles");
        need(self.least_particles >= 4, "smooth.least_particles", self.least_particles as f64, range);
        found
    }
}

/// Phase 1, one frame: every strand resampled and smoothed; numbering kept.
///
/// The root stays where it is. A resampled point takes the provenance of the nearer given point and the interpolated
/// confidence. Empty strands stay empty.
pub fn smooth_frame(
    strands: &Strands,
    frame: usize,
    _mode: Mode,
    settings: &SmoothSettings,
    report: &mut Report,
) -> Result<Strands, StageError> {
    let count = strands.strand_count();
    if let Some(strand) = (0..count).find(|&n| strands.strand(n).iter().any(|p| !p.is_finite())) {
        let place = Place { frame: Some(frame), strand: Some(strand), view: None };
        return Err(StageError::NonFinite { place, what: "a strand point".into() });
    }
    let resampled: Vec<Resampled> = (0..count).into_par_iter().map(|n| resample(strands, n, settings)).collect();
    let mut out = Strands::new();
    for strand in &resampled {
        out.push(&strand.points, &strand.provenance, &strand.confidence);
    }
    if count > 0 && out.points.is_empty() {
        report.warn(Place::frame(frame), "no strand survived pruning", "the frame is filled by simulation");
    }
    Ok(out)
}

/// One strand at even arc length, smoothed.
struct Resampled {
    points: Vec<Vec3>,
    provenance: Vec<Provenance>,
    confidence: Vec<f32>,
}

fn resample(strands: &Strands, strand: usize, settings: &SmoothSettings) -> Resampled {
    let range = strands.range(strand);
    let given = &strands.points[range.clone()];
    let (provenance, confidence) = (&strands.provenance[range.clone()], &strands.confidence[range]);
    let parameters = arc_parameters(given, settings.edge_mm as f32);
    let even: Vec<_> = parameters.iter().map(|&s| at_parameter(given, s).as_dvec3()).collect();
    let smoothed = eq2::smooth(&even, settings.smoothness, settings.reading, true);
    let last = given.len().saturating_sub(1);
    Resampled {
        points: smoothed.into_iter().map(|p| p.as_vec3()).collect(),
        provenance: parameters.iter().map(|s| provenance[(s.round() as usize).min(last)]).collect(),
        confidence: parameters
            .iter()
            .map(|s| {
                let below = (*s as usize).min(last);
                let above = (below + 1).min(last);
                confidence[below] + (confidence[above] - confidence[below]) * s.fract()
            })
            .collect(),
    }
}

/// Phase 2, one block of strands: the particle count of each in every frame.
///
/// `lengths(n)` are the counts of strand n over all frames, `point_count` is the P of the take, `longest` what
/// [`longest_among_neighbours`] says of these strands. A strand that too few frames have, or that is too short to simulate, gets
/// the count 0 and is completed in `blend`.
///
/// Reference: Zhang et al. 2012 §4 ("trim a fiber to a fixed number of points"). Paper mode takes the shortest frame.
/// *Deviation* (robust): a quantile of the counts over the frames; what a frame does not have is missing. One bad frame
/// would otherwise shorten the strand for the whole take.
pub fn fixed_counts(
    lengths: impl Fn(usize) -> Vec<usize>,
    longest: &[u16],
    point_count: usize,
    mode: Mode,
    settings: &SmoothSettings,
) -> Vec<u16> {
    let count =
        |(n, &longest): (usize, &u16)| fixed_count(&lengths(n), point_count.min(longest.into()), mode, settings);
    longest.iter().enumerate().map(|strand| count(strand) as u16).collect()
}

/// Phase 2: some frames of a block's strands at their fixed counts, missing points marked.
///
/// `frames[t]` holds the strands in frame `frame_numbers[t]`.
pub fn trim(
    frame_numbers: &[u32],
    frames: &[Strands],
    counts: &[u16],
    point_count: usize,
) -> Result<StrandSequence, StageError> {
    if frames.len() != frame_numbers.len() || frames.iter().any(|f| f.strand_count() != counts.len()) {
        return Err(StageError::Input {
            place: Place::default(),
            fact: format!("{} frames of differing strand counts for {} numbers", frames.len(), frame_numbers.len()),
            hint: "run the stage `smooth` again from its first phase".into(),
        });
    }
    let mut out = StrandSequence::missing(frame_numbers.to_vec(), counts.to_vec(), point_count);
    for (t, frame) in frames.iter().enumerate() {
        for n in 0..counts.len() {
            let (from, to) = (frame.range(n), out.range(t, n));
            for (source, target) in from.zip(to) {
                out.points[target] = frame.points[source];
                out.provenance[target] = frame.provenance[source];
                out.confidence[target] = frame.confidence[source];
            }
        }
    }
    Ok(out)
}

/// Strands around a root whose lengths say what a strand's can be.
const NEIGHBOURS: usize = 16;
/// Particles that a strand may always have more than those around it.
const ALWAYS_MORE: f64 = 2.0;

/// The most particles of each strand: `settings.outgrown` times the median of those around it, by their roots.
///
/// `lengths(n)` are the counts of strand n over all frames. Lengths of hair vary slowly over the scalp; a strand that grew
/// on past its tip, down the neck or along other hair, does not. No limit in paper mode and for strands without neighbours.
///
/// *Deviation* (robust): the paper lets every strand be as long as it grew.
pub fn longest_among_neighbours(
    roots: &[DVec3],
    lengths: impl Fn(usize) -> Vec<usize> + Sync,
    mode: Mode,
    settings: &SmoothSettings,
) -> Vec<u16> {
    if mode == Mode::Paper {
        return vec![u16::MAX; roots.len()];
    }
    let counts: Vec<usize> =
        (0..roots.len()).into_par_iter().map(|n| fixed_count(&lengths(n), usize::MAX, mode, settings)).collect();
    let present: Vec<usize> = (0..roots.len()).filter(|&n| counts[n] > 0).collect();
    let limit = |n: usize| {
        let near = nearest_roots(roots, n, &present, NEIGHBOURS);
        let mut around: Vec<usize> = near.into_iter().map(|(_, m)| counts[m]).collect();
        around.sort_unstable();
        let Some(&median) = around.get(around.len() / 2) else { return u16::MAX };
        (settings.outgrown * median as f64 + ALWAYS_MORE).ceil().min(f64::from(u16::MAX)) as u16
    };
    (0..roots.len()).into_par_iter().map(limit).collect()
}

/// The particle count of one strand from its counts over all frames.
fn fixed_count(lengths: &[usize], point_count: usize, mode: Mode, settings: &SmoothSettings) -> usize {
    let mut present: Vec<usize> = lengths.iter().copied().filter(|&len| len >= settings.least_particles).collect();
    present.sort_unstable();
    let (Some(&shortest), false) = (present.first(), lengths.is_empty()) else { return 0 };
    let count = match mode {
        Mode::Paper => shortest,
        Mode::Robust if (present.len() as f64) < settings.least_presence * lengths.len() as f64 => 0,
        Mode::Robust => present[((present.len() - 1) as f64 * settings.count_quantile).round() as usize],
    };
    if count.min(point_count) < settings.least_particles { 0 } else { count.min(point_count) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(points: usize, step: f32) -> Strands {
        let mut strands = Strands::new();
        let p: Vec<Vec3> = (0..points).map(|i| Vec3::new(3.0, 4.0, -step * i as f32)).collect();
        let provenance: Vec<_> =
            (0..points).map(|i| if i < points / 2 { Provenance::Observed } else { Provenance::Diffused }).collect();
        let confidence: Vec<f32> = (0..points).map(|i| i as f32 / points as f32).collect();
        strands.push(&p, &provenance, &confidence);
        strands
    }

    #[test]
    fn a_straight_strand_is_resampled_and_not_moved() {
        let out = smooth_frame(&line(51, 2.0), 0, Mode::Robust, &Default::default(), &mut Report::default()).unwrap();
        let points = out.strand(0);
        assert_eq!(points.len(), 21);
        assert!(points.iter().enumerate().all(|(i, p)| p.distance(Vec3::new(3.0, 4.0, -5.0 * i as f32)) < 1e-3));
        assert_eq!(out.provenance.iter().filter(|p| **p == Provenance::Observed).count(), 10);
        assert!(out.confidence.windows(2).all(|pair| pair[1] > pair[0]));
    }

    #[test]
    fn noise_across_a_wave_falls_and_the_wave_stays() {
        // Deterministic noise of 0.6 mm rms across a wave of 60 mm and 4 mm.
        let mut state = 1u64;
        let mut noise = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            ((state >> 40) as f32 / (1 << 24) as f32 - 0.5) * 2.0
        };
        let wave = |s: f32| Vec3::new(4.0 * (s * std::f32::consts::TAU / 60.0).sin(), 0.0, -s);
        let clean: Vec<Vec3> = (0..100).map(|i| wave(2.0 * i as f32)).collect();
        let noisy: Vec<Vec3> = clean.iter().map(|p| *p + Vec3::new(noise(), noise(), 0.0)).collect();
        let mut strands = Strands::new();
        strands.push(&noisy, &[Provenance::Observed; 100], &[1.0; 100]);
        let settings = SmoothSettings::default();
        let across = |p: &Vec3| (p.x - wave(-p.z).x).hypot(p.y);
        let rms =
            |points: &[Vec3]| (points.iter().map(|p| across(p).powi(2)).sum::<f32>() / points.len() as f32).sqrt();
        let out = smooth_frame(&strands, 0, Mode::Robust, &settings, &mut Report::default()).unwrap();
        assert!(rms(&out.points[1..]) < 0.75 * rms(&noisy), "{} of {}", rms(&out.points[1..]), rms(&noisy));
    }

    #[test]
    fn counts_come_from_the_distribution_and_absent_points_are_missing() {
        let frames: Vec<Strands> = [20, 21, 3, 22, 0, 24, 21].iter().map(|&n| line(n, 5.0)).collect();
        let numbers: Vec<u32> = (10..17).collect();
        let settings = SmoothSettings::default();
        let counts = |point_count: usize, mode: Mode| {
            let lengths = |n: usize| frames.iter().map(|frame| frame.range(n).len()).collect();
            fixed_counts(lengths, &[u16::MAX], point_count, mode, &settings)
        };
        let out = trim(&numbers, &frames, &counts(40, Mode::Robust), 40).unwrap();
        assert_eq!(out.counts, [21]);
        let present = |t: usize| out.range(t, 0).filter(|&i| out.valid(i)).count();
        assert_eq!((0..7).map(present).collect::<Vec<_>>(), [20, 21, 3, 21, 0, 21, 21]);
        assert!((0..out.points.len()).all(|i| out.valid(i) == out.points[i].is_finite()));
        assert_eq!(counts(40, Mode::Paper), [20]);
        assert_eq!(counts(12, Mode::Robust), [12]);
        assert!(trim(&numbers[1..], &frames, &[21], 40).is_err());
    }

    #[test]
    fn a_strand_that_outgrows_its_neighbours_is_cut() {
        let roots: Vec<DVec3> = (0..40).map(|n| DVec3::new(f64::from(n), 0.0, 0.0)).collect();
        let lengths = |n: usize| vec![if n == 20 { 60 } else { 20 + n / 10 }; 10];
        let longest = longest_among_neighbours(&roots, lengths, Mode::Robust, &SmoothSettings::default());
        assert!((28..31).contains(&longest[20]), "{longest:?}");
        assert!((0..40).all(|n| usize::from(longest[n]) >= 27));
        let alone = longest_among_neighbours(&roots[..1], lengths, Mode::Robust, &SmoothSettings::default());
        assert_eq!(alone, [u16::MAX]);
    }

    #[test]
    fn a_strand_of_too_few_frames_is_left_to_completion() {
        assert_eq!(fixed_count(&[30, 0, 0, 0, 0, 0], 80, Mode::Robust, &SmoothSettings::default()), 0);
        assert_eq!(fixed_count(&[30, 30, 0, 0, 0, 0], 80, Mode::Robust, &SmoothSettings::default()), 30);
    }

    #[test]
    fn a_point_that_is_not_finite_is_named() {
        let mut strands = line(20, 2.0);
        strands.points[4].y = f32::NAN;
        let error = smooth_frame(&strands, 7, Mode::Robust, &Default::default(), &mut Report::default()).unwrap_err();
        assert!(error.to_string().contains("frame 7, strand 0"));
    }
}
