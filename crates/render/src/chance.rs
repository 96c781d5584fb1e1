//! Chance that depends on a seed and on what it is for, never on order, frame or threads.

use std::f32::consts::TAU;

/// A generator for one purpose.
pub(crate) struct Chance(u64);

impl Chance {
    /// The same seed and key give the same numbers; other keys give independent ones.
    pub(crate) fn of(seed: u64, key: u64) -> Self {
        Self(mix(seed ^ mix(key.wrapping_add(1))))
    }

    /// A number in 0..1.
    pub(crate) fn share(&mut self) -> f32 {
        self.0 = mix(self.0);
        (self.0 >> 40) as f32 / (1u32 << 24) as f32
    }

    /// A standard normal number (Box and Muller 1958).
    pub(crate) fn normal(&mut self) -> f32 {
        let (a, b) = (self.share(), self.share());
        (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
    }
}

/// The finaliser of SplitMix64 (Steele et al. 2014).
fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}
