//! The stages of one frame between maps and strands, at the paper's size: seven views of 640×480, 220×190×210 voxels of 2 mm,
//! 8,000 roots; hair of known directions on a ball. `field`'s solvers are in `strandflow-volume`'s benchmarks, `orient`'s filters in
//! `strandflow-image`'s. Throughput counts floating-point operations (`flops`, what a formula needs, written out at each) on all
//! threads; all of these stages gather: what they wait for is said by operations a second far below the machine's.
#![allow(missing_docs)]
#![expect(clippy::print_stdout, reason = "the sizes that the times belong to")]

use std::f64::consts::{PI, TAU};
use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DMat3, DVec2, DVec3, Vec3};
use strandflow_core::{
    Camera, Distortion, Grid, Mask, Occupancy, Plane, Report, Rig, RigidTransform, SparseVoxels, Strands,
};
use strandflow_geometry::{
    primitives::icosphere,
    project::{project_direction, ray},
};
use strandflow_stages::{
    Mode,
    field::{FieldInput, FieldSettings, FieldVoxel, field, head_distance},
    grow::{Before, GrowInput, GrowSettings, grow},
    lift::{LiftInput, LiftSettings, Line, lift},
    orient::OrientationMap,
    prune::{PruneInput, PruneSettings, prune},
};

/// Radii of the hair and of the head in it \[mm\].
const HAIR: f64 = 160.0;
const HEAD: f64 = 95.0;
const VIEWS: usize = 7;
const ROOTS: usize = 8000;

/// A point and a direction in it, projected: a rigid motion, a division, two products and sums.
const PROJECTION: u64 = 15 + 3 + 4;
/// A vote of `lift`: the projection, the depth behind the surface, a unit vector to the camera.
const VOTE: u64 = PROJECTION + 12 + 12;
/// A line interpolated by `grow`: eight tensors of six products, weighted and summed; a principal direction by four squarings of a
/// symmetric matrix, each of six sums of three products and its trace.
const SAMPLE: u64 = 8 * (6 + 14) + 4 * (6 * 5 + 9);

/// One frame, up to its orientation maps.
struct Frame {
    rig: Rig,
    hull: Occupancy,
    maps: Vec<OrientationMap>,
    hairs: Vec<Mask>,
}

fn camera(k: usize) -> Camera {
    let azimuth = 0.6 * k as f64;
    let centre = DVec3::new(azimuth.cos(), azimuth.sin(), 0.3 + 0.1 * (k % 3) as f64).normalize() * 1300.0;
    let forward = -centre.normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    Camera {
        name: format!("{k}"),
        width: 640,
        height: 480,
        focal: [1500.0; 2],
        principal: [320.0, 240.0],
        distortion: Distortion::None,
        camera_from_world: RigidTransform { rotation, translation: -(rotation * centre) },
    }
}

/// Hair falls along the meridians, and waves about them.
fn direction(point: DVec3) -> DVec3 {
    let out = point.normalize();
    let down = (DVec3::NEG_Z + out * out.z).normalize_or(DVec3::X);
    (down + 0.3 * (point.z / 12.0).sin() * out.cross(down)).normalize()
}

