//! A groom of any kind driven by the captured motion (§5.5): placed on the scalp, carried by the velocity field and the head's
//! pose, kept in shape by its springs and out of the head.

use glam::{DVec3, Vec3};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use strandflow_core::{RigidTransform, SparseVoxels};
use strandflow_dynamics::{
    Params,
    driven::{CLAMPED, Contact, DriveOptions, DrivenState, Hung, Surroundings, advance_frame, lay_outside},
};
use strandflow_geometry::signed_distance::SignedDistance;
use strandflow_volume::velocity::VelocitySampler;

use crate::SettingViolation;

pub mod place;
mod standing;
pub mod timeline;

pub use place::{Alignment, PlacedGroom, place};
pub use standing::Standing;
pub use timeline::Timeline;

/// Settings of an animation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AnimateSettings {
    /// Whether the field drives at all; without it the groom is simulated on the moving head.
    pub driven: bool,
    /// Time over which hair's velocity goes to the field's \[s\]. At 0 it goes where the field goes (the paper); from 0.1 on the
    /// groom's own swing prevails.
    pub follow_secs: f64,
    /// Factor of the field's motion beside the head's: 0 moves with the head, 1 as captured.
    pub amplitude: f64,
    /// Factor of the bending, torsion and altitude stiffness.
    pub stiffness: f64,
    /// Factor of the spring damping.
    pub damping: f64,
    /// Drag \[1/s\].
    pub drag: f64,
    /// Standard deviation of the logarithm of a strand's stiffness: strands that differ do not swing in step.
    pub variation: f64,
    /// Seed of the variation.
    pub seed: u64,
    /// Steps a frame; five are 2 ms at 100 frames a second.
    pub substeps: usize,
    /// Distance that hair keeps from the head \[mm\].
    pub clearance_mm: f64,
    /// Rate at which contact takes away speed along the head \[1/s\].
    pub friction: f64,
}

impl Default for AnimateSettings {
    fn default() -> Self {
        Self {
            driven: true,
            follow_secs: 0.0,
            amplitude: 1.0,
            stiffness: 1.0,
            damping: 1.0,
            drag: 5.0,
            variation: 0.0,
            seed: 0,
            substeps: 5,
            clearance_mm: 0.5,
            friction: 20.0,
        }
    }
}

impl AnimateSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        let mut found = Vec::new();
        let mut real = |field: &str, value: f64, (low, high): (f64, f64), reason: &str| {
            let ok = value >= low && value <= high;
            SettingViolation::unless(ok, &mut found, (field, value), (&format!("{low}..={high}"), reason));
        };
        real("follow_secs", self.follow_secs, (0.0, 10.0), "longer, and the field means nothing");
        real("amplitude", self.amplitude, (0.0, 5.0), "hair that is thrown further leaves its springs' range");
        real("stiffness", self.stiffness, (1e-3, 1e3), "a factor of the captured hair's");
        real("damping", self.damping, (0.0, 1e3), "a factor");
        real("drag", self.drag, (0.0, 1e3), "hair falls through air");
        real("variation", self.variation, (0.0, 2.0), "a standard deviation of a logarithm");
        real("substeps", self.substeps as f64, (1.0, 100.0), "the springs are tuned for 2 ms");
        real("clearance_mm", self.clearance_mm, (0.0, 20.0), "a distance from the skin");
        real("friction", self.friction, (0.0, 1e4), "a rate");
        found
    }

    /// Spring parameters of strand `n`, around those given.
    fn params(&self, base: &Params, n: usize) -> Params {
        let mut rng = Pcg64Mcg::seed_from_u64(self.seed ^ (n as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15));
        // The sum of twelve uniform numbers: nearly normal, and the same everywhere.
        let deviation = (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
        let factor = self.stiffness * (self.variation * deviation).exp();
        let mut stiffness = base.stiffness;
        stiffness[1..].iter_mut().for_each(|k| *k *= factor);
        let damping = [0, 1, 2, 3].map(|i| base.damping[i] / base.stiffness[i] * stiffness[i] * self.damping);
        Params { stiffness, damping, drag: self.drag }
    }
}

/// A placed groom with its springs, ready to be driven.
pub struct Animation {
    strands: Vec<Hung>,
    settings: AnimateSettings,
    gravity: DVec3,
    frame_secs: f64,
}

/// What moves an animation over one of its frames.
pub struct Captured<'a> {
    /// Head poses and velocity fields of the captured frames from `first` on.
    pub first: usize,
    /// World from head.
    pub poses: &'a [RigidTransform],
    /// Velocities \[mm/s\].
    pub fields: &'a [&'a SparseVoxels<Vec3>],
    /// What hair may not enter.
    pub obstacles: Obstacles<'a>,
}

/// What hair may not enter.
#[derive(Clone, Copy)]
pub struct Obstacles<'a> {
    /// Signed distance of head and neck, head space.
    pub skin: &'a SignedDistance,
    /// Signed distance of what stands still, such as shoulders, world.
    pub still: Option<&'a SignedDistance>,
}

