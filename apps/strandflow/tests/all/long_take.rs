//! Two thousand frames: opening, `status` and a run that finds all done take seconds, not minutes.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

use std::{
    path::Path,
    time::{Duration, Instant},
};

use strandflow_core::RigidTransform;
use strandflow_engine::{
    Item, Take,
    store::Writer,
    table::{Job, phases},
};

use crate::common::{self, cameras, records, stderr, strandflow, text};

const FRAMES: usize = 2000;
const STRANDS: usize = 8000;

/// Each on a machine that builds and tests beside; `docs/farm.md` has what was measured.
const LONGEST: Duration = Duration::from_secs(20);

#[test]
fn a_long_take_is_opened_judged_and_resumed_in_seconds() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = common::take(root.path());
    records::lengthen(&capture, FRAMES);
    finish(&take);
    let timed = |args: &[&str]| {
        let start = Instant::now();
        let output = strandflow(args);
        let lasted = start.elapsed();
        assert!(output.status.success(), "{}", stderr(&output));
        eprintln!("{} of {FRAMES} frames: {:.2} s", args[0], lasted.as_secs_f64());
        assert!(lasted < LONGEST, "{lasted:?}");
        String::from_utf8(output.stdout).unwrap()
    };
    let status = timed(&["status", text(&take), "--json"]);
    let status: Vec<serde_json::Value> = serde_json::from_str(&status).unwrap();
    assert!(status.iter().all(|phase| phase["done"] == phase["items"]), "{status:?}");
    assert_eq!(status[0]["items"], cameras().len() * FRAMES);
    let run = timed(&["run", text(&take), "--json"]);
    let ended: serde_json::Value = serde_json::from_str(run.lines().last().unwrap()).unwrap();
    assert!(ended["done"] == 0 && ended["complete"] == true, "{ended}");
}

/// Records of all items as a run leaves them, and of the results what others read by value; nothing is computed.
fn finish(take: &Path) {
    let take = Take::open(take).unwrap();
    let plan = take.plan(None, None).unwrap();
    take.write_resolved(&plan).unwrap();
    let job = Job::new(&take, &plan);
    for (stage, phase) in phases() {
        for &item in phase.chains(&job).unwrap().iter().flatten() {
            let inputs = stage.inputs(phase, &job, item).unwrap();
            let mut out = Writer::new(take.store());
            if item == Item::Take {
                records::by_value(phase.name, &mut out, FRAMES, STRANDS, |_| RigidTransform::IDENTITY);
            }
            out.finish(&item.key(phase.name), inputs.hashes, Vec::new()).unwrap();
        }
    }
}
