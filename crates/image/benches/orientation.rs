//! What stage `orient` is made of, on the hair's box of one view (320×320 pixels): blurs, the filter bank, pooling along lines.
//! Throughput counts floating-point operations, so that it reads as Gflop/s of one core; of blurs by blocks it counts pixels.
#![allow(missing_docs)]

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use strandflow_core::Plane;
use strandflow_image::{
    filter::{block_means, gaussian, gaussian_half},
    gabor::{OrientationEnergy, add_energy},
    pool::along_lines,
};

const SIZE: usize = 320;
const PIXELS: u64 = (SIZE * SIZE) as u64;

/// Taps to either side of the centre.
fn reach(sigma: f32) -> u64 {
    gaussian_half(sigma).len() as u64 - 1
}

/// Wavy lines of some 6 pixels.
fn texture() -> Plane<f32> {
    Plane::from_fn(SIZE, SIZE, |x, y| (x as f32 + 8.0 * (y as f32 / 40.0).sin()).sin() + 0.3 * (0.7 * y as f32).cos())
}

fn blurs(bench: &mut Criterion) {
    let plane = texture();
    let mut by_taps = bench.benchmark_group("gaussian by taps, flops");
    for sigma in [2.0f32, 6.0] {
        // Two passes; two additions and a product for each pair of taps, a product for the centre.
        by_taps.throughput(Throughput::Elements(2 * PIXELS * (3 * reach(sigma) + 1)));
        by_taps.bench_function(format!("sigma {sigma}"), |b| b.iter(|| gaussian(black_box(&plane), sigma)));
    }
    by_taps.finish();
    // Few operations a pixel, most of them to fetch it: pixels are counted.
    let mut by_blocks = bench.benchmark_group("gaussian by blocks, pixels");
    for sigma in [8.0f32, 24.0] {
        by_blocks.throughput(Throughput::Elements(PIXELS));
        by_blocks.bench_function(format!("sigma {sigma}"), |b| b.iter(|| gaussian(black_box(&plane), sigma)));
    }
    by_blocks.finish();
}

fn bank(bench: &mut Criterion) {
    let (plane, mut group) = (texture(), bench.benchmark_group("filter bank, flops"));
    let (wavelength, sigma, orientations) = (6.5f32, 3.25f32, 12);
    // Of each of seven mirrored orientations: two row and four column passes, and 22 operations of energies.
    let passes = 6 * (3 * reach(sigma) + 1) + 22;
    group.throughput(Throughput::Elements(7 * PIXELS * passes));
    group.bench_function("12 orientations of 6.5 px", |b| {
        let mut energy = OrientationEnergy::zero(SIZE, SIZE);
        b.iter(|| add_energy(black_box(&plane), (wavelength, sigma), orientations, 1.0, &mut energy));
    });
}

fn pooling(bench: &mut Criterion) {
    let mut energy = OrientationEnergy::zero(SIZE, SIZE);
    add_energy(&texture(), (6.5, 3.25), 12, 1.0, &mut energy);
    // At half the resolution, as the stage pools.
    let energy = energy.each(|plane| block_means(plane, 2));
    let inside = Plane::filled(SIZE / 2, SIZE / 2, true);
    let mut group = bench.benchmark_group("along lines, flops");
    // Ten steps to either side of 20 operations each.
    group.throughput(Throughput::Elements(PIXELS / 4 * 20 * 20));
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    group.bench_function("sigma 5", |b| {
        b.iter(|| one.install(|| along_lines(black_box(&energy), &energy, &inside, (5.0, 1.0))));
    });
}

criterion_group! { name = benches; config = Criterion::default().sample_size(20); targets = blurs, bank, pooling }
criterion_main!(benches);
