//! The initial states: missing samples by simulation, a filter in head space, and prox.

use glam::DVec3;

use crate::{
    kernels::Kernels,
    lanes::{V3, zero3},
    params::Params,
    refine::{RefineOptions, Take, bundle::Bundle, bundle::set, continuation::continued, filter, track::Prepared},
    window::{WindowInput, WindowWorkspace},
};

/// Pull of the filling simulation towards observed samples, per frame; 0.2 lags, 0.8 follows the noise.
const PULL: f64 = 0.4;
/// Share of the pull that becomes velocity.
const VELOCITY_PULL: f64 = 0.25;
/// Weight of a filled sample in the filter.
const FILLED_WEIGHT: f64 = 0.2;

/// Cleaned positions of all frames, shape (T, n), relative to the lanes' origins.
pub fn clean<R: Kernels>(
    bundle: &Bundle<R>,
    lanes: &[&Prepared],
    take: &Take,
    options: &RefineOptions,
    workspace: &mut WindowWorkspace<R>,
) -> Vec<V3<R>> {
    let (n, frames) = (bundle.n, bundle.frames);
    let mut x = fill(bundle, lanes, take, options, workspace);
    let head_from_world: Vec<_> = take.world_from_head.iter().map(|t| t.inverse()).collect();
    for lane in 0..R::COUNT {
        let Some(p) = lanes.get(lane).or(lanes.first()) else { continue };
        let m = p.n;
        let observed: Vec<bool> = p.weights.iter().map(|&w| w > 0.0).collect();
        let filled: Vec<DVec3> =
            (0..frames * m).map(|e| head_from_world[e / m].point(bundle.get(&x[e / m * n + e % m], lane))).collect();
        let beside = |e: usize| if observed[e] { p.head[e] - filled[e] } else { DVec3::ZERO };
        let mut beside: Vec<DVec3> = (0..frames * m).map(beside).collect();
        if !options.letter && observed.contains(&false) {
            beside = continued(&beside, &p.weights, m, p.noise_mm);
        }
        let mixed: Vec<DVec3> =
            (0..frames * m).map(|e| if observed[e] { p.head[e] } else { filled[e] + beside[e] }).collect();
        let weights: Vec<f64> = p.weights.iter().map(|&w| if w > 0.0 { w } else { FILLED_WEIGHT }).collect();
        let smooth = if options.letter { mixed } else { filter::smooth(&mixed, &weights, &observed, m) };
        for t in 0..frames {
            bundle.put(&mut x[t * n..(t + 1) * n], lane, |i| take.world_from_head[t].point(smooth[t * m + i]));
        }
    }
    let mut scratch = Vec::with_capacity(n);
    for t in 0..frames {
        let frame = &mut x[t * n..(t + 1) * n];
        if options.letter {
            frame[..bundle.fixed].copy_from_slice(&bundle.path[t * bundle.fixed..(t + 1) * bundle.fixed]);
        } else {
            bundle.relax(t, frame, &mut scratch, workspace);
        }
    }
    x
}

/// A simulation with the starting parameters that is drawn to the samples there are.
fn fill<R: Kernels>(
    bundle: &Bundle<R>,
    lanes: &[&Prepared],
    take: &Take,
    options: &RefineOptions,
    workspace: &mut WindowWorkspace<R>,
) -> Vec<V3<R>> {
    let (n, fixed, frames) = (bundle.n, bundle.fixed, bundle.frames);
    let mut all = vec![zero3(); frames * n];
    let (mut x, mut v) = (vec![zero3(); n], vec![zero3(); n]);
    let mut scratch = Vec::with_capacity(n);
    // The median shape, carried by the head.
    for lane in 0..R::COUNT {
        let Some(p) = lanes.get(lane).or(lanes.first()) else { continue };
        let shape = |t: usize, i: usize| take.world_from_head[t].point(p.median[i]);
        bundle.put(&mut x, lane, |i| shape(0, i));
        for (i, v) in v.iter_mut().enumerate().take(p.n) {
            set(v, lane, (shape(1.min(frames - 1), i) - shape(0, i)) / take.frame_secs);
        }
    }
    bundle.relax(0, &mut x, &mut scratch, workspace);
    let (zero_targets, zero_weights) = (vec![zero3(); n], vec![R::zero(); n]);
    for t in 0..frames {
        if t > 0 {
            let input = WindowInput {
                rest: &bundle.rest,
                params: bundle.params(&Params { drag: options.start.drag, ..options.start }),
                constants: bundle.step,
                substeps: options.substeps,
                x0: &x,
                v0: &v,
                path: &bundle.path[(t - 1) * fixed..(t + 1) * fixed],
                targets: &zero_targets,
                weights: &zero_weights,
            };
            R::simulate(&input, workspace);
            x.copy_from_slice(workspace.positions(options.substeps));
            v.copy_from_slice(workspace.velocities(options.substeps));
        }
        let before = x.clone();
        for (lane, p) in lanes.iter().enumerate() {
            #[expect(clippy::needless_range_loop, reason = "one index through several arrays reads as the formula")]
            for i in fixed..p.n {
                let (e, now) = (t * p.n + i, bundle.get(&x[i], lane));
                if p.weights[e] > 0.0 {
                    let seen = take.world_from_head[t].point(p.head[e]);
                    set(&mut x[i], lane, now + PULL * p.weights[e] * (seen - now) - bundle.origins[lane]);
                }
            }
        }
        bundle.relax(t, &mut x, &mut scratch, workspace);
        let gain = R::splat(VELOCITY_PULL / take.frame_secs);
        for i in fixed..n {
            for axis in 0..3 {
                v[i][axis] += gain * (x[i][axis] - before[i][axis]);
            }
        }
        sanitise(bundle, lanes, take, t, &mut x, &mut v);
        all[t * n..(t + 1) * n].copy_from_slice(&x);
    }
    all
}

/// A lane that is no longer finite starts again from the median shape.
fn sanitise<R: Kernels>(
    bundle: &Bundle<R>,
    lanes: &[&Prepared],
    take: &Take,
    t: usize,
    x: &mut [V3<R>],
    v: &mut [V3<R>],
) {
    for (lane, p) in lanes.iter().enumerate() {
        let reach = 2.0 * p.rest.length_mm() + 1e3;
        let sane = (0..p.n).all(|i| {
            let point = bundle.get(&x[i], lane);
            point.is_finite() && point.distance(take.world_from_head[t].point(p.median[0])) < reach
        });
        if !sane {
            bundle.put(x, lane, |i| take.world_from_head[t].point(p.median[i]));
            v.iter_mut().for_each(|v| set(v, lane, DVec3::ZERO));
        }
    }
}
