//! What `fit` costs as takes grow: whole takes from the store to the store, by the program, over strands and over frames.
//! `cargo bench -p strandflow --bench fit_scale` prints a table (`docs/dynamics.md`) and leaves two plots in `target/fit-scale`.
//! With `-- STRANDSxFRAMES …` only takes of these sizes.
#![expect(clippy::unwrap_used, reason = "a bench: a failing unwrap ends it")]
#![expect(clippy::print_stdout, reason = "its table")]

#[path = "../tests/all/common/mod.rs"]
#[allow(dead_code, reason = "helpers of the tests")]
mod common;

use std::path::Path;

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
use strandflow_report::{Axis, Mark, Plot, Tone};

use common::{cameras, stderr, strandflow, text};

/// Particles of every strand.
const PARTICLES: usize = 40;
/// Different motions; each strand has noise of its own.
const KINDS: usize = 16;
/// Noise per coordinate \[mm\].
const NOISE_MM: f64 = 3.0;

/// Strands and frames: the paper's largest hairstyles' length and Table 1's first row at the end, then longer takes.
const OVER_STRANDS: [(usize, usize); 4] = [(1024, 200), (2048, 200), (4096, 200), (7421, 200)];
const OVER_FRAMES: [(usize, usize); 4] = [(512, 200), (512, 500), (512, 1000), (512, 2000)];

/// What a take cost.
struct Cost {
    strands: usize,
    frames: usize,
    secs: f64,
    peak_mb: f64,
}

fn main() {
    let asked: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with('-')).collect();
    let sizes: Vec<(usize, usize)> = asked
        .iter()
        .filter_map(|arg| arg.split_once('x').and_then(|(n, t)| Some((n.parse().ok()?, t.parse().ok()?))))
        .collect();
    let all = if sizes.is_empty() { [OVER_STRANDS, OVER_FRAMES].concat() } else { sizes };
    println!("{:>8}{:>8}{:>10}{:>24}{:>10}", "strands", "frames", "seconds", "ms a strand and frame", "peak MB");
    let costs: Vec<Cost> = all
        .into_iter()
        .map(|(strands, frames)| {
            let cost = cost(strands, frames);
            let each = 1e3 * cost.secs / (strands * frames) as f64;
            println!("{strands:>8}{frames:>8}{:>10.1}{each:>24.4}{:>10.0}", cost.secs, cost.peak_mb);
            cost
        })
        .collect();
    if costs.len() == OVER_STRANDS.len() + OVER_FRAMES.len() {
        plots(&costs);
    }
}

/// Makes a take of trimmed strands and lets the program fit it.
fn cost(strands: usize, frames: usize) -> Cost {
    let root = tempfile::tempdir().unwrap();
    let (capture, folder) = common::take(root.path());
    for camera in cameras() {
        // The images of the capture over and over, by links; nobody looks at them.
        let images = capture.join("images").join(&camera.name);
        for frame in common::FRAMES..frames {
            let of = images.join(format!("{:06}.png", frame % common::FRAMES));
            std::fs::hard_link(of, images.join(format!("{frame:06}.png"))).unwrap();
        }
    }
    finish_before_fit(&folder, strands, frames.max(common::FRAMES));
    let ran = strandflow(&["run", text(&folder), "--from", "fit", "--to", "fit", "--json"]);
    assert!(ran.status.success(), "{}", stderr(&ran));
    let events = String::from_utf8(ran.stdout).unwrap();
    let events = events.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let phase = events.into_iter().find(|event| event["event"] == "phase_finished").unwrap();
    let take = Take::open(&folder).unwrap();
    let kept = take.store().read_all::<u16>("fit/counts").unwrap().iter().filter(|&&count| count > 0).count();
    assert!(kept as f64 > 0.95 * strands as f64, "{kept} of {strands} strands were fitted");
    Cost {
        strands,
        frames: frames.max(common::FRAMES),
        secs: phase["secs"].as_f64().unwrap(),
        peak_mb: phase["peak_mb"].as_f64().unwrap_or(f64::NAN),
    }
}

