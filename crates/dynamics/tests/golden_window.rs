//! The window's value and exact gradient, and the proximal map, against the reference vectors.

use serde_json::Value;
use strandflow_dynamics::{
    Params,
    kernels::Kernels,
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

fn constants(case: &Value, dt: f64) -> StepConstants<f64> {
    let transverse = if case["mode"] == "rank1" { 0.0 } else { 1.0 };
    StepConstants { dt, gravity: arrays(&case["g"])[0], transverse, kinematic: number(&case["nc"]) as usize }
}

/// Runs `f` on the evaluated window of a case with these parameters.
fn evaluated(case: &Value, p: &Params) -> WindowWorkspace<f64> {
    let shape = rest(&case["rest"]);
    let n = shape.particle_count();
    let (mask, w) = (numbers(&case["mask"]), numbers(&case["w"]));
    let weights: Vec<f64> = mask.iter().enumerate().map(|(e, m)| m * w[e / n]).collect();
    let lanes = LaneRest::new(&[&shape]);
    let substeps = number(&case["sub"]) as usize;
    let input = WindowInput {
        rest: &lanes,
        params: LaneParams::splat(p),
        constants: constants(case, number(&case["dt"])),
        substeps,
        x0: &arrays(&case["x0"]),
        v0: &arrays(&case["v0"]),
        path: &arrays(&case["root_frames"]),
        targets: &arrays(&case["tgt"]),
        weights: &weights,
    };
    let mut workspace = WindowWorkspace::new(n, substeps * w.len());
    f64::evaluate(&input, &mut workspace);
    workspace
}

#[test]
fn windows_agree() {
    for case in load("window") {
        let name = case["name"].as_str().expect("name");
        let p = params(&case["p"]);
        let w = evaluated(&case, &p);
        let (fixed, sub) = (number(&case["nc"]) as usize, number(&case["sub"]) as usize);
        let (n, s) = (numbers(&case["x0"]).len() / 3, numbers(&case["w"]).len());
        for (frame, key) in [(s, "frames"), (s, "v_frames")].map(|(s, key)| (s, key)) {
            let got: Vec<f64> = (0..=frame)
                .flat_map(|f| if key == "frames" { w.positions(f * sub) } else { w.velocities(f * sub) }.concat())
                .collect();
            close(&got, &numbers(&case[key]), 1e-10, key);
        }
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
        close(&[w.value + constant], &[number(&case["phi"])], 1e-11, name);
        let log: Vec<f64> = (0..9).map(|a| w.by_params[a] * p.to_array()[a]).collect();
        let expected: Vec<f64> = numbers(&case["dphi_dp"]).iter().zip(p.to_array()).map(|(d, p)| d * p).collect();
        close(&log, &expected, 1e-9, "dphi_dp");
        close(&p.log_gradient(&w.by_params), &numbers(&case["dphi_dtheta6"]), 1e-9, "dphi_dtheta6");
        close(&w.by_x0[fixed..].concat(), &numbers(&case["dphi_dx0"])[3 * fixed..], 1e-9, "dphi_dx0");
        close(&w.by_v0[fixed..].concat(), &numbers(&case["dphi_dv0"])[3 * fixed..], 1e-9, "dphi_dv0");
    }
}

#[test]
fn prox_agrees() {
    for case in load("prox") {
        let shape = rest(&case["rest"]);
        let lanes = LaneRest::new(&[&shape]);
        let s = constants(&case, number(&case["tau"]));
        let x_tilde = arrays(&case["x_tilde"]);
        let p = LaneParams::splat(&params(&case["p"]).undamped());
        let mut w = WindowWorkspace::new(lanes.n, 1);
        for (iterations, key) in [(number(&case["iters"]) as usize, "x"), (60, "x_converged")] {
            let mut x = x_tilde.clone();
            f64::relax(&lanes, &p, &s, iterations, (&x_tilde, &mut x), &mut w);
            let error = x.concat().iter().zip(numbers(&case[key])).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(error < 1e-9, "{key}: {error:.2e} mm");
        }
    }
}
