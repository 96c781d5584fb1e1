//! Stage 11: every strand's motion explained by a simulation: parameters and averaged simulated positions (eq. 3, 4).
//!
//! Memory is that of a stretch of frames, however long the take ([`stretches`]).

mod evidence;
mod progress;
mod settings;
mod stretches;

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;
use strandflow_core::{Place, Provenance, Report, RigidTransform, StrandSequence};
use strandflow_dynamics::refine::{Body, RefineOptions, Take, Track, refine_stretch};

use crate::{Mode, StageError};
use evidence::Doubts;
use progress::Progress;
pub use settings::FitSettings;
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

impl<'a> BlockFit<'a> {
    /// A block of strands of these particle counts; `first_strand` is its first one's number in the take, for messages.
    pub fn new(first_strand: usize, counts: &[u16], mode: Mode, settings: &'a FitSettings) -> Self {
        let strands = counts.iter().map(|&count| Progress::new(count)).collect();
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
        let empty = self.strands.iter().filter(|s| s.count > 0 && s.found.is_empty()).count();
        let refined = self.strands.iter().filter(|s| !s.found.is_empty());
        let doubts: Vec<Doubts> = refined.map(|s| s.doubts(self.mode)).filter(|doubts| doubts.any()).collect();
        let count = |why: fn(&Doubts) -> bool| doubts.iter().filter(|d| why(d)).count();
        let (given_up, torn) = (doubts.len(), count(|d| d.is_torn));
        let (shaking, astray) = (count(|d| d.shakes), count(|d| d.is_astray));
        let failed: usize = self.strands.iter().map(|s| s.windows()[2]).sum();
        if empty + failed + given_up > 0 {
            let fact = format!(
                "{empty} strands without a usable point, {given_up} strands that no simulation explains ({torn} torn, {shaking} \
                 shaking, {astray} elsewhere than seen), {failed} windows failed"
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
            let residual = if stays { strand.residual_mm() } else { 0.0 };
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
    use strandflow_dynamics::{Forces, Model, Params, RestShape, State, Workspace, step};

    use super::*;

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
            eprintln!("strand {strand}: {one:.2} mm off in one stretch, {all:.2} mm in four");
            assert!(one < 0.7 && all < 1.1 * one, "strand {strand}: {one} {all}");
            for border in [60, 120, 180] {
                let at = error(&parts, border - 9, border + 9, strand);
                eprintln!("within 9 frames of {border}: {at:.2} mm");
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
        let unseen = error(&parts, 60, 170, 2);
        eprintln!("not seen: {unseen:.1} mm");
        assert!(unseen < 12.0, "{unseen}");
        assert!(in_one.residual_mm.iter().zip(&in_parts.residual_mm).all(|(a, b)| (a - b).abs() < 0.1 * a));
        let edge = |t: usize| (1..n).map(|i| parts.strand(t, 0)[i].distance(parts.strand(t, 0)[i - 1])).sum::<f32>();
        let lengths: Vec<f32> = (0..frames).map(edge).collect();
        let (least, most) = lengths.iter().fold((f32::MAX, 0f32), |(a, b), l| (a.min(*l), b.max(*l)));
        assert!(most - least < 0.02 * most, "{least} {most}");
    }
}
