//! The nine parameters of a strand, and the six logarithms that are fitted.

use crate::lanes::Lanes;

/// Spring stiffnesses \[1/s²\], spring dampings \[1/s\] and drag \[1/s\], per unit mass, shared by all springs of a kind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// Stiffness of edge, bend, torsion and altitude springs \[1/s²\].
    pub stiffness: [f64; 4],
    /// Damping of the same springs \[1/s\].
    pub damping: [f64; 4],
    /// Drag relative to still air \[1/s\].
    pub drag: f64,
}

/// Log parameters that are fitted.
pub const THETA: usize = 6;

/// Damping time τ of the tied model c = τ k \[s\]. From 0.3 to 3 ms the fit ends at the same error.
const DAMPING_SECS: f64 = 1e-3;

impl Default for Params {
    /// A sensible hair: edges nearly inextensible at 2 ms steps, the rest far softer.
    fn default() -> Self {
        let stiffness = [1e7, 1e5, 1e5, 1e4];
        Self { stiffness, damping: stiffness.map(|k| DAMPING_SECS * k), drag: 5.0 }
    }
}

impl Params {
    /// Names in the order of [`Params::from_array`].
    pub const NAMES: [&'static str; 9] =
        ["k_edge", "k_bend", "k_torsion", "k_alt", "c_edge", "c_bend", "c_torsion", "c_alt", "drag"];

    /// From the order of [`Params::NAMES`].
    pub fn from_array(p: [f64; 9]) -> Self {
        Self { stiffness: [p[0], p[1], p[2], p[3]], damping: [p[4], p[5], p[6], p[7]], drag: p[8] }
    }

    /// In the order of [`Params::from_array`].
    pub fn to_array(&self) -> [f64; 9] {
        let ([k0, k1, k2, k3], [c0, c1, c2, c3]) = (self.stiffness, self.damping);
        [k0, k1, k2, k3, c0, c1, c2, c3, self.drag]
    }

    /// The same stiffness without damping and drag, for statics.
    pub fn undamped(&self) -> Self {
        Self { stiffness: self.stiffness, damping: [0.0; 4], drag: 0.0 }
    }

    /// From θ = (log k_edge, log k_bend, log k_torsion, log k_alt, log τ, log drag) with c = τ k.
    pub fn from_log(theta: &[f64; 6]) -> Self {
        let stiffness = [theta[0].exp(), theta[1].exp(), theta[2].exp(), theta[3].exp()];
        let tau = theta[4].exp();
        Self { stiffness, damping: stiffness.map(|k| tau * k), drag: theta[5].exp() }
    }

    /// θ of these parameters; τ from the edge springs.
    pub fn to_log(&self) -> [f64; 6] {
        let k = self.stiffness.map(f64::ln);
        [k[0], k[1], k[2], k[3], (self.damping[0] / self.stiffness[0]).ln(), self.drag.ln()]
    }

    /// Chain rule from ∂φ/∂p (nine) to ∂φ/∂θ (six).
    pub fn log_gradient(&self, dp: &[f64; 9]) -> [f64; 6] {
        let mut out = [0.0; 6];
        for a in 0..4 {
            out[a] = self.stiffness[a] * dp[a] + self.damping[a] * dp[4 + a];
            out[4] += self.damping[a] * dp[4 + a];
        }
        out[5] = self.drag * dp[8];
        out
    }
}

/// Parameters of all lanes, in the order of [`Params::from_array`].
#[derive(Clone, Copy, Debug)]
pub struct LaneParams<R>(pub [R; 9]);

impl<R: Lanes> LaneParams<R> {
    /// The same parameters in every lane.
    pub fn splat(params: &Params) -> Self {
        Self(params.to_array().map(R::splat))
    }

    /// Sets one lane.
    pub fn set(&mut self, lane: usize, params: &Params) {
        for (slot, value) in self.0.iter_mut().zip(params.to_array()) {
            slot.set(lane, value);
        }
    }
}
