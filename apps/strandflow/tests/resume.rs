//! A killed run loses only what was in work; the next one ends with the same bytes. What is not stale is not repeated.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

mod common;

use std::{
    process::{Command, Stdio},
    time::Duration,
};

use common::{bytes_below, strandflow, take, text};

/// Up to the last stage that a ball of 36 pixels can carry; later stages may fail on it, which must be the same too.
const UP_TO: &str = "orient";

#[test]
fn killed_at_any_moment_the_next_run_ends_with_the_same_bytes() {
    let root = tempfile::tempdir().unwrap();
    let (_, whole) = take(root.path());
    strandflow(&["run", text(&whole), "--to", UP_TO, "--threads", "1"]);
    let wanted = bytes_below(&whole.join("results.zarr"));
    assert!(wanted.len() > 50, "{} files", wanted.len());
    for round in 0..3u64 {
        let other = tempfile::tempdir().unwrap();
        let (_, killed) = take(other.path());
        for kill in 0..4 {
            let mut child = Command::new(env!("CARGO_BIN_EXE_strandflow"))
                .args(["run", text(&killed), "--to", UP_TO, "--threads", "2"])
                .stderr(Stdio::null())
                .spawn()
                .unwrap();
            std::thread::sleep(Duration::from_millis(30 + (round * 137 + kill * 211) % 500));
            child.kill().unwrap();
            child.wait().unwrap();
        }
        strandflow(&["run", text(&killed), "--to", UP_TO, "--threads", "2"]);
        let found = bytes_below(&killed.join("results.zarr"));
        let differing: Vec<_> = wanted.keys().chain(found.keys()).filter(|k| wanted.get(*k) != found.get(*k)).collect();
        assert!(differing.is_empty(), "round {round}: {differing:?}");
    }
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
