//! How sure a strand's fit is: the covariance of its parameters, and how well it foretells a frame that it has not seen.
//!
//! # Covariance
//!
//! A window's value is φ = Σ wₑ |rₑ|² with Σ wₑ = 1, where wₑ = aₑ / N: aₑ is aging times trust, N = Σ aₑ. Read aₑ as the
//! precision of a sample relative to the others, so that a coordinate has the variance σ² / aₑ. Then
//!
//! - the log likelihood is −Σ aₑ |rₑ|² / 2σ² = −N φ / 2σ², and what the window says about θ after any initial velocity is
//!   allowed for is N / σ² times the Schur complement of φ's Gauss–Newton matrix, which `newton.rs` has as `schur`;
//! - N φ has the expectation 3 σ² (M − F), with M samples and F particles that have one: each takes one velocity. So
//!   σ² = Σ N φ / Σ 3 (M − F) over the windows. (The velocities of stretched edges are not free; σ comes out up to a
//!   twentieth too large.)
//!
//! Where there is no sample the cleaned position counts a little (`HELD`), in φ and in N: no degree of freedom comes of it, and
//! at most a tenth of what a sample would say of θ.
//!
//! A sample is in as many windows as a window has frames (fewer at the ends), so the windows' information is summed and divided
//! by the span. A log parameter lies within ± `log_range` of its start, evenly: a prior of variance `log_range`² / 3. Hence
//!
//! covariance = (Σ N schur / (span σ²) + 3 / `log_range`² I)⁻¹
//!
//! over the log parameters that a fit moves. Edge stiffness and damping time are held where they start and count as known,
//! as do the rest shape and the positions that a window starts from; `docs/dynamics.md` says what that leaves out.

use super::{Samples, Window};
use crate::{
    kernels::Kernels,
    lanes::{V3, axpy, sub, zero3},
    params::{LaneParams, Params},
    refine::{RefineOptions, Refined, bundle::Bundle, fields::Weighted, newton::EXCITED, windows::LaneState},
    window::{WindowInput, WindowWorkspace},
};

/// Windows between frames foretold.
const FORETELL_EVERY: usize = 4;
/// σ is at least this \[mm\]: single precision says no more.
const LEAST_SIGMA_MM: f64 = 1e-4;
/// A parameter known to within a factor of two, by the standard deviation of its logarithm, counts as excited.
pub const EXCITED_BELOW: f64 = std::f64::consts::LN_2;

impl Refined {
    /// Standard deviations of the log parameters, in the order of [`Refined::covariance`].
    pub fn deviations(&self) -> Option<[f64; 4]> {
        self.covariance.map(|c| std::array::from_fn(|a| c[a][a].sqrt()))
    }

    /// Which parameters the motion excites: those known to within a factor of two, in the order of [`Refined::covariance`].
    pub fn excited(&self) -> Option<[bool; 4]> {
        self.deviations().map(|deviations| deviations.map(|d| d < EXCITED_BELOW))
    }
}

/// What the windows of one pass say about one lane's certainty.
#[derive(Default)]
pub(in crate::refine) struct Tally {
    /// Σ N schur over [`EXCITED`] \[mm²\].
    information: [[f64; 4]; 4],
    /// Σ N φ \[mm²\].
    residual: f64,
    /// Σ 3 (M − F).
    degrees: f64,
    /// Squared distances of the simulated and of the extrapolated frame, times trust \[mm²\]; trust.
    foretold: [f64; 3],
}

impl Tally {
    /// Adds a fitted window of value φ \[mm²\].
    pub(in crate::refine) fn add(&mut self, count: &Count, value: f64, schur: &[[f64; 6]; 6]) {
        if !value.is_finite() || EXCITED.iter().any(|&a| EXCITED.iter().any(|&b| !schur[a][b].is_finite())) {
            return;
        }
        self.residual += count.trust * value;
        self.degrees += 3.0 * count.spare;
        for (row, a) in self.information.iter_mut().zip(EXCITED) {
            for (slot, b) in row.iter_mut().zip(EXCITED) {
                *slot += count.trust * schur[a][b];
            }
        }
    }

    /// See the module.
    pub(super) fn covariance(&self, span: usize, options: &RefineOptions) -> [[f64; 4]; 4] {
        let prior = 3.0 / options.log_range.powi(2);
        let scale = if self.degrees > 0.0 {
            1.0 / (span as f64 * (self.residual / self.degrees).max(LEAST_SIGMA_MM.powi(2)))
        } else {
            0.0
        };
        let mut precision = self.information.map(|row| row.map(|e| scale * e));
        (0..4).for_each(|a| precision[a][a] += prior);
        inverse(precision, prior)
    }

    /// Root mean square distance of the simulated and of the extrapolated frames \[mm\].
    pub(super) fn held_out_mm(&self) -> Option<[f64; 2]> {
        let [simulated, extrapolated, trust] = self.foretold;
        let found = [simulated, extrapolated].map(|square| (square / trust).sqrt());
        (trust > 0.0 && found.iter().all(|d| d.is_finite())).then_some(found)
    }
}

/// What a lane's weights hide by their normalisation.
#[derive(Clone, Default)]
pub(in crate::refine) struct Count {
    /// N: aging times trust, summed; 0 without a sample.
    pub(super) trust: f64,
    /// M − F: samples less particles that have one.
    pub(super) spare: f64,
}

