//! What each phase of a picture costs: 8,000 strands of 340 mm in locks, waves of 60 mm, moving, over a head; 640x480; the
//! default density (9 hairs a strand there).
//!
//! `cargo bench -p strandflow-render`. Work is counted from the code: operations and bytes that one item must cost if nothing is
//! read twice. The limit is the larger of both by what this machine's cores do at that moment: a loop of multiplications and
//! additions, and a sum over memory. Phases far below their limit wait for memory that they read in no order, or decide more
//! than they count. Under other load all times grow, and the limits with them.
#![allow(missing_docs, clippy::print_stdout)]

use std::{hint::black_box, time::Instant};

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use strandflow_core::RigidTransform;
use strandflow_geometry::primitives::icosphere;
use strandflow_render::{
    Hair, Head, LightRig, Phase, RenderError, Settings, Subject, full_density, look_at, render_accounted,
};

const STRANDS: usize = 8_000;

/// Points of a strand, 5 mm apart.
const POINTS: usize = 69;

/// Phase, operations and bytes of an item.
///
/// - A point: four waves of 20, 120 for its frame and place, 140 for two projections; 36 bytes written, and as many when the
///   memory is made.
/// - A cell: one addition and the head's ramp; 4 bytes written and read, 4 written. What is dealt into it, a third of the pieces
///   for each light, is not counted: 75 operations, and 24 bytes read.
/// - A piece: 40 for its rectangle; 24 bytes read, 12 written.
/// - A piece in order: some 12 comparisons; 12 bytes read, 12 written, three times.
/// - A fragment: 35; a tenth of the 48 bytes of a piece's ends, 8 written.
/// - A lit point: for each of three lights 60 for the shadow, 130 for the fibre, 60 for the crowd, and 60 for the rest; 36 bytes
///   of points, 3 times 4 columns of a volume, 4 rows of the dome, 8 bytes written.
/// - An added fragment: 12; 8 bytes read, 16 read and written in a tile that is at hand.
const COST: [(&str, f64, f64); 7] = [
    ("grow and place", 340.0, 72.0),
    ("shadows and dome", 8.0, 12.0),
    ("deal to tiles", 40.0, 36.0),
    ("draw: order", 12.0, 72.0),
    ("draw: cover", 35.0, 13.0),
    ("draw: light", 810.0, 172.0),
    ("draw: add", 12.0, 8.0),
];

fn main() -> Result<(), RenderError> {
    let hair = hair();
    let mesh = icosphere(DVec3::ZERO, 90.0, 4);
    let camera = look_at(DVec3::new(0.0, -1100.0, -60.0), DVec3::new(0.0, 0.0, -90.0), DVec3::Z, 0.39, [640, 480]);
    let rig = LightRig::studio(&camera, DVec3::Z);
    let density = full_density(STRANDS, camera.focal[0] / 1000.0);
    let settings = Settings { density, ..Settings::default() };
    let still = RigidTransform::IDENTITY;
    let once = || {
        let head = Head { mesh: &mesh, world_from_head: still, next_world_from_head: still };
        let start = Instant::now();
        let (picture, phases) = render_accounted(&Subject { hair: &hair, head: Some(head) }, &camera, &rig, &settings)?;
        black_box(picture);
        Ok::<_, RenderError>((start.elapsed().as_secs_f64(), phases))
    };
    let mut pictures = (0..5).map(|_| once()).collect::<Result<Vec<_>, _>>()?;
    pictures.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (secs, phases) = &pictures[0];
    let threads = rayon::current_num_threads();
    let limit = Limit::measure();
    println!(
        "{STRANDS} strands of {POINTS} points, {density} hairs each, {threads} threads: {secs:.2} s, the best of 5\n\
         one thread of them: {:.1} Gflop/s, {:.1} GB/s\n",
        limit.flops_per_sec / 1e9,
        limit.bytes_per_sec / 1e9
    );
    println!("{:18} {:>10} {:>12} {:>12} {:>9} {:>9}", "phase", "thread-s", "items", "", "ns each", "of limit");
    phases.iter().for_each(|phase| row(phase, threads, &limit));
    Ok(())
}

fn row(phase: &Phase, threads: usize, limit: &Limit) {
    // Phases within `draw` are sums over threads already.
    let thread_secs = if phase.name.contains(':') { phase.secs } else { phase.secs * threads as f64 };
    let each = thread_secs / phase.count.max(1) as f64;
    let cost = COST.iter().find(|cost| cost.0 == phase.name);
    let share = cost.map_or(String::new(), |(_, flops, bytes)| {
        let least = (flops / limit.flops_per_sec).max(bytes / limit.bytes_per_sec);
        format!("{:.0} %", 100.0 * least / each)
    });
    println!(
        "{:18} {thread_secs:>10.3} {:>12} {:>12} {:>9.0} {share:>9}",
        phase.name,
        phase.count,
        phase.of,
        each * 1e9
    );
}

/// What one thread can do while all do the same.
struct Limit {
    flops_per_sec: f64,
    bytes_per_sec: f64,
}

impl Limit {
    fn measure() -> Self {
        const ROUNDS: usize = 4_000_000;
        const LANES: usize = 32;
        let threads = rayon::current_num_threads();
        let every = |work: &(dyn Fn() + Sync)| {
            let start = Instant::now();
            (0..threads).into_par_iter().with_max_len(1).for_each(|_| work());
            start.elapsed().as_secs_f64()
        };
        let arithmetic = every(&|| {
            let mut lanes = [1.0f32; LANES];
            let (by, plus) = (black_box(0.999f32), black_box(0.001f32));
            for _ in 0..ROUNDS {
                lanes.iter_mut().for_each(|lane| *lane = *lane * by + plus);
            }
            black_box(lanes);
        });
        let memory: Vec<u64> = (0..16 << 20).collect();
        let part = memory.len() / threads;
        let reading = every(&|| {
            let from = rayon::current_thread_index().unwrap_or(0) % threads * part;
            black_box(memory[from..from + part].iter().fold(0u64, |sum, v| sum.wrapping_add(*v)));
        });
        Self {
            flops_per_sec: (ROUNDS * LANES * 2) as f64 / arithmetic,
            bytes_per_sec: (part * size_of::<u64>()) as f64 / reading,
        }
    }
}

/// A wig of locks on a ball of 90 mm: out of it, and then down.
fn hair() -> Hair {
    let mut hair = Hair::default();
    for n in 0..STRANDS {
        let (up, around) = (1.0 - 1.1 * n as f32 / STRANDS as f32, n as f32 * 2.399_963);
        let side = Vec3::new(around.cos(), around.sin(), 0.0);
        let root = side * (1.0 - up * up).max(0.0).sqrt() + Vec3::Z * up;
        let lock = (n / 40) as f32;
        let mut at = root * 91.0;
        let strand: Vec<Vec3> = (0..POINTS)
            .map(|k| {
                let here = at;
                let (arc, free) = (5.0 * k as f32, (k as f32 / 12.0).min(1.0));
                let wave = (std::f32::consts::TAU * arc / 60.0 + lock).sin() * 0.35 * free;
                let ahead = (root * (1.0 - free) + side * (0.1 * (1.0 - free) + wave) - Vec3::Z * free).normalize();
                at += ahead * 5.0;
                at = at.normalize() * at.length().max(91.0 + 0.05 * (n % 80) as f32);
                here
            })
            .collect();
        let motion: Vec<Vec3> = (0..POINTS).map(|k| Vec3::X * 0.1 * k as f32).collect();
        hair.push(n as u32, &strand, &motion);
    }
    hair
}
