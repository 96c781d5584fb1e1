//! Stage 13: strands warped along the velocity field and interpolated in time (eq. 6, 7); missing strands completed.

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use strandflow_core::{Occupancy, Place, Provenance, Report, RigidTransform, SparseVoxels, StrandSequence};
use strandflow_dynamics::{
    driven::{Contact, lay_outside},
    warp::{WarpWeights, interpolate, warp},
};
use strandflow_geometry::signed_distance::SignedDistance;
use strandflow_volume::velocity::VelocitySampler;

use crate::{Mode, SettingViolation, StageError, neighbours::nearest_roots};

/// What one frame needs. `sequence` holds the fitted strands of the previous, this and the next frame (2 or 3 frames:
/// a neighbour that does not exist is left out), `fields[i]` the velocity field of `sequence.frames[i]`.
pub struct BlendInput<'a> {
    /// Index of this frame within `sequence.frames`.
    pub at: usize,
    /// Fitted strands.
    pub sequence: &'a StrandSequence,
    /// Velocity fields \[mm/s\].
    pub fields: &'a [&'a SparseVoxels<Vec3>],
    /// The head's motion, per frame of `sequence`.
    pub world_from_head: &'a [RigidTransform],
    /// Roots of all strands in head space \[mm\], shape (N).
    pub roots: &'a [glam::DVec3],
    /// How far each strand's simulations are from what was seen \[mm\], shape (N); not finite where there are none.
    pub residual_mm: &'a [f32],
    /// The hull of this frame.
    pub hull: &'a Occupancy,
    /// Frame interval \[s\].
    pub frame_secs: f64,
    /// Edge length \[mm\].
    pub edge_mm: f64,
}

/// Settings of stage `blend`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BlendSettings {
    /// γ of eq. 7.
    pub relaxation: f64,
    /// s_l of eq. 6.
    pub length_weight: f64,
    /// Particles at the root that follow the head exactly (robust mode; the paper fixes one).
    pub root_particles: usize,
    /// A strand may lend its way to a missing one where its residual is at most this many times the median of all.
    pub completion_residual: f64,
    /// Arc length over which a completed strand comes to the strand that lends it its way \[mm\].
    pub completion_join_mm: f64,
    /// Distance of a neighbour's root at which the confidence of a completed strand has halved \[mm\].
    pub completion_half_mm: f64,
    /// How far strands may leave the hull \[mm\], robust mode: masks and hull are right to a pixel and a voxel. The hull is
    /// taken at half its resolution.
    pub hull_slack_mm: f64,
}

impl Default for BlendSettings {
    fn default() -> Self {
        Self {
            relaxation: 0.25,
            length_weight: 50.0,
            root_particles: 3,
            completion_residual: 2.0,
            completion_join_mm: 20.0,
            completion_half_mm: 10.0,
            hull_slack_mm: 2.0,
        }
    }
}

impl BlendSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        let mut found = Vec::new();
        let mut need =
            |ok, field: &str, value: f64, rule| SettingViolation::unless(ok, &mut found, (field, value), rule);
        let range = ("0..=0.5", "above 0.5 the frame itself counts negatively");
        need((0.0..=0.5).contains(&self.relaxation), "blend.relaxation", self.relaxation, range);
        let range = ("0..=1e4", "eq. 6 is solved in double precision");
        need((0.0..=1e4).contains(&self.length_weight), "blend.length_weight", self.length_weight, range);
        let range = ("1 or more", "the root must follow the head");
        need(self.root_particles >= 1, "blend.root_particles", self.root_particles as f64, range);
        let range = ("1 or more", "half of all strands lie above 1");
        need(self.completion_residual >= 1.0, "blend.completion_residual", self.completion_residual, range);
        let range = ("above 0", "it is a distance");
        need(self.completion_join_mm > 0.0, "blend.completion_join_mm", self.completion_join_mm, range);
        let range = ("above 0", "it is a distance");
        need(self.completion_half_mm > 0.0, "blend.completion_half_mm", self.completion_half_mm, range);
        let range = ("0 or more", "strands inside the hull are free");
        need(self.hull_slack_mm >= 0.0, "blend.hull_slack_mm", self.hull_slack_mm, range);
        found
    }
}

/// Newton iterations on eq. 6; 5–9 suffice, the rest is for folded strands.
const WARP_ITERATIONS: usize = 40;

