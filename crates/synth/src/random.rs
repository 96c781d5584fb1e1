//! Random numbers that depend on a seed and on what they are for, never on order or threads.

use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use strandflow_core::normal_from_even;

/// A generator for one purpose: the same seed and keys give the same numbers, other keys give independent ones.
pub(crate) fn stream(seed: u64, keys: &[u64]) -> Pcg64Mcg {
    Pcg64Mcg::seed_from_u64(
        keys.iter().fold(mix(seed ^ 0x9e37_79b9_7f4a_7c15), |h, &k| mix(h ^ mix(k.wrapping_add(1)))),
    )
}

/// A standard normal number.
pub(crate) fn normal(rng: &mut Pcg64Mcg) -> f64 {
    let (a, b) = (rng.random(), rng.random());
    normal_from_even(a, b)
}

/// A number in −1..1.
pub(crate) fn signed(rng: &mut Pcg64Mcg) -> f64 {
    rng.random::<f64>() * 2.0 - 1.0
}

/// Smooth noise in −1..1 with features of size 1 (value noise with quintic weights).
pub(crate) fn smooth_noise(seed: u64, p: DVec3) -> f64 {
    let cell = p.floor();
    let f = p - cell;
    let w = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let corner = |dx: f64, dy: f64, dz: f64| {
        let c = cell + DVec3::new(dx, dy, dz);
        let h = mix(seed ^ mix(c.x as i64 as u64 ^ mix(c.y as i64 as u64 ^ mix(c.z as i64 as u64))));
        (h >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    let lerp = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let edge = |dy, dz| lerp(corner(0.0, dy, dz), corner(1.0, dy, dz), w.x);
    lerp(lerp(edge(0.0, 0.0), edge(1.0, 0.0), w.y), lerp(edge(0.0, 1.0), edge(1.0, 1.0), w.y), w.z)
}

/// The finaliser of SplitMix64 (Steele et al. 2014).
pub(crate) fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}
