//! The guides' motion: the springs of `strandflow-dynamics` at a finer step than the fit's, and contact with the head.

use glam::DVec3;
use rayon::prelude::*;
use strandflow_core::RigidTransform;
use strandflow_dynamics::{Forces, Model, Params, RestShape, State, Workspace, step};

use crate::body::Body;
use crate::groom::Groom;
use crate::head::{distance, normal};
use crate::motion::{at_rest, pose};
use crate::spec::SynthSpec;

/// Drag while the hair settles before the capture \[1/s\].
const SETTLING_DRAG: f64 = 25.0;

/// Steps a frame while the hair settles: where it comes to rest does not depend on the step.
const SETTLING_SUBSTEPS: usize = 4;

/// Clamped particles of a strand, as in the fit.
const CLAMPED: usize = 3;

/// The guides at frames `first`, `first + 1`, …: shape (frames, guides, particles), head frame \[mm\].
#[derive(Clone, Debug)]
pub(crate) struct GuideMotion {
    /// First frame, zero or negative.
    pub first: i64,
    /// Positions.
    pub frames: Vec<Vec<Vec<DVec3>>>,
}

impl GuideMotion {
    /// The guides at a time in frames, interpolated linearly, clamped to what was simulated.
    pub(crate) fn at(&self, frame: f64) -> Vec<Vec<DVec3>> {
        let t = (frame - self.first as f64).clamp(0.0, (self.frames.len() - 1) as f64);
        let (i, share) = (t as usize, t.fract());
        if share == 0.0 {
            return self.frames[i].clone();
        }
        let (a, b) = (&self.frames[i], &self.frames[i + 1]);
        a.iter().zip(b).map(|(a, b)| a.iter().zip(b).map(|(p, q)| p.lerp(*q, share)).collect()).collect()
    }
}

/// Simulates the guides over the capture and as far around it as views are out of step and shutters open.
pub(crate) fn simulate(spec: &SynthSpec, groom: &Groom) -> GuideMotion {
    let margin = (spec.noise.sync_ms * 1e-3 * spec.rig.fps + 0.5 * spec.noise.shutter).ceil() as i64;
    let (first, last) = (-margin, spec.rig.frames as i64 - 1 + margin);
    let count = spec.groom.guides.min(groom.strands.len());
    let guides: Vec<Vec<Vec<DVec3>>> = (0..count)
        .into_par_iter()
        .map(|g| simulate_guide(spec, &groom.strands[g], groom.layers[g], first, last))
        .collect();
    let frames =
        (0..(last - first + 1) as usize).map(|t| guides.iter().map(|guide| guide[t].clone()).collect()).collect();
    GuideMotion { first, frames }
}

fn simulate_guide(spec: &SynthSpec, rest: &[DVec3], layer: f64, first: i64, last: i64) -> Vec<Vec<DVec3>> {
    let physics = &spec.physics;
    let interval = |substeps: usize| 1.0 / (spec.rig.fps * substeps as f64);
    let model = Model::new(RestShape::from_positions(rest, spec.groom.edge_mm), CLAMPED);
    let params = |drag| Params {
        stiffness: physics.stiffness,
        damping: physics.stiffness.map(|k| k * physics.damping_secs),
        drag,
    };
    // Hair keeps some of the height it was combed to: the layers below it carry it.
    let kept = |height: f64| (0.75 * height.min(layer)).max(physics.clearance_mm.min(height));
    let keep: Vec<f64> = rest.iter().map(|&p| kept(distance(p))).collect();
    let body = Body::of(spec).map(|body| {
        let keep: Vec<f64> = rest.iter().map(|&p| kept(body.distance(at_rest().point(p)))).collect();
        (body, keep)
    });
    let start = pose(spec, first as f64);
    let world: Vec<DVec3> = rest.iter().map(|&p| start.point(p)).collect();
    let (mut state, mut workspace) = (State::at_rest(&world), Workspace::new(&model));
    let mut advance = |state: &mut State, from: RigidTransform, to: RigidTransform, dt: f64, params: &Params| {
        let root: Vec<DVec3> = rest[..CLAMPED.min(rest.len())].iter().map(|&p| to.point(p)).collect();
        step(&model, params, state, &mut workspace, dt, &root, &Forces::default());
        collide(state, &from, &to, dt, &keep, physics.friction);
        if let Some((body, keep)) = &body {
            collide_with_body(state, body, dt, keep, physics.friction);
        }
    };
    let dt = interval(SETTLING_SUBSTEPS);
    for _ in 0..(physics.settle_secs / dt).round() as usize {
        advance(&mut state, start, start, dt, &params(SETTLING_DRAG));
    }
    let local = |state: &State, frame: f64| {
        let head_from_world = pose(spec, frame).inverse();
        state.x.iter().map(|&x| head_from_world.point(x)).collect::<Vec<_>>()
    };
    let mut out = vec![local(&state, first as f64)];
    for frame in first..last {
        for s in 0..physics.substeps {
            let at = |s: usize| pose(spec, frame as f64 + s as f64 / physics.substeps as f64);
            advance(&mut state, at(s), at(s + 1), interval(physics.substeps), &params(physics.drag));
        }
        out.push(local(&state, frame as f64 + 1.0));
    }
    out
}

/// As [`collide`], with what stands still.
fn collide_with_body(state: &mut State, body: &Body, dt: f64, keep: &[f64], friction: f64) {
    for ((x, v), &keep) in state.x.iter_mut().zip(&mut state.v).zip(keep).skip(CLAMPED) {
        let d = body.distance(*x);
        if d >= keep {
            continue;
        }
        let out = body.normal(*x);
        *x += out * (keep - d);
        *v -= taken(*v, out, friction * dt);
    }
}

/// What contact takes of a speed against a surface: all of it inwards, and some of it along.
fn taken(relative: DVec3, out: DVec3, slowing: f64) -> DVec3 {
    let across = relative.dot(out);
    let along = relative - out * across;
    out * across.min(0.0) + along * (1.0 - (-slowing).exp())
}

/// Moves particles out to the height they keep, and takes away the speed into the head and some of that along it.
fn collide(state: &mut State, from: &RigidTransform, to: &RigidTransform, dt: f64, keep: &[f64], friction: f64) {
    let head_from_world = to.inverse();
    for ((x, v), &keep) in state.x.iter_mut().zip(&mut state.v).zip(keep).skip(CLAMPED) {
        let p = head_from_world.point(*x);
        let d = distance(p);
        if d >= keep {
            continue;
        }
        let n = normal(p);
        let out = to.vector(n);
        let skin = (to.point(p) - from.point(p)) / dt;
        *x = to.point(p + n * (keep - d));
        *v -= taken(*v - skin, out, friction * dt);
    }
}
