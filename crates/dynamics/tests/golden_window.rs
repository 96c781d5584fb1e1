//! The window's value and exact gradient, and the proximal map, against the reference vectors, on every kind of lanes that this
//! processor has.

use serde_json::Value;
use strandflow_dynamics::{
    Params,
    kernels::{Kernels, LaneTask, on_each_lanes},
    lanes::V3,
    params::LaneParams,
    rest::LaneRest,
    system::StepConstants,
    window::{WindowInput, WindowWorkspace},
};

mod golden;
use golden::{close, load, number, numbers, params, points, rest};

fn arrays(value: &Value) -> Vec<V3<f64>> {
    points(value).iter().map(|p| p.to_array()).collect()
}

/// In every lane.
fn lanes<R: Kernels>(points: &[V3<f64>]) -> Vec<V3<R>> {
    points.iter().map(|p| p.map(R::splat)).collect()
}

/// One lane of what was found.
fn lane<R: Kernels>(points: &[V3<R>], lane: usize) -> Vec<f64> {
    points.iter().flat_map(|p| p.iter().map(|axis| axis.get(lane)).collect::<Vec<_>>()).collect()
}

fn constants<R: Kernels>(case: &Value, dt: f64) -> StepConstants<R> {
    let transverse = if case["mode"] == "rank1" { 0.0 } else { 1.0 };
    StepConstants {
        dt: R::splat(dt),
        gravity: lanes(&arrays(&case["g"]))[0],
        transverse: R::splat(transverse),
        kinematic: number(&case["nc"]) as usize,
    }
}

/// The evaluated window of a case with these parameters in every lane.
fn evaluated<R: Kernels>(case: &Value, p: &Params) -> WindowWorkspace<R> {
    let shape = rest(&case["rest"]);
    let n = shape.particle_count();
    let (mask, w) = (numbers(&case["mask"]), numbers(&case["w"]));
    let weights: Vec<R> = mask.iter().enumerate().map(|(e, m)| R::splat(m * w[e / n])).collect();
    let substeps = number(&case["sub"]) as usize;
    let of = |key: &str| lanes::<R>(&arrays(&case[key]));
    let input = WindowInput {
        rest: &LaneRest::new(&vec![&shape; R::COUNT]),
        params: LaneParams::splat(p),
        constants: constants(case, number(&case["dt"])),
        substeps,
        x0: &of("x0"),
        v0: &of("v0"),
        path: &of("root_frames"),
        targets: &of("tgt"),
        weights: &weights,
    };
    let mut workspace = WindowWorkspace::new(n, substeps * w.len());
    R::evaluate(&input, &mut workspace);
    workspace
}

/// How far single precision may be off where doubles agree to the last digits. Derivatives add up over 25 steps of stiff springs.
struct Tolerance {
    positions: f64,
    velocities: f64,
    value: f64,
    derivatives: f64,
}

const DOUBLES: Tolerance = Tolerance { positions: 1e-10, velocities: 1e-10, value: 1e-11, derivatives: 1e-9 };
const SINGLES: Tolerance = Tolerance { positions: 2e-5, velocities: 5e-4, value: 5e-5, derivatives: 2e-3 };

#[test]
fn windows_agree() {
    #[derive(Clone)]
    struct Windows(Vec<Value>);
    impl LaneTask for Windows {
        type Output = ();
        fn run<R: Kernels>(self) {
            self.0.iter().for_each(window_agrees::<R>);
        }
    }
    on_each_lanes(&Windows(load("window")));
}

fn window_agrees<R: Kernels>(case: &Value) {
    let tolerance = if R::COUNT == 1 { DOUBLES } else { SINGLES };
    let name = case["name"].as_str().expect("name");
    let p = params(&case["p"]);
    let w = evaluated::<R>(case, &p);
    let (fixed, sub) = (number(&case["nc"]) as usize, number(&case["sub"]) as usize);
    let (n, s) = (numbers(&case["x0"]).len() / 3, numbers(&case["w"]).len());
    // The reference counts kinematic particles, whose distance to the targets is a constant.
    let (mask, aging, path, target) =
        (numbers(&case["mask"]), numbers(&case["w"]), arrays(&case["root_frames"]), arrays(&case["tgt"]));
    let mut constant = 0.0;
    for i in 0..s {
        for j in 0..fixed {
            let (a, b) = (path[(i + 1) * fixed + j], target[i * n + j]);
            let square: f64 = (0..3).map(|e| (a[e] - b[e]).powi(2)).sum();
            constant += aging[i] * mask[i * n + j] * square;
        }
    }
    for l in 0..R::COUNT {
        let what = |of: &str| format!("{name}, {of}, lane {l} of {}", R::COUNT);
        let frames: Vec<f64> = (0..=s).flat_map(|f| lane(w.positions(f * sub), l)).collect();
        close(&frames, &numbers(&case["frames"]), tolerance.positions, &what("frames"));
        let velocities: Vec<f64> = (0..=s).flat_map(|f| lane(w.velocities(f * sub), l)).collect();
        close(&velocities, &numbers(&case["v_frames"]), tolerance.velocities, &what("v_frames"));
        close(&[w.value.get(l) + constant], &[number(&case["phi"])], tolerance.value, &what("phi"));
        let by_params = w.by_params.map(|d| d.get(l));
        let log: Vec<f64> = (0..9).map(|a| by_params[a] * p.to_array()[a]).collect();
        let expected: Vec<f64> = numbers(&case["dphi_dp"]).iter().zip(p.to_array()).map(|(d, p)| d * p).collect();
        close(&log, &expected, tolerance.derivatives, &what("dphi_dp"));
        let by_theta = p.log_gradient(&by_params);
        close(&by_theta, &numbers(&case["dphi_dtheta6"]), tolerance.derivatives, &what("dphi_dtheta6"));
        let of = |key: &str| numbers(&case[key])[3 * fixed..].to_vec();
        close(&lane(&w.by_x0[fixed..], l), &of("dphi_dx0"), tolerance.derivatives, &what("dphi_dx0"));
        close(&lane(&w.by_v0[fixed..], l), &of("dphi_dv0"), tolerance.derivatives, &what("dphi_dv0"));
    }
}

#[test]
fn prox_agrees() {
    #[derive(Clone)]
    struct Proxes(Vec<Value>);
    impl LaneTask for Proxes {
        type Output = ();
        fn run<R: Kernels>(self) {
            self.0.iter().for_each(prox_agrees_on::<R>);
        }
    }
    on_each_lanes(&Proxes(load("prox")));
}

fn prox_agrees_on<R: Kernels>(case: &Value) {
    let shape = rest(&case["rest"]);
    let rests = LaneRest::new(&vec![&shape; R::COUNT]);
    let constants = constants(case, number(&case["tau"]));
    let x_tilde = lanes::<R>(&arrays(&case["x_tilde"]));
    let p = LaneParams::splat(&params(&case["p"]).undamped());
    let mut w = WindowWorkspace::new(rests.n, 1);
    let most = if R::COUNT == 1 { 1e-9 } else { 2e-3 };
    for (iterations, key) in [(number(&case["iters"]) as usize, "x"), (60, "x_converged")] {
        let mut x = x_tilde.clone();
        R::relax(&rests, &p, &constants, iterations, (&x_tilde, &mut x), &mut w);
        for l in 0..R::COUNT {
            let off = lane(&x, l).iter().zip(numbers(&case[key])).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < most, "{key}, lane {l} of {}: {off:.2e} mm", R::COUNT);
        }
    }
}
