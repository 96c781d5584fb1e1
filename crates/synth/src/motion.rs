//! The head's motion: almost still, then a swing about the neck.

use glam::{DMat3, DVec3};
use strandflow_core::RigidTransform;

use crate::head::smooth_step;
use crate::spec::SynthSpec;

/// Where the head stands in the world \[mm\].
pub const STAND: DVec3 = DVec3::new(0.0, 0.0, 1250.0);

/// The pose from which the head moves.
pub(crate) fn at_rest() -> RigidTransform {
    RigidTransform { rotation: DMat3::IDENTITY, translation: STAND }
}

/// Joint of head and neck in the head frame \[mm\].
const PIVOT: DVec3 = DVec3::new(0.0, 20.0, -70.0);

/// The head's pose (world from head frame) at a time in frames; any real number, negative ones before the capture.
///
/// A drift of a few tenths of a degree at first, so that the quiet frames are not copies; after `quiet_frames` turn,
/// nod and sway swing in with zero speed.
pub fn pose(spec: &SynthSpec, frame: f64) -> RigidTransform {
    let motion = &spec.motion;
    let secs = frame / spec.rig.fps;
    let swinging = (frame - motion.quiet_frames as f64).max(0.0) / spec.rig.fps;
    let grow = smooth_step(swinging / 0.08);
    let phase = std::f64::consts::TAU * motion.rate_hz * swinging;
    let still = if motion.turn_deg == 0.0 { 0.0 } else { 0.25 * (4.0 * secs).sin() };
    let turn = motion.turn_deg * grow * phase.sin() + still;
    let nod = motion.nod_deg * grow * (0.8 * phase).sin();
    let rotation = DMat3::from_rotation_z(turn.to_radians()) * DMat3::from_rotation_x(nod.to_radians());
    let sway = DVec3::X * (motion.sway_mm * grow * (1.3 * phase).sin());
    RigidTransform { rotation, translation: STAND + sway + PIVOT - rotation * PIVOT }
}

/// The middle of the hand at a time in frames, world \[mm\]: around the head, up and down as it goes.
pub(crate) fn hand(spec: &SynthSpec, frame: f64) -> DVec3 {
    let turn = std::f64::consts::TAU * spec.hand.rate_hz * frame / spec.rig.fps;
    let around = DVec3::new(turn.sin(), -turn.cos(), 0.0) * spec.hand.distance_mm;
    STAND + around + DVec3::Z * (70.0 + 45.0 * (1.7 * turn).sin())
}
