//! What the kernels do and how fast: scalar doubles beside the packs of this processor in one run, operations counted,
//! against the peak that the same processor reaches on nothing but fused products.
#![expect(clippy::needless_range_loop, reason = "iterators over vectors lose the vector instructions of their caller")]

use std::time::Instant;

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use strandflow_core::RigidTransform;

use crate::{
    Forces, GRAVITY, Model, Params, RestShape, State, Workspace,
    counted::{Counted, take_operations},
    fused,
    kernels::{Job, Kernels, LaneTask, on_widest_lanes},
    lanes::{Lanes, V3, zero3},
    params::LaneParams,
    refine::{RefineOptions, Take, Track, refine_on},
    rest::LaneRest,
    step,
    system::StepConstants,
    window::{self, WindowInput, WindowWorkspace},
};

/// Particles of the bench's strand.
const PARTICLES: usize = 40;
/// Frames of a window, and steps of a frame.
const SPAN: usize = 5;
/// Repetitions, of which the fastest counts: the others were disturbed.
const REPEATS: usize = 25;
const FRAME_SECS: f64 = 0.01;

/// One kernel, per problem (one window or strand).
#[derive(Clone, Debug)]
pub struct Row {
    /// The kernel.
    pub name: &'static str,
    /// Scalar doubles \[ms\].
    pub scalar_ms: f64,
    /// Packs \[ms\].
    pub packs_ms: f64,
    /// Floating-point operations; none where they are not counted.
    pub operations: Option<u64>,
    /// Bytes of the arrays that the packs read and write once.
    pub bytes: Option<u64>,
}

/// What the bench found.
#[derive(Clone, Debug)]
pub struct Findings {
    /// The kernels.
    pub rows: Vec<Row>,
    /// Problems in a pack.
    pub lanes: usize,
    /// Operations a second of one thread on fused products alone.
    pub peak: f64,
    /// Bytes a second of one thread through memory, copying 64 MiB.
    pub stream: f64,
    /// Threads and strands a second.
    pub sweep: Vec<(usize, f64)>,
}

/// Runs everything; some ten seconds with `frames` = 200.
pub fn run(frames: usize, threads: &[usize]) -> Findings {
    let scene = Scene::new(frames.max(SPAN + 1));
    let scalar = Kernel(&scene).run::<f64>();
    let (packs, lanes, peak) = on_widest_lanes(Wide(&scene));
    let counted = counts(&scene);
    let strand = on_widest_lanes(Strands(&scene));
    let names = ["substep", "window, forward", "window, value and gradient"];
    let float = 4.0 * 3.0 * PARTICLES as f64;
    // Positions and velocities in and out, and the factor out: 12 vectors of three a particle for each block row.
    let step_bytes = (4.0 * float + 12.0 * float) as u64;
    let steps = (SPAN * SPAN) as u64;
    let bytes = [step_bytes, steps * step_bytes, steps * (step_bytes + (12.0 * float + 5.0 * float) as u64)];
    let mut rows: Vec<Row> = (0..3)
        .map(|k| Row {
            name: names[k],
            scalar_ms: scalar[k],
            packs_ms: packs[k],
            operations: Some(counted[k]),
            bytes: Some(bytes[k]),
        })
        .collect();
    let reference = time(1, || drop(refine_on::<f64>(&scene.tracks(1), &scene.take(), &RefineOptions::default())));
    rows.push(Row { name: "strand", scalar_ms: reference, packs_ms: strand, operations: None, bytes: None });
    let sweep = threads.iter().map(|&count| (count, sweep(&scene, count))).collect();
    Findings { rows, lanes, peak, stream: stream(), sweep }
}

/// Milliseconds of the fastest of `repeats`.
fn time(repeats: usize, mut work: impl FnMut()) -> f64 {
    (0..repeats)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64() * 1e3
        })
        .fold(f64::INFINITY, f64::min)
}

/// A helix under a shaken head.
struct Scene {
    rest: RestShape,
    poses: Vec<RigidTransform>,
    points: Vec<DVec3>,
}

