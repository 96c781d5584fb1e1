//! Gauss–Newton over the windows of all lanes: one exact gradient and one linear solve instead of a dozen evaluations.
//!
//! With J the displacements at the frames by the initial velocity (linearised, [`crate::linear`]) and S those by the six
//! log parameters θ (differences of simulations, renewed every few windows), a step solves
//!
//! | | | |
//! |---|---|---|
//! | JᵀWJ + prior | JᵀWS | δv = −g_v |
//! | SᵀWJ | SᵀWS + P | δθ = −g_θ − P (θ − θ₀) |
//!
//! by conjugate gradients in v and the Schur complement in θ. θ₀ is where the window before ended and P what the windows
//! before knew, fading: one strand has one material, so that θ settles over the take instead of following the noise of
//! each window (straight strands with 3 mm of noise end at 0.58 mm, those of the search at 0.62). Values and gradients are exact; a
//! lane whose value rises shortens its step.

use crate::{
    band::BlockRow,
    kernels::Kernels,
    lanes::{V3, zero3},
    linear::{LinearModel, LinearScratch},
    params::{LaneParams, Params, THETA},
    refine::{
        RefineOptions,
        bundle::Bundle,
        fields::{Accept, HalfGradient, Inner, Keep, Slope, Way, Weighted},
        windows::{LaneState, VELOCITY_UNIT, Window},
    },
    window::WindowWorkspace,
};

/// Conjugate gradients of one solve; three leave a little more error, ten take nothing off.
const GRADIENTS: usize = 5;
/// Windows between renewals of S; with eight the error of a helix grows, in wind most.
const RENEWAL: usize = 4;
/// The parameters that a step moves: bend, torsion and altitude stiffness, and drag. The motion says next to nothing about
/// edge stiffness and damping time (METHOD §5); held where they start, no row of the table gets worse and S costs a third
/// less.
pub(super) const EXCITED: [usize; 4] = [1, 2, 3, 5];
/// Sweeps over the linearised steps that a fit of one step takes: its own solve, and its share of a renewal.
pub(super) const SWEEPS: usize = 2 * GRADIENTS + EXCITED.len() * (2 * GRADIENTS + 1) / RENEWAL;
/// Simulations that renewals cost each window.
pub(super) const RENEWING: usize = EXCITED.len() / RENEWAL;
/// Step of the differences in a log parameter.
const DIFFERENCE: f64 = 0.2;
/// What remains of the knowledge about θ from one window to the next.
const MEMORY: f64 = 0.8;
/// P of a parameter that nothing is known of, per squared error of the window: holds what the motion does not excite.
const HOLD: f64 = 0.01;
/// The furthest that a log parameter goes in one step.
const REACH: f64 = 1.0;
/// A refused step is tried again at this share.
const SHORTER: f64 = 0.3;

/// What Gauss–Newton carries from window to window.
pub struct Newton<R> {
    /// JᵀWS by parameter.
    cross: Vec<Vec<V3<R>>>,
    /// (JᵀWJ + prior)⁻¹ JᵀWS by parameter.
    eliminated: Vec<Vec<V3<R>>>,
    /// SᵀWS less what the velocities explain, of each lane.
    schur: Vec<Six>,
    /// S by parameter, shape (span, n).
    slopes: Vec<Vec<V3<R>>>,
    scratch: LinearScratch<R>,
    /// Half the gradient by the initial velocity.
    rhs: Vec<V3<R>>,
    /// The velocity step for θ held.
    solution: Vec<V3<R>>,
    /// Change of the initial velocity at the best point.
    base: Vec<V3<R>>,
    /// The step from there.
    way: Vec<V3<R>>,
    /// Factors and frames of the run that S starts from.
    factors: Vec<BlockRow<R>>,
    frames: Vec<V3<R>>,
}

/// A matrix over the log parameters.
type Six = [[f64; THETA]; THETA];

impl<R: Kernels> Newton<R> {
    /// Buffers for n particles and windows of `span` frames.
    pub fn new(n: usize, span: usize) -> Self {
        let zeros = |count: usize| vec![zero3(); count];
        Self {
            cross: vec![zeros(n); THETA],
            eliminated: vec![zeros(n); THETA],
            schur: vec![[[0.0; THETA]; THETA]; R::COUNT],
            slopes: vec![zeros(n * span); THETA],
            scratch: LinearScratch::new(n, span),
            rhs: zeros(n),
            solution: zeros(n),
            base: zeros(n),
            way: zeros(n),
            factors: Vec::new(),
            frames: zeros(n * span),
        }
    }
}