impl Obstacles<'_> {
    /// How far a point, world, is from the nearest of them \[mm\], negative inside.
    pub fn distance(&self, head_from_world: &RigidTransform, point: DVec3) -> f64 {
        let still = self.still.map_or(f64::INFINITY, |still| still.distance(point));
        self.skin.distance(head_from_world.point(point)).min(still)
    }

    /// What a point, world, meets within a clearance \[mm\].
    fn meets(&self, world_from_head: &RigidTransform, point: DVec3, clearance: f64) -> Option<Contact> {
        let way = |distance: &SignedDistance, from: DVec3| place::lifted(from, distance, clearance) - from;
        let contact = |way: DVec3, on_head| Contact { depth: way.length(), normal: way.normalize_or_zero(), on_head };
        let in_head = world_from_head.inverse().point(point);
        if self.skin.distance(in_head) < clearance {
            return Some(contact(world_from_head.vector(way(self.skin, in_head)), true));
        }
        let still = self.still.filter(|still| still.distance(point) < clearance)?;
        Some(contact(way(still, point), false))
    }
}

impl Animation {
    /// Gives a placed groom its springs.
    ///
    /// `params`: by strand, e.g. of the captured strand nearest to its root. `gravity` \[mm/s²\], world; `first_pose`: the
    /// head as the groom was made for it.
    pub fn new(
        groom: &PlacedGroom,
        params: impl Fn(usize) -> Params,
        settings: &AnimateSettings,
        (gravity, first_pose): (DVec3, RigidTransform),
        frame_secs: f64,
    ) -> Self {
        let down = first_pose.inverse().vector(gravity);
        let hang = |(n, strand): (usize, &Vec<DVec3>)| {
            let edges = strand.len().saturating_sub(1).max(1) as f64;
            let edge_mm = strand.windows(2).map(|p| p[0].distance(p[1])).sum::<f64>() / edges;
            Hung::new(strand.clone(), settings.params(&params(n), n), down, edge_mm.max(LEAST_EDGE_MM))
        };
        let strands = groom.strands.iter().enumerate().map(hang).collect();
        Self { strands, settings: settings.clone(), gravity, frame_secs }
    }

    /// Particles of each strand.
    pub fn counts(&self) -> Vec<usize> {
        self.strands.iter().map(Hung::particle_count).collect()
    }

    /// The groom where the head puts it, outside of what stands still.
    pub fn start(&self, world_from_head: &RigidTransform, obstacles: &Obstacles) -> DrivenState {
        let meets = |p: DVec3| obstacles.meets(world_from_head, p, self.settings.clearance_mm);
        let start = |strand: &Hung| {
            let mut points: Vec<DVec3> = strand.in_head.iter().map(|p| world_from_head.point(*p)).collect();
            if obstacles.still.is_some() {
                let edges: Vec<f64> = points.windows(2).map(|p| p[0].distance(p[1])).collect();
                lay_outside(&mut points, CLAMPED, |i| (edges[i - 1], edges[i - 1]), meets, |_, _| {});
            }
            points.into_iter().map(|p| p.as_vec3()).collect::<Vec<_>>()
        };
        let points = self.strands.par_iter().map(start).collect::<Vec<_>>().concat();
        DrivenState { velocities: vec![Vec3::ZERO; points.len()], points }
    }

    /// Advances the state from frame `k` of the timeline to the next.
    ///
    /// `captured` must hold the frames that [`needed`] names.
    pub fn advance(&self, state: &mut DrivenState, k: usize, timeline: &Timeline, captured: &Captured) {
        let samplers = captured.fields.iter().map(|field| VelocitySampler::new(field)).collect();
        let around = Around { animation: self, captured, samplers, timeline, k: k as f64 };
        let settings = &self.settings;
        let options = DriveOptions {
            follow_secs: if settings.driven { settings.follow_secs } else { f64::INFINITY },
            frame_secs: self.frame_secs,
            substeps: settings.substeps,
            gravity: self.gravity,
            friction: settings.friction,
        };
        advance_frame(&self.strands, state, &around, &options);
    }

    /// How the state stands to the groom and what it may not enter.
    pub fn check(&self, state: &DrivenState, world_from_head: &RigidTransform, obstacles: &Obstacles) -> FrameCheck {
        let head_from_world = world_from_head.inverse();
        let mut check = FrameCheck::default();
        let mut start = 0;
        for strand in &self.strands {
            let points = &state.points[start..start + strand.particle_count()];
            start += points.len();
            let inside = |p: DVec3| obstacles.distance(&head_from_world, p) < -TOUCHING_MM;
            let free = points.get(CLAMPED - 1..).unwrap_or_default();
            let through = free.iter().skip(1).any(|p| inside(p.as_dvec3()))
                || free.windows(2).any(|p| inside(p[0].lerp(p[1], 0.5).as_dvec3()));
            check.in_head += usize::from(through);
            let length = |points: &mut dyn Iterator<Item = DVec3>| {
                let mut last = points.next().unwrap_or_default();
                points.fold(0.0, |sum, p| sum + std::mem::replace(&mut last, p).distance(p))
            };
            let rest = length(&mut strand.in_head.iter().copied());
            if rest > 0.0 {
                let change = (length(&mut points.iter().map(|p| p.as_dvec3())) / rest - 1.0).abs();
                check.length_change_sum += change;
                check.length_change_most = check.length_change_most.max(change);
                check.strands += 1;
            }
        }
        check
    }
}

