//! What stages `hull`, `field` and `flow` do on voxels, at the size of the paper's volume (220×190×210 voxels of 2 mm, hair around
//! a head). Throughput counts the bytes that a sweep must move at least, so that it reads against the copy of the first row, on
//! all threads; of carving it counts voxels.
#![allow(missing_docs)]

use std::hint::black_box;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use glam::{DMat3, DVec3, Vec3, Vec4};
use rayon::prelude::*;
use strandflow_core::{Camera, Distortion, Grid, Mask, Occupancy, RigidTransform};
use strandflow_volume::{
    carve::{CarvingView, carve},
    diffuse::{Constraint, Inextensible, Solver, diffuse},
    silhouette::Silhouette,
    tensor::Tensor,
    velocity::{Border, Region},
};

const SWEEPS: usize = 20;
/// One resolution, so that bytes are those of its sweeps.
const ONE_LEVEL: Solver = Solver { levels: 1, sweeps: SWEEPS, relaxation: 1.6, leak: 1e-3 };

fn grid() -> Grid {
    Grid { origin: DVec3::new(-220.0, -190.0, -210.0), voxel_mm: 2.0, dims: [220, 190, 210] }
}

/// Distance from the middle in units of the hair's half axes.
fn radius(grid: &Grid, index: usize) -> f64 {
    let [x, y, z] = grid.coordinates(index).map(|c| c as f64);
    let at = grid.origin + grid.voxel_mm * (DVec3::new(x, y, z) + 0.5);
    (at / DVec3::new(150.0, 140.0, 190.0)).length()
}

/// Hair between the head and its own outer surface.
fn hair() -> Occupancy {
    let mut out = Occupancy::empty(grid());
    (0..out.grid.len()).filter(|&i| (0.55..1.0).contains(&radius(&grid(), i))).for_each(|i| out.set(i, true));
    out
}

fn copying(bench: &mut Criterion) {
    let mut group = bench.benchmark_group("copy of 256 MiB, bytes");
    let from = vec![1u64; 1 << 25];
    let mut to = vec![0u64; 1 << 25];
    // Read, and written.
    group.throughput(Throughput::Bytes(2 << 28));
    group.bench_function("all threads", |b| {
        b.iter(|| {
            to.par_chunks_mut(1 << 16)
                .zip(from.par_chunks(1 << 16))
                .for_each(|(to, from)| to.copy_from_slice(black_box(from)))
        });
    });
}

fn carving(bench: &mut Criterion) {
    let camera = |k: usize| Camera {
        name: format!("{k}"),
        width: 640,
        height: 480,
        focal: [1500.0, 1500.0],
        principal: [320.0, 240.0],
        distortion: Distortion::default(),
        camera_from_world: RigidTransform {
            rotation: DMat3::from_rotation_x(0.3) * DMat3::from_rotation_y(0.9 * k as f64),
            translation: DVec3::new(0.0, 0.0, 1500.0),
        },
    };
    let cameras: Vec<Camera> = (0..7).map(camera).collect();
    // The outline of the hair, with a wavy border.
    let inside = |x: usize, y: usize| {
        let (u, v) = (x as f64 - 320.0, y as f64 - 240.0);
        let border = 1.0 + 0.05 * (9.0 * v.atan2(u)).sin();
        u8::from((u / 150.0).hypot(v / 180.0) < border) * 255
    };
    let silhouette = Silhouette::from_mask(&Mask::from_fn(640, 480, inside), 128, 0.0);
    let views: Vec<CarvingView> =
        cameras.iter().map(|camera| CarvingView { camera, silhouette: &silhouette }).collect();
    let mut group = bench.benchmark_group("hull of seven views, voxels of the volume");
    group.throughput(Throughput::Elements(grid().len() as u64));
    group.bench_function("carve", |b| b.iter(|| carve(black_box(&views), &grid(), 2)));
}

fn diffusion(bench: &mut Criterion) {
    let hair = hair();
    let indices: Vec<u32> = hair.indices().map(|i| i as u32).collect();
    let is_seen = |&i: &u32| radius(&grid(), i as usize) > 0.97;
    let lines: Vec<Constraint<Tensor>> = indices
        .iter()
        .map(|i| if is_seen(i) { Constraint::on(Tensor::of_line(Vec3::Z), 3.0) } else { Constraint::default() })
        .collect();
    let motion: Vec<Constraint<Vec3>> = indices
        .iter()
        .map(|i| match is_seen(i) {
            true => Constraint { pull: Vec3::X, weight: Tensor::of_line(Vec3::X) },
            false => Constraint { pull: Vec3::ZERO, weight: Tensor::default() },
        })
        .collect();
    let mut group = bench.benchmark_group("diffusion at one resolution, bytes");
    // A voxel reads six places, its inverse, its pull and its value, and writes that; a neighbour's value is read once from memory.
    let voxels = (indices.len() * SWEEPS) as u64;
    group.throughput(Throughput::Bytes(voxels * (24 + 4 + 24 + 2 * 24 + 24)));
    let even = vec![(); indices.len()];
    group.bench_function("lines", |b| b.iter(|| diffuse(&grid(), &indices, black_box(&lines), &even, &ONE_LEVEL)));
    let tied = vec![Inextensible::along(Vec3::Z, 100.0); indices.len()];
    group.throughput(Throughput::Bytes(voxels * (24 + 24 + 12 + 12 + 2 * 12 + 12 + 12)));
    group.bench_function("motion, tied along the hair", |b| {
        b.iter(|| diffuse(&grid(), &indices, black_box(&motion), &tied, &ONE_LEVEL));
    });
    let all = Solver { levels: 5, ..ONE_LEVEL };
    group.throughput(Throughput::Elements(indices.len() as u64));
    group.bench_function("lines, five resolutions, voxels", |b| {
        b.iter(|| diffuse(&grid(), &indices, black_box(&lines), &even, &all));
    });
}

fn velocities(bench: &mut Criterion) {
    let region = Region::new(&hair());
    let mut group = bench.benchmark_group("velocities by eq. 5, bytes");
    // Six places, the values around from memory once, and what is written.
    group.throughput(Throughput::Bytes((region.len() * SWEEPS) as u64 * (24 + 16 + 16)));
    group.bench_function("sweeps", |b| {
        let deposited = || vec![Vec4::ONE; region.len()];
        b.iter_batched(
            deposited,
            |values| region.diffuse(black_box(values), 1.0 / 12.0, SWEEPS, Border::Zero),
            BatchSize::LargeInput,
        );
    });
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10);
    targets = copying, carving, diffusion, velocities
}
criterion_main!(benches);
