//! A killed run loses only what was in work; the next one ends with the same bytes. What is not stale is not repeated.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

use std::{
    collections::{BTreeMap, BTreeSet},
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    time::Duration,
};

use crate::common::{assert_same, bytes_below, stderr, strandflow, synthetic, take, text};
use serde_json::Value;
use strandflow_engine::store::catalogue;

/// Phases of the stage table; `status` lists them.
const STAGES: usize = 13;

/// A run is killed once in every phase of every stage, and between; each takes up what the one before left.
#[test]
fn killed_in_every_stage_the_next_run_ends_with_the_same_bytes() {
    let root = tempfile::tempdir().unwrap();
    let capture = root.path().join("capture");
    synthetic::capture(&capture);
    let whole = synthetic::take_of(&capture, "whole", &[]);
    let run = strandflow(&["run", text(&whole), "--threads", "1"]);
    assert!(run.status.success(), "{}", stderr(&run));
    let wanted = bytes_below(&whole.join("results.zarr"));
    arrays_are_those_of_the_catalogue(&wanted);

    let killed = synthetic::take_of(&capture, "killed", &[]);
    let phases = phases(&killed);
    let stages: BTreeSet<&str> = phases.iter().filter_map(|p| p.split('/').next()).collect();
    assert_eq!(stages.len(), STAGES);
    for (n, phase) in phases.iter().enumerate() {
        // At once, and some milliseconds into the work: with the machine's own jitter no two kills hit the same place.
        kill_in(&killed, phase, Duration::ZERO);
        kill_in(&killed, phase, Duration::from_millis(3 + (n as u64 * 37) % 60));
    }
    let run = strandflow(&["run", text(&killed), "--threads", "2"]);
    assert!(run.status.success(), "{}", stderr(&run));
    assert_same(&whole, &killed);
}

/// Every array on disk is in the table of `docs/formats.md`, and every row of the table is on disk.
fn arrays_are_those_of_the_catalogue(files: &BTreeMap<PathBuf, Vec<u8>>) {
    let mut found = BTreeSet::new();
    for (file, bytes) in files.iter().filter(|(file, _)| file.ends_with("zarr.json")) {
        let node: Value = serde_json::from_slice(bytes).unwrap();
        if node["node_type"] == "array" {
            let array = file.parent().unwrap().to_str().unwrap().replace('\\', "/");
            let spec = catalogue::spec_of(&array).unwrap_or_else(|| panic!("{array} is in no table"));
            assert_eq!(node["data_type"], spec.dtype.name(), "{array}");
            assert!(
                node["attributes"]["units"] == spec.units && node["dimension_names"] == serde_json::json!(spec.dims),
                "{array}"
            );
            found.insert(spec.path);
        }
    }
    // A run makes no animations; `animate.rs` has those.
    let of_runs = catalogue::ARRAYS.iter().filter(|spec| !spec.path.starts_with("animate/"));
    let missing: Vec<_> = of_runs.filter(|spec| !found.contains(spec.path)).collect();
    assert!(missing.is_empty(), "{missing:?}");
}

/// Names of all phases, in order.
fn phases(take: &Path) -> Vec<String> {
    let status = strandflow(&["status", text(take), "--json"]);
    let phases: Vec<Value> = serde_json::from_slice(&status.stdout).unwrap();
    phases.iter().map(|phase| phase["phase"].as_str().unwrap().to_owned()).collect()
}

/// Runs until a phase has begun and so long, then kills.
fn kill_in(take: &Path, phase: &str, after: Duration) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_strandflow"))
        .args(["run", text(take), "--threads", "2", "--json"])
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let lines = BufReader::new(child.stdout.take().unwrap()).lines().map_while(Result::ok);
    let begun = |line: &String| {
        let event: Value = serde_json::from_str(line).unwrap();
        event["event"] == "phase_started" && event["phase"] == phase
    };
    assert!({ lines }.any(|line| begun(&line)), "{phase} never began");
    std::thread::sleep(after);
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn a_corrected_mask_repeats_only_what_depends_on_its_view_and_frames() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = take(root.path());
    strandflow(&["run", text(&take), "--to", "hull"]);
    let again = strandflow(&["run", text(&take), "--to", "hull", "--json"]);
    assert_eq!(outcomes(&again.stdout, "done").len(), 0, "nothing is stale");
    let given = capture.join("user/hair_masks/cam0/000000.png");
    std::fs::copy(given, capture.join("user/hair_masks/cam1/000002.png")).unwrap();
    let status = strandflow(&["status", text(&take)]);
    let said = String::from_utf8_lossy(&status.stdout).into_owned();
    assert!(said.contains("changed: files"), "{said}");
    let corrected = strandflow(&["run", text(&take), "--to", "hull", "--json"]);
    let done = outcomes(&corrected.stdout, "done");
    assert_eq!(done, ["masks/masks/view01/000002", "masks/masks/view01/000003"]);
}

/// Keys of the items that ended so, sorted.
fn outcomes(stdout: &[u8], outcome: &str) -> Vec<String> {
    let text = String::from_utf8_lossy(stdout);
    let events = text.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let mut keys: Vec<String> = events
        .filter(|event| event["event"] == "item" && event["outcome"] == outcome)
        .map(|event| event["item"].as_str().unwrap().to_owned())
        .collect();
    keys.sort();
    keys
}

#[test]
fn a_reader_of_events_that_goes_away_costs_nothing() {
    let root = tempfile::tempdir().unwrap();
    let (_, take) = take(root.path());
    let mut child = Command::new(env!("CARGO_BIN_EXE_strandflow"))
        .args(["run", text(&take), "--to", "hull", "--json"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    assert!(child.wait().unwrap().success());
    let again = strandflow(&["run", text(&take), "--to", "hull", "--json"]);
    assert!(outcomes(&again.stdout, "done").is_empty());
    let last = String::from_utf8_lossy(&again.stdout).lines().last().unwrap().to_owned();
    let last: Value = serde_json::from_str(&last).unwrap();
    assert!(last["event"] == "ended" && last["complete"] == true && last["done"] == 0, "{last}");
}