/// The blended strands of one frame: a sequence of one frame, every strand of the take present (absent ones completed
/// from their neighbours, provenance `Completed`).
///
/// Counts of strands that are present in `sequence` are kept. A strand of count 0 takes the weighted median of its
/// neighbours' counts, which depends on roots and counts alone and is therefore the same in every frame.
///
/// Reference: Zhang et al. 2012 eq. 6, 7. *Deviation* (robust): a neighbour travels with the mean of the field's
/// velocities at its own and at this frame's position. With its own alone (paper) both neighbours overshoot by ½aΔt² to
/// the same side; the gain at angular frequency ω per frame is ½(1 + cos ω + sin² ω) = 1 + ω²/4 + …, 1.125 at 16.7 Hz and
/// 100 fps. With the mean it is ½(1 + cos ω + ½ sin² ω) = 1 − ω⁴/16 + …, never above 1, and zero at Nyquist as before.
/// *Deviation* (robust): strands stay inside the hull of the frame, which the paper's may leave.
/// *Deviation* (robust): a last warp restores the edges that averaging shortens, and the root particles are not averaged.
pub fn blend(
    input: &BlendInput,
    mode: Mode,
    settings: &BlendSettings,
    report: &mut Report,
) -> Result<StrandSequence, StageError> {
    let place = check(input)?;
    let samplers: Vec<VelocitySampler> = input.fields.iter().map(|field| VelocitySampler::new(field)).collect();
    let context = Context { input, mode, settings, samplers };
    let strand_count = input.sequence.strand_count;
    let mut blended: Vec<Option<Vec<DVec3>>> = (0..strand_count).into_par_iter().map(|n| context.strand(n)).collect();
    let mut completed = context.complete(&blended);
    if mode == Mode::Robust {
        let strands =
            blended.par_iter_mut().flatten().chain(completed.par_iter_mut().flatten().map(|(points, _)| points));
        context.keep_in_hull(strands);
    }

    let counts =
        (0..strand_count).map(|n| completed[n].as_ref().map_or(input.sequence.counts[n], |c| c.0.len() as u16));
    let frame = input.sequence.frames[input.at];
    let mut out = StrandSequence::missing(vec![frame], counts.collect(), input.sequence.point_count);
    for n in 0..strand_count {
        let (target, source) = (out.range(0, n), input.sequence.range(input.at, n));
        if let Some((points, confidence)) = &completed[n] {
            for (i, point) in target.zip(points) {
                (out.points[i], out.provenance[i], out.confidence[i]) =
                    (point.as_vec3(), Provenance::Completed, *confidence);
            }
        } else if let Some(points) = &blended[n] {
            for ((i, from), point) in target.zip(source).zip(points) {
                (out.points[i], out.confidence[i]) = (point.as_vec3(), input.sequence.confidence[from]);
                let provenance = input.sequence.provenance[from];
                let missing = provenance == Provenance::Missing;
                out.provenance[i] = if missing { Provenance::Simulated } else { provenance };
            }
        }
    }
    let number = completed.iter().flatten().count();
    if number * 2 > strand_count {
        let fact = format!("{number} of {strand_count} strands had to be completed");
        report.warn(place.clone(), fact, "the groom rests on a minority of reconstructed strands");
    }
    let absent = (0..strand_count).filter(|&n| completed[n].is_none() && blended[n].is_none()).count();
    if absent > 0 {
        report.warn(place, format!("{absent} strands have no neighbour to be completed from"), "they stay missing");
    }
    Ok(out)
}

fn check(input: &BlendInput) -> Result<Place, StageError> {
    let frames = input.sequence.frame_count();
    let place = Place::frame(input.sequence.frames.get(input.at).map_or(0, |f| *f as usize));
    let shapes = [input.fields.len(), input.world_from_head.len()];
    let strands = [input.roots.len(), input.residual_mm.len()];
    if input.at >= frames
        || shapes.iter().any(|len| *len != frames)
        || strands.iter().any(|len| *len != input.sequence.strand_count)
    {
        let fact = format!(
            "{frames} frames, {} fields, {} poses, {} strands, {} roots, {} residuals do not belong together",
            shapes[0], shapes[1], input.sequence.strand_count, strands[0], strands[1]
        );
        return Err(StageError::Input { place, fact, hint: "run the stages `fit` and `flow` again".into() });
    }
    Ok(place)
}