impl Count {
    /// Whether the window has a sample.
    pub(in crate::refine) fn is_seen(&self) -> bool {
        self.trust > 0.0
    }
}

/// The inverse of a symmetric matrix whose pivots are at least `least` but for rounding.
fn inverse(mut a: [[f64; 4]; 4], least: f64) -> [[f64; 4]; 4] {
    let mut out: [[f64; 4]; 4] = std::array::from_fn(|r| std::array::from_fn(|c| f64::from(u8::from(r == c))));
    for k in 0..4 {
        let pivot = a[k][k].max(least);
        (a[k], out[k]) = (a[k].map(|e| e / pivot), out[k].map(|e| e / pivot));
        let (row, unit) = (a[k], out[k]);
        for i in (0..4).filter(|&i| i != k) {
            let factor = a[i][k];
            for c in 0..4 {
                a[i][c] -= factor * row[c];
                out[i][c] -= factor * unit[c];
            }
        }
    }
    // Alike on both sides of the diagonal, to the last bit.
    std::array::from_fn(|r| std::array::from_fn(|c| 0.5 * (out[r][c] + out[c][r])))
}

impl<R: Kernels> Window<R> {
    /// Simulates the frame after every fourth window from where its fit ended, and compares with the samples there, which
    /// the window has not seen; beside it the plain guess that every particle keeps its velocity.
    pub(super) fn foretell(
        &self,
        bundle: &Bundle<R>,
        samples: &Samples<R>,
        start: usize,
        options: &RefineOptions,
        (states, failed): (&mut [LaneState], &[bool]),
        workspace: &mut WindowWorkspace<R>,
    ) {
        let (n, last) = (bundle.n, start + self.span);
        if !start.is_multiple_of(FORETELL_EVERY) || last + 1 >= bundle.frames {
            return;
        }
        let targets = &samples.points[(last + 1) * n..(last + 2) * n];
        let mut trust = vec![R::zero(); n];
        let mut params = LaneParams::splat(&options.start);
        for (lane, state) in states.iter().enumerate() {
            params.set(lane, &Params::from_log(&state.theta));
            for (i, slot) in trust.iter_mut().enumerate().skip(bundle.fixed) {
                slot.set(lane, samples.weights[((last + 1) * n + i) * R::COUNT + lane]);
            }
        }
        let end = &self.best[(self.span - 1) * n..];
        let input = WindowInput {
            rest: &bundle.rest,
            params,
            constants: bundle.step,
            substeps: options.substeps,
            x0: end,
            v0: &self.end_v,
            path: &bundle.path[last * bundle.fixed..(last + 2) * bundle.fixed],
            targets,
            weights: &trust,
        };
        R::simulate(&input, workspace);
        let frame = R::splat(bundle.step.dt.get(0) * options.substeps as f64);
        let mut aside: Vec<V3<R>> = vec![zero3(); n];
        for i in bundle.fixed..n {
            aside[i] = sub(axpy(frame, self.end_v[i], end[i]), targets[i]);
        }
        let extrapolated = R::call(Weighted(&trust, &aside, &aside));
        for (lane, state) in states.iter_mut().enumerate().filter(|(lane, _)| !failed[*lane]) {
            let sum: f64 = trust.iter().map(|w| w.get(lane)).sum();
            let found = [workspace.value.get(lane), extrapolated.get(lane), sum];
            (0..3).for_each(|k| state.tally.foretold[k] += found[k]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn covariance_of_a_known_problem() {
        // One window of span 1 with N = 10 and φ = 4 over 3 · 5 degrees: σ² = 8/3.
        let mut schur = [[0.0; 6]; 6];
        (schur[1][1], schur[1][2], schur[2][1], schur[2][2]) = (2.0, 0.5, 0.5, 1.0);
        let mut tally = Tally::default();
        tally.add(&Count { trust: 10.0, spare: 5.0 }, 4.0, &schur);
        let options = RefineOptions { log_range: 3f64.sqrt() * 1e3, ..Default::default() };
        let found = tally.covariance(1, &options);
        // (10 / σ²)⁻¹ times the inverse of [2 ½; ½ 1].
        let unit = (8.0 / 3.0 / 10.0) / 1.75;
        for (got, wanted) in [(found[0][0], unit), (found[0][1], -0.5 * unit), (found[1][1], 2.0 * unit)] {
            assert!((got / wanted - 1.0).abs() < 1e-5, "{got} {wanted}");
        }
        assert!((found[2][2].sqrt() - 1e3).abs() < 1e-9, "nothing said: the range alone");
        // Twice the windows halve it, twice the frames a window do not.
        tally.add(&Count { trust: 10.0, spare: 5.0 }, 4.0, &schur);
        assert!((tally.covariance(2, &options)[0][0] / found[0][0] - 1.0).abs() < 1e-12);
        // Nothing at all, and what is no number, leave the prior.
        tally.add(&Count { trust: 10.0, spare: 5.0 }, f64::NAN, &schur);
        assert!(tally.covariance(1, &options)[0][0] < found[0][0]);
        assert_eq!(Tally::default().held_out_mm(), None);
        assert!((Tally::default().covariance(0, &options)[3][3].sqrt() - 1e3).abs() < 1e-9);
    }
}
