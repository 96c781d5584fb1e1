//! Strands of the frame before, carried into this one along the motion of the hair.

use glam::Vec3;
use strandflow_core::{RigidTransform, Strands};
use strandflow_geometry::polyline::at_parameter;
use strandflow_volume::velocity::VelocitySampler;

use super::Before;

/// Points of a carried strand from one that asks for its motion to the next: 6 mm at a step of 2 mm, while the motion is
/// smooth over 10 mm and more.
const ASKING: usize = 3;

/// Carries the strands of the frame before into this one.
pub(super) struct Carrier<'a> {
    strands: &'a Strands,
    motion: VelocitySampler<'a>,
    now_from_before: RigidTransform,
}

impl<'a> Carrier<'a> {
    pub(super) fn new(before: &Before<'a>, world_from_head: RigidTransform) -> Self {
        let now_from_before = world_from_head.after(&before.world_from_head.inverse());
        Self { strands: before.strands, motion: VelocitySampler::new(before.motion), now_from_before }
    }

    /// Where the points of a strand have got to. One in [`ASKING`], and the last, asks for its motion; those between move
    /// as their neighbours do.
    pub(super) fn carried(&self, strand: usize) -> Vec<Vec3> {
        let points = self.strands.strand(strand);
        let Some(last) = points.len().checked_sub(1) else { return Vec::new() };
        let asking = (0..last).step_by(ASKING).chain([last]);
        let moves: Vec<Vec3> = asking.map(|i| self.place(points[i]) - points[i]).collect();
        let moved = |i: usize| {
            let from = i - i % ASKING;
            let share = (i - from) as f32 / ASKING.min(last - from).max(1) as f32;
            points[i] + at_parameter(&moves, (i / ASKING) as f32 + share)
        };
        (0..=last).map(moved).collect()
    }

    /// The motion is known where the hair is now, so y = x + u(y) is iterated from where the head's motion alone would have
    /// brought the point.
    fn place(&self, x: Vec3) -> Vec3 {
        let rigid = self.now_from_before.point(x.as_dvec3()).as_vec3();
        (0..3).fold(rigid, |y, _| self.motion.at(y).map_or(rigid, |u| x + u))
    }
}