/// Strands that touch the skin are not in it \[mm\]: single precision at a metre from the origin, and what the distance errs
/// between its samples.
const TOUCHING_MM: f64 = 0.1;
/// Mean edges below this would make every triangle flat \[mm\].
const LEAST_EDGE_MM: f64 = 0.05;

/// What one frame of an animation looks like.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameCheck {
    /// Strands looked at.
    pub strands: usize,
    /// Strands with a point, or the middle of an edge, in the head or in what stands still.
    pub in_head: usize,
    /// Sum and most of the strands' relative change of length against the groom.
    pub length_change_sum: f64,
    /// See `length_change_sum`.
    pub length_change_most: f64,
}

impl FrameCheck {
    /// Strands, strands in the head, sum and most of the changes.
    pub fn to_array(&self) -> [f64; 4] {
        [self.strands as f64, self.in_head as f64, self.length_change_sum, self.length_change_most]
    }

    /// From the order of [`FrameCheck::to_array`].
    pub fn from_array([strands, in_head, length_change_sum, length_change_most]: [f64; 4]) -> Self {
        Self { strands: strands as usize, in_head: in_head as usize, length_change_sum, length_change_most }
    }
}

/// The captured frames that frame `k` of a timeline and the way to the next one need.
pub fn needed(timeline: &Timeline, k: usize) -> std::ops::RangeInclusive<usize> {
    let times = (0..=8).map(|i| timeline.source(k as f64 + f64::from(i) / 8.0));
    let (low, high) = times.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), t| (l.min(t), h.max(t)));
    low.floor() as usize..=(high.ceil() as usize).min(timeline.last)
}

/// The captured motion around one frame of an animation.
struct Around<'a> {
    animation: &'a Animation,
    captured: &'a Captured<'a>,
    samplers: Vec<VelocitySampler<'a>>,
    timeline: &'a Timeline,
    k: f64,
}

impl Around<'_> {
    /// Indices of the captured frames before and after a time, and the share of the later one.
    fn between(&self, time: f64) -> (usize, usize, f64) {
        let last = self.captured.poses.len() - 1;
        let t = (time - self.captured.first as f64).clamp(0.0, last as f64);
        let before = (t as usize).min(last);
        (before, (before + 1).min(last), t - before as f64)
    }

    fn time(&self, share: f64) -> f64 {
        self.timeline.source(self.k + share)
    }
}

impl Surroundings for Around<'_> {
    fn world_from_head(&self, share: f64) -> RigidTransform {
        pose_at(self.captured.poses, self.between(self.time(share)))
    }

    fn velocity(&self, share: f64, point: DVec3) -> Option<DVec3> {
        let (a, b, later) = self.between(self.time(share));
        let at = |i: usize| self.samplers[i].at(point.as_vec3()).map(|v| v.as_dvec3());
        let captured = match (at(a), at(b)) {
            (Some(before), Some(after)) => before.lerp(after, later),
            (one, other) => one.or(other)?,
        };
        // Captured frames a frame, here: the speed with its sign.
        const STEP: f64 = 0.05;
        let (from, to) = ((self.k + share - STEP).max(0.0), self.k + share + STEP);
        let rate = (self.timeline.source(to) - self.timeline.source(from)) / (to - from);
        let amplitude = self.animation.settings.amplitude;
        if amplitude == 1.0 {
            return Some(captured * rate);
        }
        let head = head_velocity(self.captured.poses, (a, b, later), point) / self.animation.frame_secs;
        Some((head + amplitude * (captured - head)) * rate)
    }

    fn contact(&self, share: f64, point: DVec3) -> Option<Contact> {
        self.captured.obstacles.meets(&self.world_from_head(share), point, self.animation.settings.clearance_mm)
    }
}

/// The pose between two captured ones: rotation about one axis at even speed, translation straight.
pub fn pose_at(poses: &[RigidTransform], (a, b, share): (usize, usize, f64)) -> RigidTransform {
    let (from, to) = (poses[a], poses[b]);
    let turn = |pose: &RigidTransform| glam::DQuat::from_mat3(&pose.rotation);
    RigidTransform {
        rotation: glam::DMat3::from_quat(turn(&from).slerp(turn(&to), share)),
        translation: from.translation.lerp(to.translation, share),
    }
}

/// Velocity of a point that [`pose_at`] moves \[mm/frame\].
fn head_velocity(poses: &[RigidTransform], (a, b, share): (usize, usize, f64), point: DVec3) -> DVec3 {
    let (from, to) = (poses[a], poses[b]);
    let turn = glam::DQuat::from_mat3(&(to.rotation * from.rotation.transpose())).to_scaled_axis();
    let middle = from.translation.lerp(to.translation, share);
    turn.cross(point - middle) + to.translation - from.translation
}

#[cfg(test)]
mod tests;