/// Records of all items before `fit`, and of their results those that it reads.
fn finish_before_fit(folder: &Path, strands: usize, frames: usize) {
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
                ("pose/pose", Item::Take) => {
                    let rows: Vec<f64> =
                        (0..frames).flat_map(|t| head(t as f64 * secs).to_rows().as_flattened().to_vec()).collect();
                    out.whole("pose/world_from_head", &[frames, 4, 4], &rows).unwrap();
                    let views = cameras().len();
                    out.whole("pose/markers", &[frames, 1, 3], &vec![0.0f64; 3 * frames]).unwrap();
                    out.whole("pose/tracks", &[frames, views, 1, 2], &vec![0.0f64; 2 * views * frames]).unwrap();
                    out.whole("pose/rms_px", &[frames], &vec![0.0f64; frames]).unwrap();
                    out.whole("pose/used", &[frames], &vec![0u32; frames]).unwrap();
                    out.whole("pose/interpolated", &[frames], &vec![0u8; frames]).unwrap();
                }
                ("hull/grid", Item::Take) => {
                    out.whole("hull/grid/origin", &[3], &[0.0f64; 3]).unwrap();
                    out.whole("hull/grid/voxel_mm", &[1], &[5.0f64]).unwrap();
                    out.whole("hull/grid/dims", &[3], &[8u32; 3]).unwrap();
                }
                ("scalp/scalp", Item::Take) => {
                    out.whole("scalp/roots", &[strands, 3], &vec![0.0f64; 3 * strands]).unwrap();
                }
                ("smooth/topology", Item::Take) => {
                    out.whole("smooth/point_count", &[1], &[PARTICLES as u32]).unwrap();
                }
                ("smooth/trim", Item::Block(block)) => write_block(&mut out, block, strands, frames, &kinds),
                _ => {}
            }
            out.finish(&item.key(phase.name), inputs.hashes, Vec::new()).unwrap();
        }
    }
}

fn write_block(out: &mut Writer, block: usize, strands: usize, frames: usize, kinds: &[Vec<DVec3>]) {
    let first = block * BLOCK_STRANDS;
    let here = BLOCK_STRANDS.min(strands - first);
    let present = |e: usize| e / PARTICLES < here;
    let samples = BLOCK_STRANDS * PARTICLES;
    for t in 0..frames {
        let point = |e: usize| {
            let (strand, i) = (first + e / PARTICLES, e % PARTICLES);
            let true_point = kinds[strand % KINDS][t * PARTICLES + i];
            let noise = if i < 3 { DVec3::ZERO } else { noise(((strand * frames + t) * PARTICLES + i) as u64) };
            if present(e) { (true_point + noise).as_vec3().to_array() } else { [f32::NAN; 3] }
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

/// Seconds and memory over the size of the take.
fn plots(costs: &[Cost]) {
    let (over_strands, over_frames) = costs.split_at(OVER_STRANDS.len());
    let draw = |title: &str, label: &str, value: fn(&Cost) -> f64| {
        let line = |costs: &[Cost]| {
            let size = |cost: &Cost| (cost.strands * cost.frames) as f64 / 1e6;
            Mark::Line(costs.iter().map(|cost| (size(cost), value(cost))).collect())
        };
        let sizes = costs.iter().map(|cost| (cost.strands * cost.frames) as f64 / 1e6);
        let x = Axis::from_zero("strands times frames, millions", sizes);
        Plot::new(title, title, x, Axis::from_zero(label, costs.iter().map(value)))
            .named(Tone::Blue, line(over_strands), "1,024 to 7,421 strands, 200 frames")
            .named(Tone::Orange, line(over_frames), "512 strands, 200 to 2,000 frames")
            .document()
    };
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("fit-scale");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("seconds.svg"), draw("What fit costs", "seconds", |cost| cost.secs)).unwrap();
    std::fs::write(folder.join("memory.svg"), draw("Memory of fit", "peak [MB]", |cost| cost.peak_mb)).unwrap();
    println!("plots: {}", folder.display());
}
