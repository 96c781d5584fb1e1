//! Springs and steps against the reference vectors in `tests/golden` (another language, float64).

use glam::DVec3;
use serde_json::Value;
use strandflow_dynamics::{
    Forces, Jacobian, Model, Params, RestShape, State, Workspace, band,
    exact::{self, HALF_WIDTH},
    lanes::{V3, zero3},
    lu::BandMatrix,
    params::LaneParams,
    rest::LaneRest,
    step,
    system::{self, StepConstants},
};

mod golden;
use golden::{close, load, number, numbers, params, points, rest};

#[test]
fn rest_shapes_agree() {
    for case in load("springs") {
        let shape = RestShape::from_positions(&points(&case["x_rest"]), (number(&case["rest"]["eps"]) / 0.1).sqrt());
        let expected = rest(&case["rest"]);
        // Together, since a straight strand's altitudes are rounding.
        let flat = |s: &RestShape| [s.lengths.concat(), s.altitudes.concat()].concat();
        close(&flat(&shape), &flat(&expected), 1e-11, "rest values");
    }
}

/// The dense full system of [`system::assemble`] with Δt = 1e-3 gives K and D back as differences.
fn dense(case: &Value, jacobian: Jacobian, dt: f64, p: &LaneParams<f64>) -> (Vec<f64>, Vec<V3<f64>>) {
    let (x, v) = (arrays(&case["x"]), arrays(&case["v"]));
    let shape = rest(&case["rest"]);
    let lanes = LaneRest::new(&[&shape]);
    let n = x.len();
    let constants = StepConstants {
        dt,
        gravity: points_array(&case["g"]),
        transverse: if jacobian == Jacobian::Clamped { 1.0 } else { 0.0 },
        kinematic: 0,
    };
    let (mut a, mut q) = (vec![band::zero_row(); n], vec![zero3(); n]);
    system::assemble(&lanes, p, &constants, (&x, &v), &mut a, &mut q);
    let mut full = vec![0.0; 9 * n * n];
    for (i, blocks) in a.iter().enumerate() {
        for (d, block) in blocks.iter().enumerate().take(i + 1) {
            for r in 0..3 {
                for c in 0..3 {
                    let (row, col) = (3 * i + r, 3 * (i - d) + c);
                    full[row * 3 * n + col] = block[3 * r + c];
                    full[col * 3 * n + row] = block[3 * r + c];
                }
            }
        }
    }
    (full, q)
}

fn arrays(value: &Value) -> Vec<V3<f64>> {
    points(value).iter().map(|p| p.to_array()).collect()
}

fn points_array(value: &Value) -> V3<f64> {
    let g = numbers(value);
    [g[0], g[1], g[2]]
}

#[test]
fn stiffness_damping_and_forces_agree() {
    for case in load("springs") {
        let n = points(&case["x"]).len();
        let p = params(&case["p"]);
        let identity = |k: usize| if k.is_multiple_of(3 * n + 1) { 1.0 } else { 0.0 };
        // Without damping A − I = Δt² K; without stiffness A − I = Δt D.
        for (name, jacobian) in [("K_clamped", Jacobian::Clamped), ("K_rank1", Jacobian::Rank1)] {
            let (a, _) = dense(&case, jacobian, 1.0, &LaneParams::splat(&p.undamped()));
            let k: Vec<f64> = a.iter().enumerate().map(|(e, a)| a - identity(e)).collect();
            close(&k, &numbers(&case[name]), 1e-11, name);
        }
        let soft = Params { stiffness: [0.0; 4], ..p };
        let (a, _) = dense(&case, Jacobian::Clamped, 1.0, &LaneParams::splat(&soft));
        let d: Vec<f64> = a.iter().enumerate().map(|(e, a)| a - identity(e)).collect();
        close(&d, &numbers(&case["D"]), 1e-11, "D");
        // f = (q − v)/Δt − D v.
        let (_, q) = dense(&case, Jacobian::Clamped, 1.0, &LaneParams::splat(&p));
        let v: Vec<f64> = arrays(&case["v"]).concat();
        let f: Vec<f64> = (0..3 * n)
            .map(|r| q[r / 3][r % 3] - v[r] - (0..3 * n).map(|c| d[r * 3 * n + c] * v[c]).sum::<f64>())
            .collect();
        close(&f, &numbers(&case["f"]), 1e-11, "f");
    }
}