fn frame() -> Frame {
    let rig = Rig { cameras: (0..VIEWS).map(camera).collect() };
    let grid = Grid { origin: DVec3::new(-220.0, -190.0, -210.0), voxel_mm: 2.0, dims: [220, 190, 210] };
    let mut hull = Occupancy::empty(grid);
    (0..grid.len()).for_each(|i| hull.set(i, grid.centre_of_index(i).length() <= HAIR + 4.0));
    let hit = |camera: &Camera, x: usize, y: usize| {
        let ray = ray(camera, DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
        let b = ray.origin.dot(ray.direction);
        let inner = b * b - ray.origin.length_squared() + HAIR * HAIR;
        (inner > 0.0).then(|| ray.origin + ray.direction * (-b - inner.sqrt()))
    };
    let map_of = |camera: &Camera| {
        let angle = Plane::from_fn(640, 480, |x, y| {
            let seen = hit(camera, x, y).and_then(|point| project_direction(camera, point, direction(point)));
            seen.map_or(0.0, |d| d.to_angle().rem_euclid(PI) as f32)
        });
        let confidence = Plane::from_fn(640, 480, |x, y| if hit(camera, x, y).is_some() { 0.8 } else { 0.0 });
        OrientationMap { angle, confidence }
    };
    let hair_of = |camera: &Camera| Plane::from_fn(640, 480, |x, y| if hit(camera, x, y).is_some() { 255 } else { 0 });
    let (maps, hairs) = (rig.cameras.iter().map(map_of).collect(), rig.cameras.iter().map(hair_of).collect());
    Frame { rig, hull, maps, hairs }
}

impl Frame {
    fn lines(&self) -> SparseVoxels<Line> {
        let (maps, hairs) = (self.maps.iter().collect::<Vec<_>>(), self.hairs.iter().collect::<Vec<_>>());
        let input = LiftInput { rig: &self.rig, frame: 0, hull: &self.hull, maps: &maps, hairs: &hairs };
        lift(&input, Mode::Robust, &LiftSettings::default(), &mut Report::default()).expect("a frame with hair")
    }

    fn field(&self, lines: &SparseVoxels<Line>) -> SparseVoxels<FieldVoxel> {
        let (hairs, head) = (self.hairs.iter().collect::<Vec<_>>(), icosphere(DVec3::ZERO, HEAD, 5));
        let input = FieldInput {
            rig: &self.rig,
            frame: 0,
            hull: &self.hull,
            lines,
            hairs: &hairs,
            head: &head_distance(&head, self.hull.grid.voxel_mm),
            world_from_head: RigidTransform::IDENTITY,
        };
        field(&input, Mode::Robust, &FieldSettings::default(), &mut Report::default()).expect("a frame with hair")
    }

    fn pruned(&self, strands: &Strands) -> Strands {
        let maps = self.maps.iter().collect::<Vec<_>>();
        let input = PruneInput { rig: &self.rig, frame: 0, hull: &self.hull, strands, maps: &maps };
        let pruned = prune(&input, Mode::Robust, &PruneSettings::default(), &mut Report::default());
        pruned.expect("strands of this frame").strands
    }
}

fn grown(field: &SparseVoxels<FieldVoxel>, before: Option<Before>) -> Strands {
    // A Fibonacci lattice on the upper two thirds of the head.
    let normals: Vec<DVec3> = (0..ROOTS)
        .map(|i| {
            let z = 1.0 - 1.4 * (i as f64 + 0.5) / ROOTS as f64;
            let (sin, cos) = (TAU * 0.618_033_988_75 * i as f64).sin_cos();
            DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z)
        })
        .collect();
    let roots: Vec<DVec3> = normals.iter().map(|n| *n * HEAD).collect();
    let input = GrowInput {
        frame: 0,
        field,
        roots: &roots,
        normals: &normals,
        world_from_head: RigidTransform::IDENTITY,
        gravity: DVec3::new(0.0, 0.0, -9810.0),
        before,
    };
    grow(&input, Mode::Robust, &GrowSettings::default(), &mut Report::default()).expect("as many normals as roots")
}

fn stages(bench: &mut Criterion) {
    let frame = frame();
    let lines = frame.lines();
    let field = frame.field(&lines);
    let strands = grown(&field, None);
    let kept = frame.pruned(&strands);
    let points = |strands: &Strands| strands.points.len() as u64;
    println!(
        "{} voxels in the hull, {} lines, {} voxels of hair, {} points grown, {} kept",
        frame.hull.count(),
        lines.len(),
        field.len(),
        points(&strands),
        points(&kept)
    );

    let mut group = bench.benchmark_group("a frame's stages, flops");
    group.throughput(Throughput::Elements((frame.hull.count() * VIEWS) as u64 * VOTE));
    group.bench_function("lift, votes alone counted", |b| b.iter(|| black_box(frame.lines())));
    // The midpoint rule asks twice a point.
    group.throughput(Throughput::Elements(points(&strands) * 2 * SAMPLE));
    group.bench_function("grow, samples alone counted", |b| b.iter(|| grown(black_box(&field), None)));
    let motion =
        SparseVoxels { grid: field.grid, indices: field.indices.clone(), values: vec![Vec3::ZERO; field.len()] };
    let follow = || Before { strands: &strands, motion: &motion, world_from_head: RigidTransform::IDENTITY };
    group.bench_function("grow, following the frame before", |b| b.iter(|| grown(black_box(&field), Some(follow()))));
    group.finish();

    let mut group = bench.benchmark_group("a frame's stages, their output");
    group.throughput(Throughput::Elements(field.len() as u64));
    group.bench_function("field, voxels", |b| b.iter(|| frame.field(black_box(&lines))));
    group.throughput(Throughput::Elements(points(&strands)));
    group.bench_function("prune, points", |b| b.iter(|| frame.pruned(black_box(&strands))));
}

criterion_group! { name = benches; config = Criterion::default().sample_size(10); targets = stages }
criterion_main!(benches);