impl Scene {
    fn new(frames: usize) -> Self {
        let curl = |i: usize| {
            let turn = 0.9 * i as f64;
            DVec3::new(8.0 * turn.cos(), 8.0 * turn.sin(), -3.5 * i as f64)
        };
        let mut shape = vec![curl(0)];
        for i in 1..PARTICLES {
            shape.push(shape[i - 1] + 5.0 * (curl(i) - curl(i - 1)).normalize());
        }
        let shape: Vec<DVec3> = shape.iter().map(|p| *p - shape[0] + DVec3::new(90.0, 0.0, 0.0)).collect();
        let rest = RestShape::from_positions(&shape, 5.0);
        let pose = |secs: f64| RigidTransform {
            rotation: DMat3::from_rotation_z(0.8 * (std::f64::consts::TAU * 1.6 * secs).sin()),
            translation: DVec3::ZERO,
        };
        let model = Model::new(rest.clone(), 3);
        let (mut state, mut workspace) = (State::at_rest(&shape), Workspace::new(&model));
        let (mut poses, mut points) = (Vec::new(), Vec::new());
        for k in 0..frames * SPAN {
            if k.is_multiple_of(SPAN) {
                poses.push(pose(k as f64 * FRAME_SECS / SPAN as f64));
                points.extend_from_slice(&state.x);
            }
            let head = pose((k + 1) as f64 * FRAME_SECS / SPAN as f64);
            let target: Vec<DVec3> = shape[..3].iter().map(|p| head.point(*p)).collect();
            let dt = FRAME_SECS / SPAN as f64;
            step(&model, &Params::default(), &mut state, &mut workspace, dt, &target, &Forces::default());
        }
        Self { rest, poses, points }
    }

    fn take(&self) -> Take<'_> {
        Take { world_from_head: &self.poses, gravity: GRAVITY, frame_secs: FRAME_SECS }
    }

    /// Noisy tracks: 3 mm by a hash of strand, sample and axis, nearly normal.
    fn tracks(&self, count: usize) -> Vec<Track> {
        let unit = |e: u64| {
            let h = e.wrapping_mul(0x9E37_79B9_7F4A_7C15);
            let h = (h ^ (h >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            ((h ^ (h >> 32)) & 0xff_ffff) as f64 / f64::from(1 << 24) - 0.5
        };
        let noise = |e: u64| 3.0 * (0..4).map(|k| unit(4 * e + k)).sum::<f64>() * 3f64.sqrt();
        (0..count)
            .map(|strand| {
                let noisy = |(e, p): (usize, &DVec3)| {
                    let at = |axis: u64| noise((3 * (strand * self.points.len() + e)) as u64 + axis);
                    if e % PARTICLES < 3 { *p } else { *p + DVec3::new(at(0), at(1), at(2)) }
                };
                let points: Vec<DVec3> = self.points.iter().enumerate().map(noisy).collect();
                Track { particle_count: PARTICLES, weights: vec![1.0; points.len()], points }
            })
            .collect()
    }
}

/// A window of the scene in every lane.
struct Bench<R> {
    rest: LaneRest<R>,
    constants: StepConstants<R>,
    x: Vec<V3<R>>,
    v0: Vec<V3<R>>,
    path: Vec<V3<R>>,
    weights: Vec<R>,
}

impl<R: Lanes> Bench<R> {
    fn new(scene: &Scene) -> Self {
        let of = |p: DVec3| p.to_array().map(R::splat);
        let n = PARTICLES;
        Self {
            rest: LaneRest::new(&[&scene.rest]),
            constants: StepConstants {
                dt: R::splat(FRAME_SECS / SPAN as f64),
                gravity: of(GRAVITY),
                transverse: R::splat(1.0),
                kinematic: 3,
            },
            x: scene.points[..(SPAN + 1) * n].iter().map(|p| of(*p)).collect(),
            v0: (0..n).map(|i| of((scene.points[n + i] - scene.points[i]) / FRAME_SECS)).collect(),
            path: (0..3 * (SPAN + 1)).map(|k| of(scene.points[k / 3 * n + k % 3])).collect(),
            weights: vec![R::splat(1.0 / (SPAN * n) as f64); SPAN * n],
        }
    }

    fn input(&self) -> WindowInput<'_, R> {
        WindowInput {
            rest: &self.rest,
            params: LaneParams::splat(&Params::default()),
            constants: self.constants,
            substeps: SPAN,
            x0: &self.x[..PARTICLES],
            v0: &self.v0,
            path: &self.path,
            targets: &self.x[PARTICLES..],
            weights: &self.weights,
        }
    }
}

/// One step of the bench's window, as the packs take it or as the scalar reference does.
struct Substep<'a, R> {
    bench: &'a Bench<R>,
    factors: &'a mut [crate::band::BlockRow<R>],
    out: (&'a mut [V3<R>], &'a mut [V3<R>]),
}

impl<R: Lanes> Job<R> for Substep<'_, R> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let (input, state) = (self.bench.input(), (&self.bench.x[..PARTICLES], &self.bench.v0[..]));
        let (rest, params, constants) = (input.rest, &input.params, &input.constants);
        if R::COUNT > 1 {
            fused::advance(rest, params, constants, state, input.path, self.factors, self.out);
        } else {
            window::advance(rest, params, constants, state, input.path, self.factors, self.out);
        }
    }
}