struct Context<'a> {
    input: &'a BlendInput<'a>,
    mode: Mode,
    settings: &'a BlendSettings,
    samplers: Vec<VelocitySampler<'a>>,
}

impl Context<'_> {
    /// Eq. 6 and 7 for one strand; `None` where it is absent or this frame lacks a point of it.
    fn strand(&self, n: usize) -> Option<Vec<DVec3>> {
        let here = self.points(self.input.at, n)?;
        if here.is_empty() {
            return None;
        }
        let gamma = self.settings.relaxation;
        let before = self.input.at.checked_sub(1).and_then(|t| self.warped(t, n, &here));
        let after = self.warped(self.input.at + 1, n, &here);
        let mut mixed = match (before, after) {
            (Some(before), Some(after)) => interpolate(&here, &before, &after, gamma),
            // At an end of the take the one neighbour counts once.
            (Some(one), None) | (None, Some(one)) => {
                here.iter().zip(&one).map(|(x, y)| *x * (1.0 - gamma) + *y * gamma).collect()
            }
            (None, None) => here.clone(),
        };
        if self.mode == Mode::Paper {
            return Some(mixed);
        }
        let roots = self.settings.root_particles.min(here.len());
        mixed[..roots].copy_from_slice(&here[..roots]);
        Some(warp(&mixed, self.input.edge_mm, &self.weights(), WARP_ITERATIONS).points)
    }

    /// All points of a strand in one frame \[mm\], `None` where the frame does not exist or lacks one.
    fn points(&self, t: usize, n: usize) -> Option<Vec<DVec3>> {
        let sequence = self.input.sequence;
        let points = (t < sequence.frame_count()).then(|| sequence.strand(t, n))?;
        points.iter().all(|p| p.is_finite()).then(|| points.iter().map(|p| p.as_dvec3()).collect())
    }

    /// δ(x, v) of a neighbouring frame: its strand carried along the field to this frame, lengths kept (eq. 6).
    fn warped(&self, t: usize, n: usize, here: &[DVec3]) -> Option<Vec<DVec3>> {
        let there = self.points(t, n)?;
        let at = self.input.at;
        let (secs, roots) = (self.input.frame_secs * (at as f64 - t as f64), self.settings.root_particles);
        let here_from_there = self.input.world_from_head[at].after(&self.input.world_from_head[t].inverse());
        let velocity = |sampler: &VelocitySampler, x: DVec3| sampler.at(x.as_vec3()).map(|v| v.as_dvec3());
        let wanted: Vec<DVec3> = (0..there.len())
            .map(|i| {
                let start = velocity(&self.samplers[t], there[i]);
                if self.mode == Mode::Paper {
                    return there[i] + start.unwrap_or(DVec3::ZERO) * secs;
                }
                if i < roots {
                    return here_from_there.point(there[i]);
                }
                match (start, velocity(&self.samplers[at], here[i])) {
                    (Some(a), Some(b)) => there[i] + (a + b) * (0.5 * secs),
                    (Some(v), None) | (None, Some(v)) => there[i] + v * secs,
                    (None, None) => here[i],
                }
            })
            .collect();
        Some(warp(&wanted, self.input.edge_mm, &self.weights(), WARP_ITERATIONS).points)
    }

    /// Brings strands that left the hull back to it, lengths kept. Beyond the hull some view shows what is behind the
    /// hair: a simulated swing or a borrowed shape cannot know that, the images do.
    fn keep_in_hull<'s>(&self, strands: impl ParallelIterator<Item = &'s mut Vec<DVec3>>) {
        let hull = SignedDistance::from_occupancy(&halved(self.input.hull));
        let outside = |point: DVec3| {
            let (distance, gradient) = hull.distance_and_gradient(point);
            let depth = distance - self.settings.hull_slack_mm;
            let normal = (-gradient).try_normalize().filter(|_| depth > 0.0)?;
            Some(Contact { depth, normal, on_head: false })
        };
        let held = self.settings.root_particles;
        strands.for_each(|points| {
            let given: Vec<f64> = points.windows(2).map(|pair| pair[0].distance(pair[1])).collect();
            lay_outside(points, held, |i| (given[i - 1], given[i - 1]), outside, |_, _| {});
        });
    }

    fn weights(&self) -> WarpWeights {
        match self.mode {
            Mode::Paper => WarpWeights::PAPER,
            Mode::Robust => WarpWeights {
                length: self.settings.length_weight,
                fixed: self.settings.root_particles,
                ..WarpWeights::ROBUST
            },
        }
    }

    /// Strands that are absent, each on the way of the nearest strand that a simulation explains well; with confidence.
    ///
    /// *Deviation*: the paper says no more than that missing fibres are completed. The mean way of several neighbours runs where
    /// none of them does and shakes wherever one of them does. Of all strands of two rendered captures (`evaluate`): occupancy F1
    /// 0.61, 0.64 -> 0.67, 0.67; jitter beyond the truth's 0.04, 0.07 -> -0.07, 0.04 mm.
    fn complete(&self, blended: &[Option<Vec<DVec3>>]) -> Vec<Option<(Vec<DVec3>, f32)>> {
        let lenders = self.lenders();
        (0..blended.len())
            .into_par_iter()
            .map(|n| {
                if blended[n].is_some() {
                    return None;
                }
                let near = nearest_roots(self.input.roots, n, &lenders, LENDERS_TRIED);
                let (squared, lent) = near.iter().find_map(|&(d, m)| Some((d, blended[m].as_deref()?)))?;
                // Of the nearest lender, whether this frame has it or not: all frames have the same count.
                let count = match self.input.sequence.counts[n] {
                    0 => self.input.sequence.counts[near[0].1],
                    count => count,
                };
                let root = self.input.world_from_head[self.input.at].point(self.input.roots[n]);
                let points = joined(root, count as usize, lent, self.input.edge_mm, self.settings.completion_join_mm)?;
                let trust = 0.5 * (-std::f64::consts::LN_2 * squared.sqrt() / self.settings.completion_half_mm).exp();
                Some((points, trust as f32))
            })
            .collect()
    }

    /// The strands that may lend their way. Counts and residuals are those of the whole take, so that a missing strand has the
    /// same lender in every frame.
    fn lenders(&self) -> Vec<usize> {
        let fitted: Vec<usize> = (0..self.input.roots.len()).filter(|&n| self.input.sequence.counts[n] > 1).collect();
        let residual = |n: &usize| self.input.residual_mm[*n];
        let mut known: Vec<f32> = fitted.iter().map(residual).filter(|r| r.is_finite()).collect();
        if known.is_empty() {
            return fitted;
        }
        let middle = known.len() / 2;
        let median = *known.select_nth_unstable_by(middle, f32::total_cmp).1;
        let most = self.settings.completion_residual * f64::from(median);
        fitted.into_iter().filter(|n| f64::from(residual(n)) <= most).collect()
    }
}

