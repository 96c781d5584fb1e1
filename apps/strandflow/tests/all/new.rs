//! `new` on footage and calibrations as people have them.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

use std::path::Path;

use crate::common::{assert_bad_input, capture, stderr, strandflow, text};

/// The test capture's cameras as Nerfstudio writes them: camera to world, OpenGL axes, metres.
fn transforms() -> String {
    let frame = |camera: &strandflow_core::Camera| {
        let mut rows = camera.camera_from_world.inverse().to_rows();
        for row in rows.iter_mut().take(3) {
            (row[1], row[2], row[3]) = (-row[1], -row[2], row[3] / 1000.0);
        }
        format!("{{\"file_path\": \"images/{}/000000.png\", \"transform_matrix\": {rows:?}}}", camera.name)
    };
    let frames: Vec<String> = crate::common::cameras().iter().map(frame).collect();
    format!(
        "{{\"fl_x\": 180.0, \"fl_y\": 180.0, \"cx\": 32.0, \"cy\": 24.0, \"w\": 64, \"h\": 48, \"frames\": [{}]}}",
        frames.join(", ")
    )
}

fn manifest(take: &Path) -> String {
    std::fs::read_to_string(take.join("strandflow.toml")).unwrap()
}

#[test]
fn the_plain_layout_is_read_in_place() {
    let root = tempfile::tempdir().unwrap();
    let (from, take) = crate::common::take(root.path());
    assert!(manifest(&take).contains(text(&from.join("calibration.json"))), "{}", manifest(&take));
    assert!(!take.join("calibration.toml").exists());
}

#[test]
fn a_foreign_calibration_gives_the_same_cameras_and_runs() {
    let root = tempfile::tempdir().unwrap();
    let (from, take) = (root.path().join("capture"), root.path().join("take"));
    capture(&from);
    std::fs::remove_file(from.join("calibration.json")).unwrap();
    let file = root.path().join("rig.json");
    crate::common::write(&file, &transforms());
    let new = |more: &[&str]| {
        let fixed = ["new", text(&take), "--capture", text(&from), "--calibration", text(&file)];
        strandflow(&[&fixed, more].concat())
    };
    let unsaid = new(&[]);
    assert_bad_input(&unsaid, &["rig.json", "unit"]);
    assert!(stderr(&unsaid).contains("--unit"), "{}", stderr(&unsaid));
    assert_bad_input(&new(&["--unit", "m"]), &["frames there are a second"]);
    assert!(!take.exists(), "nothing is written before all is known");
    let made = new(&["--unit", "m", "--fps", "100"]);
    assert!(made.status.success(), "{}", stderr(&made));
    // The capture's cameras stand in a world with z up, and look down on it by 150 mm in a metre.
    for part in ["3 views: cam0, cam1, cam2", "gravity is taken along [0, 0, -1]", "1011 to 1011 mm"] {
        assert!(stderr(&made).contains(part), "`{part}` is not in {}", stderr(&made));
    }
    // It serves as it is, with the unit that was told.
    assert!(
        !take.join("calibration.toml").exists() && manifest(&take).contains("unit_mm = 1000.0"),
        "{}",
        manifest(&take)
    );
    let opened = strandflow_engine::Take::open(&take).unwrap();
    let rig = opened.rig();
    for (camera, expected) in rig.cameras.iter().zip(crate::common::cameras()) {
        let p = glam::DVec3::new(30.0, 40.0, 50.0);
        let off = camera.camera_from_world.point(p) - expected.camera_from_world.point(p);
        assert!(off.length() < 1e-9 && camera.name == expected.name, "{}: {off}", camera.name);
    }
    let run = strandflow(&["run", text(&take), "--to", "masks"]);
    assert!(run.status.success(), "{}", stderr(&run));
}

#[test]
fn what_is_still_to_be_made_is_said_and_is_no_failure() {
    let root = tempfile::tempdir().unwrap();
    let (from, take) = (root.path().join("capture"), root.path().join("take"));
    capture(&from);
    std::fs::remove_dir_all(from.join("user")).unwrap();
    let made = strandflow(&["new", text(&take), "--capture", text(&from)]);
    assert!(made.status.success() && stderr(&made).contains("still to be made: marker labels"), "{}", stderr(&made));
    assert!(manifest(&take).contains("markers = \"user/marker_labels.json\""), "{}", manifest(&take));
}

#[test]
fn options_that_mean_nothing_are_bad_usage() {
    for wrong in [["--convention", "maya"], ["--unit", "furlong"], ["--up", "w"], ["--fps", "0"]] {
        let made = strandflow(&[&["new", "take", "--capture", "."], wrong.as_slice()].concat());
        assert_eq!(made.status.code(), Some(2), "{wrong:?}: {}", stderr(&made));
    }
}
