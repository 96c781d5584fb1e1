//! What the kernels do and how fast: scalar doubles beside the packs of this processor in one run, operations counted,
//! against the peak that the same processor reaches on nothing but fused products.
#![expect(clippy::needless_range_loop, reason = "iterators over vectors lose the vector instructions of their caller")]

use std::time::Instant;

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use strandflow_core::RigidTransform;

use crate::{
    Forces, GRAVITY, Model, Params, RestShape, State, Workspace,
    band::{BlockRow, zero_row},
    counted::{Counted, take_operations},
    fused,
    kernels::{Job, Kernels, LaneTask, on_widest_lanes},
    lanes::{Lanes, V3, zero3},
    params::LaneParams,
    refine::{
        RefineOptions, Take, Track, refine_on, track,
        windows::{Fitting, LINEAR_SWEEPS, RENEWING_RUNS},
    },
    rest::LaneRest,
    step,
    system::{self, StepConstants},
    window::{self, WindowInput, WindowWorkspace},
};

/// Particles of the bench's strand.
const PARTICLES: usize = 40;
/// Frames of a window, and steps of a frame.
const SPAN: usize = 5;
/// Repetitions, of which the fastest counts: the others were disturbed.
const REPEATS: usize = 25;
/// Repetitions of a pass of window fits.
const FIT_REPEATS: usize = 3;
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
    let bytes = bytes();
    let mut rows: Vec<Row> = (0..KERNELS.len())
        .map(|k| Row {
            name: KERNELS[k],
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

/// The kernels that are counted.
const KERNELS: [&str; 7] = [
    "forces",
    "assembly",
    "factor and solve",
    "substep",
    "window, forward",
    "window, value and gradient",
    "window fit, Gauss–Newton",
];

/// Bytes a lane of what each of [`KERNELS`] reads and writes once.
fn bytes() -> [u64; KERNELS.len()] {
    // One vector a particle, and the matrix or its factor: twelve of them for each block row.
    let field = 4 * 3 * PARTICLES as u64;
    let matrix = 12 * field;
    let (frames, steps) = (SPAN as u64, (SPAN * SPAN) as u64);
    // Positions and velocities in; impulses, or the next positions and velocities, out.
    let (forces, substep) = (3 * field, 4 * field + matrix);
    let (forward, gradient) = (steps * substep, steps * (substep + matrix + 5 * field));
    // A sweep over linearised steps reads one factor and reads or writes one field a frame.
    let sweeps = LINEAR_SWEEPS as u64 * frames * (matrix + field);
    let fit = gradient + (1 + RENEWING_RUNS as u64) * forward + sweeps;
    [forces, forces + matrix, 2 * matrix + 3 * field, substep, forward, gradient, fit]
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

/// The pieces of a step, as the packs take them or as the scalar reference does.
#[derive(Clone, Copy)]
enum Piece {
    Forces,
    Assembly,
    FactorAndSolve,
    Whole,
}

const PIECES: [Piece; 4] = [Piece::Forces, Piece::Assembly, Piece::FactorAndSolve, Piece::Whole];

/// Buffers of a step.
struct Buffers<R> {
    a: Vec<BlockRow<R>>,
    x1: Vec<V3<R>>,
    v1: Vec<V3<R>>,
    /// The assembled system.
    matrix: Vec<BlockRow<R>>,
    rhs: Vec<V3<R>>,
}

impl<R: Lanes> Buffers<R> {
    fn new(bench: &Bench<R>) -> Self {
        let zeros = || vec![zero3(); PARTICLES];
        let (mut matrix, mut rhs) = (vec![zero_row(); PARTICLES], zeros());
        let input = bench.input();
        system::assemble(
            input.rest,
            &input.params,
            &input.constants,
            (&bench.x[..PARTICLES], &bench.v0),
            &mut matrix,
            &mut rhs,
        );
        Self { a: matrix.clone(), x1: zeros(), v1: zeros(), matrix, rhs }
    }
}

/// One piece of one step of the bench's window.
struct Substep<'a, R> {
    piece: Piece,
    bench: &'a Bench<R>,
    buffers: &'a mut Buffers<R>,
}

impl<R: Lanes> Job<R> for Substep<'_, R> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let (input, state) = (self.bench.input(), (&self.bench.x[..PARTICLES], &self.bench.v0[..]));
        let (rest, params, constants) = (input.rest, &input.params, &input.constants);
        let Buffers { a, x1, v1, matrix, rhs } = self.buffers;
        match (self.piece, R::COUNT > 1) {
            (Piece::Forces, _) => fused::forces(rest, params, constants, state, v1),
            (Piece::Assembly, true) => fused::assemble(rest, params, constants, state, a, v1),
            (Piece::Assembly, false) => system::assemble(rest, params, constants, state, a, v1),
            (Piece::FactorAndSolve, packs) => {
                // Both overwrite what they are given.
                a.copy_from_slice(matrix);
                v1.copy_from_slice(rhs);
                if packs {
                    fused::factor_and_solve(constants, input.path, state.0, a, v1);
                } else {
                    window::solve(constants, input.path, state.0, a, v1);
                }
            }
            (Piece::Whole, true) => fused::advance(rest, params, constants, state, input.path, a, (x1, v1)),
            (Piece::Whole, false) => window::advance(rest, params, constants, state, input.path, a, (x1, v1)),
        }
    }
}

