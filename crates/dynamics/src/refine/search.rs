//! The quasi-Newton fit of a window: every lane searches on its own, all lanes evaluate together.

use crate::{
    kernels::Kernels,
    lbfgs::{Lbfgs, Limits, Stop},
    params::{LaneParams, Params},
    refine::{
        RefineOptions,
        bundle::Bundle,
        windows::{LaneState, VELOCITY_UNIT, Window},
    },
    window::WindowWorkspace,
};

impl<R: Kernels> Window<R> {
    /// Fits every lane; leaves the best prediction in `best`. Says which lanes failed.
    pub(super) fn fit_search(
        &mut self,
        bundle: &Bundle<R>,
        start: usize,
        options: &RefineOptions,
        states: &mut [LaneState],
        workspace: &mut WindowWorkspace<R>,
    ) -> Vec<bool> {
        let limits =
            Limits { iterations: options.iterations, evaluations: options.evaluations, gradient: 1e-4, decrease: 1e-3 };
        let centre = options.start.to_log();
        let mut searches: Vec<Lbfgs> = states
            .iter()
            .enumerate()
            .map(|(lane, state)| {
                let free =
                    if options.letter { 0 } else { 3 * (bundle.counts[lane] - bundle.fixed.min(bundle.counts[lane])) };
                let mut x = state.theta.to_vec();
                x.resize(6 + free, 0.0);
                let bound = |sign: f64| {
                    let mut b: Vec<f64> = centre.iter().map(|c| c + sign * options.log_range).collect();
                    b.resize(6 + free, sign * f64::INFINITY);
                    b
                };
                Lbfgs::new(x, bound(-1.0), bound(1.0), limits).with_scale(state.scale)
            })
            .collect();
        let mut params = LaneParams::splat(&options.start);
        while searches.iter().any(|s| s.stop().is_none()) {
            for (lane, search) in searches.iter().enumerate() {
                if let Some(x) = search.ask() {
                    self.put_variables(bundle, lane, x, &mut params);
                }
            }
            R::evaluate(&self.input(bundle, start, params, options), workspace);
            for (lane, search) in searches.iter_mut().enumerate() {
                let Some(x) = search.ask() else { continue };
                let value = objective(bundle, workspace, lane, x, options, &mut self.gradient);
                search.tell(value, &self.gradient);
            }
        }
        for (lane, search) in searches.iter().enumerate() {
            self.put_variables(bundle, lane, search.best().1, &mut params);
        }
        R::simulate(&self.input(bundle, start, params, options), workspace);
        let failed: Vec<bool> = (0..states.len())
            .map(|lane| {
                searches[lane].stop() == Some(Stop::Failed)
                    || self.strayed(bundle, workspace.positions(self.span * options.substeps), lane, options)
            })
            .collect();
        for (lane, state) in states.iter_mut().enumerate() {
            let search = &searches[lane];
            let theta: [f64; 6] = std::array::from_fn(|a| search.best().1[a]);
            state.count((!failed[lane]).then_some((&theta, search.stop() == Some(Stop::Converged))));
            if !failed[lane] {
                state.scale = search.scale();
            }
        }
        let n = bundle.n;
        for frame in 0..self.span {
            let from = workspace.positions((frame + 1) * options.substeps);
            self.best[frame * n..(frame + 1) * n].copy_from_slice(from);
        }
        self.end_v.copy_from_slice(workspace.velocities(self.span * options.substeps));
        failed
    }

    /// Sets a lane's parameters and initial velocity from its variables.
    fn put_variables(&mut self, bundle: &Bundle<R>, lane: usize, x: &[f64], params: &mut LaneParams<R>) {
        let theta = [x[0], x[1], x[2], x[3], x[4], x[5]];
        params.set(lane, &Params::from_log(&theta));
        for (i, dv) in (bundle.fixed..).zip(x[6..].chunks_exact(3)) {
            for (axis, change) in dv.iter().enumerate() {
                let v = self.start_v[i][axis].get(lane) + VELOCITY_UNIT * change;
                self.v0[i][axis].set(lane, v);
            }
        }
    }
}

/// Value and gradient of one lane: mean squared distance plus the velocity prior.
fn objective<R: Kernels>(
    bundle: &Bundle<R>,
    w: &WindowWorkspace<R>,
    lane: usize,
    x: &[f64],
    options: &RefineOptions,
    gradient: &mut Vec<f64>,
) -> f64 {
    let theta = [x[0], x[1], x[2], x[3], x[4], x[5]];
    let by_params = w.by_params.map(|g| g.get(lane));
    gradient.clear();
    gradient.extend(Params::from_log(&theta).log_gradient(&by_params));
    let mut value = w.value.get(lane);
    for (i, dv) in (bundle.fixed..).zip(x[6..].chunks_exact(3)) {
        for (axis, change) in dv.iter().enumerate() {
            value += options.velocity_prior * change * change;
            gradient.push(VELOCITY_UNIT * w.by_v0[i][axis].get(lane) + 2.0 * options.velocity_prior * change);
        }
    }
    value
}
