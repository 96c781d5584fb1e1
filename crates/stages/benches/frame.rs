//! One view's orientations, and the stages of one frame between maps and strands, at the paper's size: seven views of 640×480,
//! 220×190×210 voxels of 2 mm, 8,000 roots; hair of known directions on a ball. `field`'s solvers are in `strandflow-volume`'s
//! benchmarks, `orient`'s filters in `strandflow-image`'s. `lift` and `grow` are counted in floating-point operations of what they
//! gather (the constants below), so that the throughput is a lower bound, of all threads; `orient`, `field` and `prune` in pixels,
//! voxels and points.
#![allow(missing_docs)]
#![expect(clippy::unwrap_used, reason = "a bench: a failing unwrap ends it")]
#![expect(clippy::print_stdout, reason = "the sizes that the times belong to")]

#[path = "../tests/ball/mod.rs"]
#[allow(dead_code, reason = "helpers of the tests")]
mod ball;
#[path = "../tests/cameras/mod.rs"]
mod cameras;

use std::f64::consts::TAU;
use std::hint::black_box;

use ball::{Scene, grown};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DVec3, Vec3};
use strandflow_core::{Camera, Grid, Mask, Place, Report, RgbImage, Rig, RigidTransform, SparseVoxels, Strands};
use strandflow_geometry::primitives::icosphere;
use strandflow_stages::{
    Mode,
    field::head_distance,
    grow::Before,
    orient::{OrientSettings, orient},
    prune::{PruneInput, PruneSettings, prune},
};

/// Radii of the hair and of the head in it \[mm\].
const HAIR: f64 = 160.0;
const HEAD: f64 = 95.0;
const VIEWS: usize = 7;
const ROOTS: usize = 8000;

/// A point, projected: a rigid motion, two divisions, two products and sums.
const PROJECTION: u64 = 18 + 2 + 4;
/// A vote of `lift`: the projection, the depth behind the surface, a unit vector to the camera.
const VOTE: u64 = PROJECTION + 10 + 12;
/// A line interpolated by `grow`: eight tensors of six products, weighted and summed; and four times a symmetric matrix by itself, six
/// sums of three products each.
const SAMPLE: u64 = 8 * (6 + 12) + 4 * 6 * 5;

fn scene() -> Scene {
    let view = |i: usize| Camera {
        width: 640,
        height: 480,
        principal: [320.0, 240.0],
        ..cameras::camera(format!("c{i}"), i as f64 * 33.0, 0.3 + 0.1 * (i % 3) as f64, 1250.0)
    };
    let grid = Grid { origin: DVec3::new(-220.0, -190.0, -210.0), voxel_mm: 2.0, dims: [220, 190, 210] };
    let error = |v: usize, x: usize, y: usize| 0.1 * (x as f64 * 0.11 + v as f64).sin() * (y as f64 * 0.13).cos();
    Scene::new(Rig { cameras: (0..VIEWS).map(view).collect() }, grid, HAIR, error)
}

/// A Fibonacci lattice on the upper two thirds of the head.
fn normals() -> Vec<DVec3> {
    let normal = |i: usize| {
        let z = 1.0 - 1.4 * (i as f64 + 0.5) / ROOTS as f64;
        let (sin, cos) = (TAU * 0.618_033_988_75 * i as f64).sin_cos();
        DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z)
    };
    (0..ROOTS).map(normal).collect()
}

/// Orienting one view of 640×480 by one thread, 75,000 pixels of it hair; without files, flow and the frames around it.
fn view(bench: &mut Criterion) {
    let inside =
        |radius: f32| move |x: usize, y: usize| u8::from((x as f32 - 320.0).hypot(y as f32 - 240.0) < radius) * 255;
    let (hair, subject) = (Mask::from_fn(640, 480, inside(155.0)), Mask::from_fn(640, 480, inside(190.0)));
    let image = RgbImage::from_fn(640, 480, |x, y| {
        let noise = (x * 7919 + y * 104_729) % 13;
        let (x, y) = (x as f32, y as f32);
        let lines = 40.0 * (x + 8.0 * (y / 40.0).sin()).sin() + 20.0 * (0.5 * x + 0.2 * y).cos();
        [(90.0 + lines) as u8 + noise as u8; 3]
    });
    let pixels = hair.data.iter().filter(|&&m| m > 0).count();
    let mut group = bench.benchmark_group("hair pixels");
    group.sample_size(20).throughput(Throughput::Elements(pixels as u64));
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let (place, settings) = (Place::default(), OrientSettings::default());
    group.bench_function("orient", |b| {
        b.iter(|| {
            one.install(|| {
                let mut report = Report::default();
                orient(&place, black_box(&image), &hair, &subject, Mode::Robust, &settings, &mut report).unwrap()
            })
        });
    });
}

fn stages(bench: &mut Criterion) {
    let (scene, normals) = (scene(), normals());
    // Sampled once a take, in head space.
    let head = head_distance(&icosphere(DVec3::ZERO, HEAD, 5), scene.hull.grid.voxel_mm);
    let lines = scene.lines(Mode::Robust);
    let field = scene.field(&lines, &head, Mode::Robust);
    let (strands, _) = grown(&field, HEAD, &normals, None);
    let motion =
        SparseVoxels { grid: field.grid, indices: field.indices.clone(), values: vec![Vec3::ZERO; field.len()] };
    let follow = || Before { strands: &strands, motion: &motion, world_from_head: RigidTransform::IDENTITY };
    let (followed, _) = grown(&field, HEAD, &normals, Some(follow()));
    let points = |strands: &Strands| strands.points.len() as u64;
    println!(
        "{} voxels in the hull, {} lines, {} voxels of hair, {} points grown, {} after the frame before",
        scene.hull.count(),
        lines.len(),
        field.len(),
        points(&strands),
        points(&followed)
    );

    let mut group = bench.benchmark_group("a frame's stages, flops");
    group.throughput(Throughput::Elements((scene.hull.count() * VIEWS) as u64 * VOTE));
    group.bench_function("lift, votes alone counted", |b| b.iter(|| black_box(&scene).lines(Mode::Robust)));
    // The midpoint rule asks twice a point.
    group.throughput(Throughput::Elements(points(&strands) * 2 * SAMPLE));
    group.bench_function("grow, samples alone counted", |b| b.iter(|| grown(black_box(&field), HEAD, &normals, None)));
    group.throughput(Throughput::Elements(points(&followed) * 2 * SAMPLE));
    group.bench_function("grow, following the frame before", |b| {
        b.iter(|| grown(black_box(&field), HEAD, &normals, Some(follow())))
    });
    group.finish();

    let mut group = bench.benchmark_group("a frame's stages, voxels and points");
    group.throughput(Throughput::Elements(field.len() as u64));
    group.bench_function("field", |b| b.iter(|| scene.field(black_box(&lines), &head, Mode::Robust)));
    group.throughput(Throughput::Elements(points(&strands)));
    let maps: Vec<_> = scene.maps.iter().collect();
    let input = PruneInput { rig: &scene.rig, frame: 0, hull: &scene.hull, strands: &strands, maps: &maps };
    group.bench_function("prune", |b| {
        b.iter(|| prune(black_box(&input), Mode::Robust, &PruneSettings::default(), &mut Report::default()))
    });
}

criterion_group! { name = benches; config = Criterion::default().sample_size(10); targets = view, stages }
criterion_main!(benches);