/// One lane's place among the parameters.
struct Place {
    theta: [f64; THETA],
    /// θ₀ and P.
    anchor: [f64; THETA],
    prior: Six,
    /// The step from `theta`.
    way: [f64; THETA],
    value: f64,
    /// The mean squared distance alone \[mm²\].
    distance: f64,
    /// Whether the last step was taken.
    taken: bool,
}

impl Place {
    fn new(theta: [f64; THETA], known: Six, value: f64) -> Self {
        let mut prior = known;
        (0..THETA).for_each(|a| prior[a][a] += HOLD * value);
        Self { theta, anchor: theta, prior, way: [0.0; THETA], value, distance: value, taken: true }
    }

    /// P (θ − θ₀).
    fn pull(&self, theta: &[f64; THETA]) -> [f64; THETA] {
        std::array::from_fn(|a| (0..THETA).map(|b| self.prior[a][b] * (theta[b] - self.anchor[b])).sum())
    }

    /// (θ − θ₀)ᵀ P (θ − θ₀).
    fn penalty(&self, theta: &[f64; THETA]) -> f64 {
        self.pull(theta).iter().zip(theta.iter().zip(&self.anchor)).map(|(p, (t, a))| p * (t - a)).sum()
    }

    fn tried(&self) -> [f64; THETA] {
        std::array::from_fn(|a| self.theta[a] + self.way[a])
    }

    /// The step for these half gradients, of which `coupled` the velocity step takes care.
    fn aim(&mut self, half: &[f64; THETA], coupled: &[f64; THETA], schur: &Six, centre: &[f64; THETA], range: f64) {
        let pull = self.pull(&self.theta);
        let mut a = *schur;
        (0..THETA).for_each(|r| (0..THETA).for_each(|c| a[r][c] += self.prior[r][c]));
        let found = solve_six(
            a,
            std::array::from_fn(|r| if EXCITED.contains(&r) { coupled[r] - half[r] - pull[r] } else { 0.0 }),
        );
        for r in 0..THETA {
            let step = if found[r].is_finite() { found[r].clamp(-REACH, REACH) } else { 0.0 };
            self.way[r] = (self.theta[r] + step).clamp(centre[r] - range, centre[r] + range) - self.theta[r];
        }
    }
}

impl<R: Kernels> Window<R> {
    /// Fits every lane by Gauss–Newton; leaves the best prediction in `best`. Says which lanes failed.
    pub(super) fn fit_newton(
        &mut self,
        bundle: &Bundle<R>,
        start: usize,
        options: &RefineOptions,
        states: &mut [LaneState],
        newton: &mut Newton<R>,
        workspace: &mut WindowWorkspace<R>,
    ) -> Vec<bool> {
        let centre = options.start.to_log();
        let mut theta: Vec<_> = (0..R::COUNT).map(|lane| states.get(lane).map_or(centre, |s| s.theta)).collect();
        R::evaluate(&self.input(bundle, start, lane_params(&theta), options), workspace);
        let mut places: Vec<Place> = (0..R::COUNT)
            .map(|lane| {
                let known = states.get(lane).map_or([[0.0; THETA]; THETA], |s| s.known);
                Place::new(theta[lane], known, workspace.value.get(lane))
            })
            .collect();
        newton.base.fill(zero3());
        newton.way.fill(zero3());
        self.keep(R::splat(1.0), options, workspace);
        for step in 0..options.newton_steps {
            self.aim(bundle, start, step, options, &mut places, newton, workspace);
            theta.iter_mut().zip(&places).for_each(|(theta, place)| *theta = place.tried());
            let input = self.input(bundle, start, lane_params(&theta), options);
            if step + 1 == options.newton_steps {
                R::simulate(&input, workspace);
            } else {
                R::evaluate(&input, workspace);
            }
            let taken = judge(&mut places, newton, options, workspace);
            R::call(Accept { accept: taken, way: &newton.way, base: &mut newton.base });
            self.keep(taken, options, workspace);
        }
        let end = &self.best[(self.span - 1) * bundle.n..];
        let failed: Vec<bool> = (0..states.len())
            .map(|lane| !places[lane].value.is_finite() || self.strayed(bundle, end, lane, options))
            .collect();
        for (lane, state) in states.iter_mut().enumerate() {
            state.count((!failed[lane]).then_some((&places[lane].theta, places[lane].taken)));
            if !failed[lane] {
                if self.counts[lane].is_seen() {
                    remember(&mut state.known, &newton.schur[lane]);
                }
                state.tally.add(&self.counts[lane], places[lane].distance, &newton.schur[lane]);
            }
        }
        failed
    }

