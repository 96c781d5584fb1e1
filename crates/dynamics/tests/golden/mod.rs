//! Reading the reference vectors.
#![allow(dead_code)] // each test file uses its part

use glam::DVec3;
use serde_json::Value;
use strandflow_dynamics::{Params, RestShape};

/// The cases of one file (a single case counts as one).
pub fn load(name: &str) -> Vec<Value> {
    let path = format!("{}/tests/golden/{name}.json", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(path).expect("golden file");
    match serde_json::from_str(&text).expect("golden JSON") {
        Value::Array(cases) => cases,
        case => vec![case],
    }
}

pub fn number(value: &Value) -> f64 {
    value.as_f64().expect("number")
}

/// All numbers of a nested list, row major.
pub fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        value => vec![number(value)],
    }
}

pub fn points(value: &Value) -> Vec<DVec3> {
    numbers(value).chunks_exact(3).map(DVec3::from_slice).collect()
}

pub fn params(value: &Value) -> Params {
    Params::from_array(numbers(value).try_into().expect("nine parameters"))
}

pub fn rest(value: &Value) -> RestShape {
    RestShape {
        lengths: ["l1", "l2", "l3"].map(|name| numbers(&value[name])),
        altitudes: numbers(&value["h"]).chunks_exact(7).map(|h| h.try_into().expect("seven")).collect(),
        epsilon: number(&value["eps"]),
    }
}

/// Largest difference relative to the largest expected entry.
pub fn close(actual: &[f64], expected: &[f64], tolerance: f64, what: &str) {
    assert_eq!(actual.len(), expected.len(), "{what}");
    let scale = expected.iter().fold(0.0f64, |m, e| m.max(e.abs())).max(1e-300);
    let error = actual.iter().zip(expected).fold(0.0f64, |m, (a, e)| m.max((a - e).abs())) / scale;
    assert!(error <= tolerance, "{what}: relative error {error:.2e} > {tolerance:.0e}");
}
