//! Every kind of bad input is a located error with a hint and exit code 2, and leaves the results whole.

mod common;

use common::{assert_bad_input, bytes_below, stderr, strandflow, take, text};
use strandflow_core::{Mask, RgbImage};

#[test]
fn a_missing_frame_names_view_and_frame() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = take(root.path());
    std::fs::remove_file(capture.join("images/cam1/000002.png")).unwrap();
    assert_bad_input(&strandflow(&["run", text(&take), "--to", "masks"]), &["cam1", "frame 2", "missing"]);
    assert!(!take.join("results.zarr/masks").exists());
}

#[test]
fn a_camera_without_calibration_is_named() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = take(root.path());
    let calibration = common::calibration().replace("\"name\": \"cam2\"", "\"name\": \"other\"");
    common::write(&capture.join("calibration.json"), &calibration);
    assert_bad_input(&strandflow(&["run", text(&take), "--to", "masks"]), &["calibration.json", "cam2"]);
}

#[test]
fn a_clip_of_another_length_or_size_is_named() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = take(root.path());
    std::fs::remove_file(capture.join("images/cam2/000003.png")).unwrap();
    assert_bad_input(&strandflow(&["run", text(&take), "--to", "masks"]), &["cam2", "3 frames", "frame 3"]);
    // Frames that all have can still be asked for.
    let manifest = std::fs::read_to_string(take.join("strandflow.toml")).unwrap();
    std::fs::write(take.join("strandflow.toml"), manifest.replace("# frames = \"0..30\"", "frames = \"0..3\""))
        .unwrap();
    let run = strandflow(&["run", text(&take), "--to", "masks"]);
    assert!(run.status.success(), "{}", stderr(&run));
    for frame in 0..4 {
        common::write_rgb(&capture.join(format!("images/cam2/{frame:06}.png")), &RgbImage::filled(32, 24, [90; 3]));
    }
    assert_bad_input(&strandflow(&["run", text(&take), "--to", "masks"]), &["cam2", "32", "64"]);
}

#[test]
fn an_unreadable_image_costs_its_view_from_that_frame_on_and_nothing_else() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = take(root.path());
    let broken = capture.join("images/cam0/000002.png");
    let whole = std::fs::read(&broken).unwrap();
    std::fs::write(&broken, &whole[..whole.len() / 2]).unwrap();
    let run = strandflow(&["run", text(&take), "--to", "masks", "--threads", "2"]);
    assert_bad_input(&run, &["000002.png", "cam0", "frame 2"]);
    let items = take.join("results.zarr/.items/masks/masks");
    assert!(items.join("view00/000001.json").exists() && items.join("view00/000002.failed").exists());
    assert!(items.join("view01/000003.json").exists() && !items.join("view00/000003.json").exists());
    // Put right, the run goes on and ends like one that never met the broken image.
    std::fs::write(&broken, &whole).unwrap();
    assert!(strandflow(&["run", text(&take), "--to", "masks"]).status.success());
    let other = tempfile::tempdir().unwrap();
    let (_, straight) = common::take(other.path());
    assert!(strandflow(&["run", text(&straight), "--to", "masks"]).status.success());
    assert_eq!(bytes_below(&take.join("results.zarr")), bytes_below(&straight.join("results.zarr")));
}

#[test]
fn a_mask_that_empties_the_hull_is_an_error_of_the_hull() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = take(root.path());
    for frame in 0..common::FRAMES {
        common::write_mask(&capture.join(format!("user/subject_masks/cam1/{frame:06}.png")), &Mask::filled(64, 48, 0));
    }
    let manifest = std::fs::read_to_string(take.join("strandflow.toml")).unwrap();
    let folder = format!("subject_masks = {:?}", text(&capture.join("user/subject_masks")));
    let manifest = manifest.replace("# subject_masks = \"corrections/subject_masks\"", &folder);
    std::fs::write(take.join("strandflow.toml"), manifest).unwrap();
    assert_bad_input(&strandflow(&["run", text(&take), "--to", "hull"]), &["cam1"]);
}

#[test]
fn fewer_than_five_markers_are_counted() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = take(root.path());
    common::write(&capture.join("user/marker_labels.json"), &common::labels(4));
    assert_bad_input(&strandflow(&["run", text(&take)]), &["marker_labels.json", "4 markers", "at least 5"]);
}

#[test]
fn a_number_that_is_not_finite_is_an_error() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = take(root.path());
    let manifest = std::fs::read_to_string(take.join("strandflow.toml")).unwrap();
    std::fs::write(take.join("strandflow.toml"), manifest.replace("fps = 100.0", "fps = nan")).unwrap();
    assert_bad_input(&strandflow(&["run", text(&take)]), &["strandflow.toml", "fps"]);
    std::fs::write(take.join("strandflow.toml"), manifest).unwrap();
    let calibration = common::calibration().replace("[180, 0, 32]", "[1e999, 0, 32]");
    assert_ne!(calibration, common::calibration());
    common::write(&capture.join("calibration.json"), &calibration);
    assert_bad_input(&strandflow(&["run", text(&take)]), &["calibration.json"]);
}

#[test]
fn bad_usage_is_exit_code_two() {
    let root = tempfile::tempdir().unwrap();
    let (_, take) = take(root.path());
    assert_bad_input(&strandflow(&["run", text(&take), "--to", "nothing"]), &["nothing"]);
    assert_bad_input(&strandflow(&["run", text(&take), "--frames", "2..9"]), &["2..9", "0..4"]);
    assert_eq!(strandflow(&["run", text(&take), "--frames", "4..2"]).status.code(), Some(2));
    assert_bad_input(&strandflow(&["new", text(&take), "--capture", text(root.path())]), &["exists"]);
    assert_bad_input(&strandflow(&["status", text(root.path())]), &["no manifest"]);
}