/// Options of the bench's window fits.
fn fit_options() -> RefineOptions {
    RefineOptions { window_frames: SPAN, ..Default::default() }
}

/// Does `work` with the scene's strand in every lane, cleaned; gives the windows of a pass.
fn with_fitting<R: Kernels>(scene: &Scene, work: impl FnOnce(&mut Fitting<R>)) -> usize {
    let (take, options) = (scene.take(), fit_options());
    let prepared: Vec<_> = scene.tracks(1).iter().filter_map(|t| track::prepare(t, None, &take, &options)).collect();
    let lanes: Vec<&track::Prepared> = (0..R::COUNT).filter_map(|_| prepared.first()).collect();
    let mut fitting = Fitting::<R>::new(&lanes, &take, &options);
    work(&mut fitting);
    fitting.windows()
}

/// Times the kernels \[ms per problem\].
struct Kernel<'a>(&'a Scene);

impl LaneTask for Kernel<'_> {
    type Output = [f64; KERNELS.len()];
    fn run<R: Kernels>(self) -> Self::Output {
        let bench = Bench::<R>::new(self.0);
        let mut w = WindowWorkspace::new(PARTICLES, SPAN * SPAN);
        let mut buffers = Buffers::new(&bench);
        let [forces, assembly, solve, substep] = PIECES.map(|piece| {
            let ms = time(REPEATS, || {
                for _ in 0..100 {
                    R::call(Substep { piece, bench: &bench, buffers: &mut buffers });
                }
            });
            ms / 100.0
        });
        let forward = time(REPEATS, || (0..4).for_each(|_| R::simulate(&bench.input(), &mut w))) / 4.0;
        let gradient = time(REPEATS, || (0..4).for_each(|_| R::evaluate(&bench.input(), &mut w))) / 4.0;
        let mut pass = f64::NAN;
        let windows = with_fitting::<R>(self.0, |fitting| {
            let cleaned = fitting.cleaned().to_vec();
            pass = time(FIT_REPEATS, || drop(fitting.pass(&cleaned, false)));
        });
        [forces, assembly, solve, substep, forward, gradient, pass / windows as f64].map(|ms| ms / R::COUNT as f64)
    }
}

/// [`Kernel`] with the packs' lanes and peak.
struct Wide<'a>(&'a Scene);

impl LaneTask for Wide<'_> {
    type Output = ([f64; KERNELS.len()], usize, f64);
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

/// Operations of the kernels, counted. Those on single lanes (a few for each window's parameters) are not.
fn counts(scene: &Scene) -> [u64; KERNELS.len()] {
    let bench = Bench::<Counted>::new(scene);
    let mut w = WindowWorkspace::new(PARTICLES, SPAN * SPAN);
    let mut buffers = Buffers::new(&bench);
    take_operations();
    let [forces, assembly, solve, substep] = PIECES.map(|piece| {
        Substep { piece, bench: &bench, buffers: &mut buffers }.run();
        take_operations()
    });
    window::simulate(&bench.input(), &mut w);
    let forward = take_operations();
    window::evaluate(&bench.input(), &mut w);
    let gradient = take_operations();
    let mut pass = 0;
    let windows = with_fitting::<Counted>(scene, |fitting| {
        let cleaned = fitting.cleaned().to_vec();
        take_operations();
        drop(fitting.pass(&cleaned, false));
        pass = take_operations();
    });
    [forces, assembly, solve, substep, forward, gradient, pass / windows as u64]
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