/// The voxels of twice the size that hold a voxel: an eighth of the work, and never smaller.
fn halved(occupancy: &Occupancy) -> Occupancy {
    let fine = occupancy.grid;
    let grid = fine.halved();
    let mut coarse = Occupancy::empty(grid);
    occupancy.indices().for_each(|voxel| coarse.set(grid.index(fine.coordinates(voxel).map(|k| k / 2)), true));
    coarse
}

/// Lenders that are looked at: the nearest may lack a point in this frame.
const LENDERS_TRIED: usize = 8;

/// A strand from `root` that comes to `lent` over `join_mm` of arc length and follows it, every edge `edge_mm` long; past its
/// end it goes on straight. `None` without points.
fn joined(root: DVec3, count: usize, lent: &[DVec3], edge_mm: f64, join_mm: f64) -> Option<Vec<DVec3>> {
    if lent.len() < 2 || count == 0 || !root.is_finite() {
        return None;
    }
    let last = lent[lent.len() - 1];
    let onward = last - lent[lent.len() - 2];
    let aside = root - lent[0];
    let mut points = vec![root];
    for i in 1..count {
        let way = lent.get(i).copied().unwrap_or_else(|| last + onward * (i + 1 - lent.len()) as f64);
        let aim = way + aside * (-(i as f64) * edge_mm / join_mm).exp();
        let before = points[i - 1];
        points.push(before + (aim - before).normalize_or(onward.normalize_or_zero()) * edge_mm);
    }
    Some(points)
}