    /// Sets each lane's next step: a new one, or a share of the one that was refused.
    #[allow(clippy::too_many_arguments)] // the state of one window
    fn aim(
        &mut self,
        bundle: &Bundle<R>,
        start: usize,
        step: usize,
        options: &RefineOptions,
        places: &mut [Place],
        newton: &mut Newton<R>,
        workspace: &mut WindowWorkspace<R>,
    ) {
        let prior = R::splat(options.velocity_prior / VELOCITY_UNIT.powi(2));
        R::call(HalfGradient { by_v0: &workspace.by_v0, base: &newton.base, prior, out: &mut newton.rhs });
        let by_params = workspace.by_params;
        let model = self.model(bundle, options, places, workspace.factors());
        R::solve(&model, &newton.rhs, &mut newton.solution, GRADIENTS, &mut newton.scratch);
        if step == 0 && start.is_multiple_of(RENEWAL) {
            self.renew(bundle, start, options, places, newton, workspace);
        }
        let coupled: [R; THETA] = std::array::from_fn(|a| R::call(Inner(&newton.cross[a], &newton.solution)));
        let (mut fresh, mut by_lane) = (R::zero(), [R::zero(); THETA]);
        let centre = options.start.to_log();
        for (lane, place) in places.iter_mut().enumerate() {
            if place.taken {
                let half = Params::from_log(&place.theta).log_gradient(&by_params.map(|g| 0.5 * g.get(lane)));
                place.aim(&half, &coupled.map(|c| c.get(lane)), &newton.schur[lane], &centre, options.log_range);
            } else {
                place.way.iter_mut().for_each(|t| *t *= SHORTER);
            }
            fresh.set(lane, if place.taken { 1.0 } else { -1.0 });
            (0..THETA).for_each(|a| by_lane[a].set(lane, place.way[a]));
        }
        R::call(Way {
            fresh,
            shorter: R::splat(SHORTER),
            solution: &newton.solution,
            eliminated: &newton.eliminated,
            step: &by_lane,
            way: &mut newton.way,
            base: &newton.base,
            start: &self.start_v,
            v0: &mut self.v0,
            fixed: bundle.fixed,
        });
    }

    /// Renews how the frames depend on the parameters, around the run in the workspace.
    fn renew(
        &mut self,
        bundle: &Bundle<R>,
        start: usize,
        options: &RefineOptions,
        places: &[Place],
        newton: &mut Newton<R>,
        workspace: &mut WindowWorkspace<R>,
    ) {
        let Newton { cross, eliminated, schur, slopes, scratch, factors, frames, .. } = newton;
        factors.clear();
        factors.extend_from_slice(workspace.factors());
        let n = bundle.n;
        for frame in 0..self.span {
            frames[frame * n..(frame + 1) * n].copy_from_slice(workspace.positions((frame + 1) * options.substeps));
        }
        let model = self.model(bundle, options, places, factors);
        for a in EXCITED {
            let moved: Vec<[f64; THETA]> = places
                .iter()
                .map(|place| std::array::from_fn(|b| place.theta[b] + if a == b { DIFFERENCE } else { 0.0 }))
                .collect();
            R::simulate(&self.input(bundle, start, lane_params(&moved), options), workspace);
            for frame in 0..self.span {
                let part = frame * n..(frame + 1) * n;
                let after = workspace.positions((frame + 1) * options.substeps);
                let (before, out) = (&frames[part.clone()], &mut slopes[a][part]);
                R::call(Slope { before, after, scale: R::splat(1.0 / DIFFERENCE), out });
            }
            R::gather(&model, &slopes[a], &mut cross[a], scratch);
            R::solve(&model, &cross[a], &mut eliminated[a], GRADIENTS, scratch);
        }
        for a in EXCITED {
            for b in EXCITED.into_iter().take_while(|&b| b <= a) {
                let own = R::call(Weighted(&self.weights, &slopes[a], &slopes[b]));
                let less = R::call(Inner(&cross[a], &eliminated[b]));
                for (lane, schur) in schur.iter_mut().enumerate() {
                    let rest = own.get(lane) - less.get(lane);
                    (schur[a][b], schur[b][a]) = (rest, rest);
                }
            }
        }
    }

