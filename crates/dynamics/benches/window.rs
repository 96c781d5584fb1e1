//! Value and gradient of a window of 40 particles and 25 substeps: scalar doubles against the widest lanes, in one run.
//! Throughput counts floating-point operations, as `strandflow bench` does.
#![allow(missing_docs)]

#[path = "../tests/truth/mod.rs"]
mod truth;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use strandflow_dynamics::{
    GRAVITY, Params, RestShape,
    kernels::{Kernels, LaneTask, on_widest_lanes},
    lanes::V3,
    params::LaneParams,
    rest::LaneRest,
    system::StepConstants,
    window::{WindowInput, WindowWorkspace},
};
use truth::{Scene, Shape, truth as simulate};

/// Operations of one window, counted by [`strandflow_dynamics::bench`].
const FLOPS: u64 = 4_056_000;

struct Bench<'a>(&'a mut Criterion, &'a str);

impl LaneTask for Bench<'_> {
    type Output = ();
    fn run<R: Kernels>(self) {
        let n = 40;
        let truth = simulate(&Scene { frames: 6, step_secs: 2e-3, ..Scene::default() });
        let rest = LaneRest::<R>::new(&[&RestShape::from_positions(&Shape::Helix.points(n), 5.0)]);
        let of = |e: usize| (truth.points[e] - truth.points[0]).to_array().map(R::splat);
        let x0: Vec<V3<R>> = (0..n).map(of).collect();
        let v0: Vec<V3<R>> =
            (0..n).map(|i| ((truth.points[n + i] - truth.points[i]) * 100.0).to_array().map(R::splat)).collect();
        let targets: Vec<V3<R>> = (n..6 * n).map(of).collect();
        let path: Vec<V3<R>> = (0..18).map(|k| of(k / 3 * n + k % 3)).collect();
        let weights = vec![R::splat(0.005); 5 * n];
        let input = WindowInput {
            rest: &rest,
            params: LaneParams::splat(&Params::default()),
            constants: StepConstants {
                dt: R::splat(2e-3),
                gravity: GRAVITY.to_array().map(R::splat),
                transverse: R::splat(1.0),
                kinematic: 3,
            },
            substeps: 5,
            x0: &x0,
            v0: &v0,
            path: &path,
            targets: &targets,
            weights: &weights,
        };
        let mut workspace = WindowWorkspace::new(n, 25);
        let mut group = self.0.benchmark_group("window");
        group.throughput(Throughput::Elements(FLOPS * R::COUNT as u64));
        group.bench_function(format!("{} x{}", self.1, R::COUNT), |b| b.iter(|| R::evaluate(&input, &mut workspace)));
        group.finish();
    }
}

fn windows(c: &mut Criterion) {
    Bench(c, "scalar f64").run::<f64>();
    on_widest_lanes(Bench(c, "lanes f32"));
}

criterion_group!(benches, windows);
criterion_main!(benches);