#[test]
fn exact_stiffness_agrees() {
    for case in load("springs") {
        let (x, v) = (arrays(&case["x"]), arrays(&case["v"]));
        let lanes = LaneRest::new(&[&rest(&case["rest"])]);
        let n = 3 * x.len();
        let mut k = BandMatrix::zeros(n, HALF_WIDTH);
        exact::stiffness(&lanes, &LaneParams::splat(&params(&case["p"])), (&x, &v), &mut k);
        let entry = |i: usize, j: usize| if i.abs_diff(j) <= HALF_WIDTH { k[(i, j)] } else { 0.0 };
        let full: Vec<f64> = (0..n * n).map(|e| entry(e / n, e % n)).collect();
        close(&full, &numbers(&case["K_exact"]), 1e-11, "K_exact");
    }
}

/// The reduced systems A Δv = b: kinematic rows are those of the identity, and b knows what the kinematic particles do.
#[test]
fn reduced_systems_agree() {
    for case in load("step") {
        for (jacobian, name) in &JACOBIANS[..2] {
            let (dt, fixed) = (number(&case["dt"]), 3 * number(&case["nc"]) as usize);
            let (mut a, q) = dense(&case, *jacobian, dt, &LaneParams::splat(&params(&case["p"])));
            let (x, v, target) = (numbers(&case["x"]), numbers(&case["v"]), numbers(&case["xc_next"]));
            let n = x.len();
            let known: Vec<f64> = (0..fixed).map(|r| (target[r] - x[r]) / dt - v[r]).collect();
            let mut b: Vec<f64> = q.concat();
            for r in 0..n {
                b[r] -= (0..n).map(|c| a[r * n + c] * v[c]).sum::<f64>();
                b[r] -= (0..fixed).map(|c| a[r * n + c] * known[c]).sum::<f64>();
            }
            b[..fixed].copy_from_slice(&known);
            for (e, a) in a.iter_mut().enumerate() {
                if e / n < fixed || e % n < fixed {
                    *a = if e / n == e % n { 1.0 } else { 0.0 };
                }
            }
            close(&a, &numbers(&case[format!("A_{name}")]), 1e-11, "A");
            close(&b, &numbers(&case[format!("b_{name}")]), 1e-11, "b");
        }
    }
}

const JACOBIANS: [(Jacobian, &str); 3] =
    [(Jacobian::Clamped, "clamped"), (Jacobian::Rank1, "rank1"), (Jacobian::Exact, "exact")];

#[test]
fn steps_agree() {
    for case in load("step") {
        for (jacobian, name) in JACOBIANS {
            let mut model = Model::new(rest(&case["rest"]), number(&case["nc"]) as usize);
            model.jacobian = jacobian;
            let mut state = State { x: points(&case["x"]), v: points(&case["v"]) };
            let mut workspace = Workspace::new(&model);
            let g = points_array(&case["g"]);
            let forces = Forces { gravity: DVec3::from_array(g), acceleration: &[] };
            let dt = number(&case["dt"]);
            let target = points(&case["xc_next"]);
            step(&model, &params(&case["p"]), &mut state, &mut workspace, dt, &target, &forces);
            let flat = |p: &[DVec3]| p.iter().flat_map(|p| p.to_array()).collect::<Vec<_>>();
            close(&flat(&state.x), &numbers(&case[format!("x1_{name}")]), 1e-11, "x1");
            close(&flat(&state.v), &numbers(&case[format!("v1_{name}")]), 1e-11, "v1");
        }
    }
}