    /// The linear model with each lane's damping time and drag.
    fn model<'a>(
        &'a self,
        bundle: &Bundle<R>,
        options: &RefineOptions,
        places: &[Place],
        factors: &'a [BlockRow<R>],
    ) -> LinearModel<'a, R> {
        let dt = bundle.step.dt.get(0);
        let (mut rate, mut push) = (R::zero(), R::zero());
        for (lane, place) in places.iter().enumerate() {
            let (tau, drag) = (place.theta[4].exp(), place.theta[5].exp());
            rate.set(lane, 1.0 / (tau + dt));
            push.set(lane, (1.0 + dt * drag) / (tau + dt));
        }
        LinearModel {
            n: bundle.n,
            fixed: bundle.fixed,
            substeps: options.substeps,
            factors,
            dt: bundle.step.dt,
            rate,
            push,
            weights: &self.weights,
            prior: R::splat(options.velocity_prior / VELOCITY_UNIT.powi(2)),
        }
    }

    /// Keeps the run's frames in the lanes that took their step.
    fn keep(&mut self, taken: R, options: &RefineOptions, workspace: &WindowWorkspace<R>) {
        let n = self.v0.len();
        for frame in 0..self.span {
            let from = workspace.positions((frame + 1) * options.substeps);
            R::call(Keep { accept: taken, from, to: &mut self.best[frame * n..(frame + 1) * n] });
        }
        let from = workspace.velocities(self.span * options.substeps);
        R::call(Keep { accept: taken, from, to: &mut self.end_v });
    }
}

/// Takes the step in the lanes whose value fell; 1 there, −1 elsewhere.
fn judge<R: Kernels>(
    places: &mut [Place],
    newton: &Newton<R>,
    options: &RefineOptions,
    workspace: &WindowWorkspace<R>,
) -> R {
    let square = R::call(Inner(&newton.base, &newton.base));
    let cross = R::call(Inner(&newton.base, &newton.way));
    let own = R::call(Inner(&newton.way, &newton.way));
    let prior = options.velocity_prior / VELOCITY_UNIT.powi(2);
    let mut taken = R::zero();
    for (lane, place) in places.iter_mut().enumerate() {
        let tried = place.tried();
        let change = square.get(lane) + 2.0 * cross.get(lane) + own.get(lane);
        let value = workspace.value.get(lane) + prior * change + place.penalty(&tried);
        place.taken = value.is_finite() && value < place.value;
        if place.taken {
            (place.value, place.distance, place.theta) = (value, workspace.value.get(lane), tried);
        }
        taken.set(lane, if place.taken { 1.0 } else { -1.0 });
    }
    taken
}

/// Adds what a window knows about θ; older knowledge fades.
fn remember(known: &mut Six, schur: &Six) {
    for a in 0..THETA {
        for b in 0..THETA {
            let sum = MEMORY * (known[a][b] + schur[a][b]);
            known[a][b] = if sum.is_finite() { sum } else { 0.0 };
        }
    }
}

/// Parameters in lanes.
fn lane_params<R: Kernels>(theta: &[[f64; THETA]]) -> LaneParams<R> {
    let mut params = LaneParams([R::zero(); 9]);
    for (lane, theta) in theta.iter().enumerate() {
        params.set(lane, &Params::from_log(theta));
    }
    params
}

/// Solves a symmetric positive definite system of six by elimination; pivots below 1e-12 count as that.
#[expect(clippy::needless_range_loop, reason = "one index through several arrays reads as the formula")]
fn solve_six(mut a: Six, mut b: [f64; THETA]) -> [f64; THETA] {
    for k in 0..THETA {
        let pivot = a[k][k].max(1e-12);
        for i in k + 1..THETA {
            let factor = a[i][k] / pivot;
            for j in k..THETA {
                a[i][j] -= factor * a[k][j];
            }
            b[i] -= factor * b[k];
        }
    }
    for k in (0..THETA).rev() {
        let known: f64 = (k + 1..THETA).map(|j| a[k][j] * b[j]).sum();
        b[k] = (b[k] - known) / a[k][k].max(1e-12);
    }
    b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn six_equations_are_solved() {
        let a: Six = std::array::from_fn(|r| {
            std::array::from_fn(|c| if r == c { 3.0 + r as f64 } else { 1.0 / (1.0 + (r + c) as f64) })
        });
        let x: [f64; THETA] = std::array::from_fn(|r| r as f64 - 2.0);
        let b = std::array::from_fn(|r| (0..THETA).map(|c| a[r][c] * x[c]).sum());
        for (found, wanted) in solve_six(a, b).iter().zip(x) {
            assert!((found - wanted).abs() < 1e-12);
        }
    }
}
