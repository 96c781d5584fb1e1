//! Equations 2, 6 and 7 against vectors from an independent reference.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

use glam::DVec3;
use serde_json::Value;
use strandflow_dynamics::eq2::{Reading, smooth};
use strandflow_dynamics::warp::{WarpWeights, interpolate, warp, warp_local_global};

fn golden(name: &str) -> Value {
    let path = format!("{}/tests/golden/{name}", env!("CARGO_MANIFEST_DIR"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn points(value: &Value) -> Vec<DVec3> {
    let rows: Vec<[f64; 3]> = serde_json::from_value(value.clone()).unwrap();
    rows.into_iter().map(DVec3::from_array).collect()
}

fn largest_distance(a: &[DVec3], b: &[DVec3]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max)
}

#[test]
fn eq2_in_every_reading() {
    let golden = golden("eq2.json");
    let given = points(&golden["x_tilde"]);
    let cases = golden["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 16);
    for case in cases {
        let reading: Reading = serde_json::from_value(case["reading"].clone()).unwrap();
        let (w_s, pin) = (case["ws"].as_f64().unwrap(), case["pin_root"].as_bool().unwrap());
        let off = largest_distance(&smooth(&given, w_s, reading, pin), &points(&case["x"]));
        assert!(off < 1e-12 * 100.0, "{reading:?} w_s {w_s} pin {pin}: {off:e}");
    }
}

#[test]
fn eq6_by_newton_and_by_local_global() {
    let golden = golden("eq6.json");
    let y = points(&golden["y"]);
    for case in golden["cases"].as_array().unwrap() {
        let number = |key: &str| case[key].as_f64().unwrap();
        let weights = WarpWeights { data: number("s_i"), root: number("s_1"), length: number("s_l"), fixed: 1 };
        let expected = points(&case["x_hat"]);
        let tolerance = if weights.length < 1.0 { 1e-6 } else { 1e-5 };

        let newton = warp(&y, number("r"), &weights, 100);
        let off = largest_distance(&newton.points, &expected);
        assert!(newton.converged && off < tolerance, "s_l {}: {off:e} mm", weights.length);
        assert!((newton.energy - number("energy")).abs() < 1e-9);
        assert!(newton.iterations <= 25, "{} iterations", newton.iterations);

        let reference = warp_local_global(&y, number("r"), &weights, 4000);
        assert!(largest_distance(&reference.points, &expected) < 1e-4);
        assert!((reference.energy - number("energy")).abs() < 1e-6);
    }
}

#[test]
fn eq7_is_the_printed_sum() {
    let golden = golden("eq7.json");
    let [x, before, after, out] = ["x", "x_minus", "x_plus", "out"].map(|key| points(&golden[key]));
    let found = interpolate(&x, &before, &after, golden["gamma"].as_f64().unwrap());
    assert!(largest_distance(&found, &out) < 1e-12);
}