/// Times substep, forward run and gradient \[ms per problem\].
struct Kernel<'a>(&'a Scene);

impl LaneTask for Kernel<'_> {
    type Output = [f64; 3];
    fn run<R: Kernels>(self) -> [f64; 3] {
        let bench = Bench::<R>::new(self.0);
        let mut w = WindowWorkspace::new(PARTICLES, SPAN * SPAN);
        let mut factors = vec![crate::band::zero_row(); PARTICLES];
        let (mut x1, mut v1) = (vec![zero3(); PARTICLES], vec![zero3(); PARTICLES]);
        let per = 1.0 / R::COUNT as f64;
        let substep = time(REPEATS, || {
            for _ in 0..100 {
                R::call(Substep { bench: &bench, factors: &mut factors, out: (&mut x1, &mut v1) });
            }
        });
        let forward = time(REPEATS, || (0..4).for_each(|_| R::simulate(&bench.input(), &mut w)));
        let gradient = time(REPEATS, || (0..4).for_each(|_| R::evaluate(&bench.input(), &mut w)));
        [substep / 100.0 * per, forward / 4.0 * per, gradient / 4.0 * per]
    }
}

/// [`Kernel`] with the packs' lanes and peak.
struct Wide<'a>(&'a Scene);

impl LaneTask for Wide<'_> {
    type Output = ([f64; 3], usize, f64);
    fn run<R: Kernels>(self) -> Self::Output {
        let ms = time(REPEATS, || {
            std::hint::black_box(R::call(Peak(R::splat(std::hint::black_box(0.5)))));
        });
        let operations = (2 * CHAINS * PEAK_ROUNDS * R::COUNT) as f64;
        (Kernel(self.0).run::<R>(), R::COUNT, operations / ms * 1e3)
    }
}

/// Independent chains of fused products: enough to hide their latency, few enough for the registers.
const CHAINS: usize = 12;
const PEAK_ROUNDS: usize = 100_000;

/// Fused products alone.
struct Peak<R>(R);

impl<R: Lanes> Job<R> for Peak<R> {
    type Output = R;
    #[inline(always)]
    fn run(self) -> R {
        let mut sums = [self.0; CHAINS];
        for _ in 0..PEAK_ROUNDS {
            for chain in 0..CHAINS {
                sums[chain] = sums[chain].mul_add(self.0, self.0);
            }
        }
        let mut all = sums[0];
        for chain in 1..CHAINS {
            all += sums[chain];
        }
        all
    }
}

/// Operations of the kernels, counted.
fn counts(scene: &Scene) -> [u64; 3] {
    let bench = Bench::<Counted>::new(scene);
    let mut w = WindowWorkspace::new(PARTICLES, SPAN * SPAN);
    let mut factors = vec![crate::band::zero_row(); PARTICLES];
    let (mut x1, mut v1) = (vec![zero3(); PARTICLES], vec![zero3(); PARTICLES]);
    take_operations();
    Substep { bench: &bench, factors: &mut factors, out: (&mut x1, &mut v1) }.run();
    let substep = take_operations();
    window::simulate(&bench.input(), &mut w);
    let forward = take_operations();
    window::evaluate(&bench.input(), &mut w);
    [substep, forward, take_operations()]
}

/// Milliseconds of one strand, refined in a full pack on one thread.
struct Strands<'a>(&'a Scene);

impl LaneTask for Strands<'_> {
    type Output = f64;
    fn run<R: Kernels>(self) -> f64 {
        let tracks = self.0.tracks(R::COUNT);
        time(2, || drop(refine_on::<R>(&tracks, &self.0.take(), &RefineOptions::default()))) / R::COUNT as f64
    }
}

/// Strands a second on so many threads.
fn sweep(scene: &Scene, threads: usize) -> f64 {
    struct Many<'a>(&'a Scene, usize);
    impl LaneTask for Many<'_> {
        type Output = f64;
        fn run<R: Kernels>(self) -> f64 {
            let count = 2 * R::COUNT * self.1;
            let tracks = self.0.tracks(count);
            let ms = time(1, || {
                tracks.par_chunks(R::COUNT).for_each(|t| {
                    drop(refine_on::<R>(t, &self.0.take(), &RefineOptions::default()));
                });
            });
            count as f64 / ms * 1e3
        }
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_or(f64::NAN, |pool| pool.install(|| on_widest_lanes(Many(scene, threads))))
}

/// Bytes a second that one thread copies, read and written.
fn stream() -> f64 {
    let from = vec![1u8; 64 << 20];
    let mut to = vec![0u8; 64 << 20];
    let ms = time(5, || to.copy_from_slice(std::hint::black_box(&from)));
    std::hint::black_box(&to);
    2.0 * from.len() as f64 / ms * 1e3
}
