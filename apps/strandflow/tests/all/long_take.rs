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

use crate::common::{self, cameras, stderr, strandflow, text};

const FRAMES: usize = 2000;
const STRANDS: usize = 8000;

/// Each on a machine that builds and tests beside; `docs/farm.md` has what was measured.
const LONGEST: Duration = Duration::from_secs(20);

#[test]
fn a_long_take_is_opened_judged_and_resumed_in_seconds() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = common::take(root.path());
    lengthen(&capture);
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

/// The images of the capture over and over, by links.
fn lengthen(capture: &Path) {
    for camera in cameras() {
        let folder = capture.join("images").join(&camera.name);
        for frame in common::FRAMES..FRAMES {
            let of = folder.join(format!("{:06}.png", frame % common::FRAMES));
            std::fs::hard_link(of, folder.join(format!("{frame:06}.png"))).unwrap();
        }
    }
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
                by_value(phase.name, &mut out);
            }
            out.finish(&item.key(phase.name), inputs.hashes, Vec::new()).unwrap();
        }
    }
}

fn by_value(phase: &str, out: &mut Writer) {
    match phase {
        "hull/grid" => {
            out.whole("hull/grid/origin", &[3], &[0.0f64; 3]).unwrap();
            out.whole("hull/grid/voxel_mm", &[1], &[5.0f64]).unwrap();
            out.whole("hull/grid/dims", &[3], &[8u32; 3]).unwrap();
        }
        "pose/pose" => {
            let rows = RigidTransform::IDENTITY.to_rows().as_flattened().repeat(FRAMES);
            out.whole("pose/world_from_head", &[FRAMES, 4, 4], &rows).unwrap();
            out.whole("pose/markers", &[FRAMES, 1, 3], &vec![0.0f64; 3 * FRAMES]).unwrap();
            let views = cameras().len();
            out.whole("pose/tracks", &[FRAMES, views, 1, 2], &vec![0.0f64; 2 * views * FRAMES]).unwrap();
            out.whole("pose/rms_px", &[FRAMES], &vec![0.0f64; FRAMES]).unwrap();
            out.whole("pose/used", &[FRAMES], &vec![0u32; FRAMES]).unwrap();
            out.whole("pose/interpolated", &[FRAMES], &vec![0u8; FRAMES]).unwrap();
        }
        "scalp/scalp" => out.whole("scalp/roots", &[STRANDS, 3], &vec![0.0f64; 3 * STRANDS]).unwrap(),
        "smooth/topology" => out.whole("smooth/point_count", &[1], &[40u32]).unwrap(),
        _ => {}
    }
}
