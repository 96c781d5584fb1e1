//! A take whose strands are trimmed and whose next stage is `fit`: as many strands and frames as are asked for, of motions that a
//! simulation explains, with noise. All before has records of being done, and only of that which `fit` reads are there results.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use strandflow_core::RigidTransform;
use strandflow_dynamics::{Forces, Model, Params, RestShape, State, Workspace, step};
use strandflow_engine::{
    Item, Take,
    item::BLOCK_STRANDS,
    store::Writer,
    table::{Job, phases},
};

use super::records::{self, PARTICLES};

/// Different motions; each strand has noise of its own.
const KINDS: usize = 16;
/// Noise per coordinate \[mm\].
const NOISE_MM: f64 = 3.0;

/// Makes the take. Strands that `spoilt` takes are seen at another side of the head in every third frame.
pub fn take(root: &Path, strands: usize, frames: usize, spoilt: impl Fn(usize) -> bool + Sync) -> PathBuf {
    let (capture, folder) = super::take(root);
    records::lengthen(&capture, frames);
    finish_before_fit(&folder, strands, frames, &spoilt);
    folder
}

/// Records of all items before `fit`, and of their results those that it reads.
fn finish_before_fit(folder: &Path, strands: usize, frames: usize, spoilt: &(impl Fn(usize) -> bool + Sync)) {
    let take = Take::open(folder).unwrap();
    let plan = take.plan(None, None).unwrap();
    take.write_resolved(&plan).unwrap();
    assert_eq!(plan.frames.end, frames);
    let secs = take.frame_secs();
    let kinds: Vec<Vec<DVec3>> = (0..KINDS).into_par_iter().map(|kind| motion(kind, frames, secs)).collect();
    let job = Job::new(&take, &plan);
    let store = take.store();
    for (stage, phase) in phases().take_while(|(stage, _)| stage.name != "fit") {
        if phase.name == "smooth/trim" {
            let (shape, chunk) = ([frames, strands, PARTICLES, 3], [1, BLOCK_STRANDS, PARTICLES, 3]);
            let null = || serde_json::Value::Null;
            store.ensure("smooth/points", &shape, &chunk, null()).unwrap();
            store.ensure("smooth/provenance", &shape[..3], &chunk[..3], null()).unwrap();
            store.ensure("smooth/confidence", &shape[..3], &chunk[..3], null()).unwrap();
            store.ensure("smooth/counts", &[strands], &[BLOCK_STRANDS], null()).unwrap();
        }
        for &item in phase.chains(&job).unwrap().iter().flatten() {
            let inputs = stage.inputs(phase, &job, item).unwrap();
            let mut out = Writer::new(store);
            match (phase.name, item) {
                ("smooth/trim", Item::Block(block)) => {
                    let true_point = |strand: usize, t: usize, i: usize| {
                        kinds[(strand + if spoilt(strand) { 5 * (t % 3 / 2) } else { 0 }) % KINDS][t * PARTICLES + i]
                    };
                    write_block(&mut out, block, (strands, frames), &true_point);
                }
                (name, Item::Take) => records::by_value(name, &mut out, frames, strands, |t| head(t as f64 * secs)),
                _ => {}
            }
            out.finish(&item.key(phase.name), inputs.hashes, Vec::new()).unwrap();
        }
    }
}

fn write_block(
    out: &mut Writer,
    block: usize,
    (strands, frames): (usize, usize),
    true_point: &(impl Fn(usize, usize, usize) -> DVec3 + Sync),
) {
    let first = block * BLOCK_STRANDS;
    let here = BLOCK_STRANDS.min(strands - first);
    let present = |e: usize| e / PARTICLES < here;
    let samples = BLOCK_STRANDS * PARTICLES;
    for t in 0..frames {
        let point = |e: usize| {
            let (strand, i) = (first + e / PARTICLES, e % PARTICLES);
            let noise = if i < 3 { DVec3::ZERO } else { noise(((strand * frames + t) * PARTICLES + i) as u64) };
            if present(e) { (true_point(strand, t, i) + noise).as_vec3().to_array() } else { [f32::NAN; 3] }
        };
        let points: Vec<[f32; 3]> = (0..samples).into_par_iter().map(point).collect();
        let flag = |value: u8| (0..samples).map(|e| if present(e) { value } else { 0 }).collect::<Vec<u8>>();
        out.chunk("smooth/points", &[t, block, 0, 0], points.as_flattened()).unwrap();
        out.chunk("smooth/provenance", &[t, block, 0], &flag(1)).unwrap();
        out.chunk("smooth/confidence", &[t, block, 0], &flag(255)).unwrap();
    }
    let counts: Vec<u16> = (0..BLOCK_STRANDS).map(|n| if n < here { PARTICLES as u16 } else { 0 }).collect();
    out.chunk("smooth/counts", &[block], &counts).unwrap();
}

/// The head: ±30° about the vertical, 1.4 times a second.
fn head(secs: f64) -> RigidTransform {
    let angle = 0.5 * (std::f64::consts::TAU * 1.4 * secs).sin();
    RigidTransform { rotation: DMat3::from_rotation_z(angle), translation: DVec3::ZERO }
}

/// A strand under the head, shape (T, n): curls of a width and a side of the head of its own.
fn motion(kind: usize, frames: usize, secs: f64) -> Vec<DVec3> {
    let width = 0.6 * kind as f64;
    let curl = |i: usize| {
        let turn = 0.9 * i as f64;
        DVec3::new(width * turn.cos(), width * turn.sin(), -5.0 * i as f64)
    };
    let side = DMat3::from_rotation_z(std::f64::consts::TAU * kind as f64 / KINDS as f64);
    let mut rest = vec![side * DVec3::new(90.0, 0.0, 0.0)];
    for i in 1..PARTICLES {
        rest.push(rest[i - 1] + 5.0 * (side * (curl(i) - curl(i - 1))).normalize());
    }
    let model = Model::new(RestShape::from_positions(&rest, 5.0), 3);
    let (mut state, mut workspace) = (State::at_rest(&rest), Workspace::new(&model));
    let steps = (secs / 1e-3).ceil() as usize;
    let dt = secs / steps as f64;
    let mut points = Vec::with_capacity(frames * PARTICLES);
    for t in 0..frames {
        points.extend_from_slice(&state.x);
        for k in 1..=steps {
            let at = head(t as f64 * secs + k as f64 * dt);
            let roots: Vec<DVec3> = rest[..3].iter().map(|p| at.point(*p)).collect();
            step(&model, &Params::default(), &mut state, &mut workspace, dt, &roots, &Forces::default());
        }
    }
    points
}

/// Nearly normal noise, by a hash.
fn noise(sample: u64) -> DVec3 {
    let unit = |e: u64| {
        let h = (e + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let h = (h ^ (h >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        ((h ^ (h >> 32)) & 0xff_ffff) as f64 / f64::from(1 << 24) - 0.5
    };
    let axis = |axis: u64| NOISE_MM * 3f64.sqrt() * (0..4).map(|k| unit(12 * sample + 4 * axis + k)).sum::<f64>();
    DVec3::new(axis(0), axis(1), axis(2))
}
