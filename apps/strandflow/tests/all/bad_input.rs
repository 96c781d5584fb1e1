//! Every kind of bad input is a located error with a hint and exit code 2, and leaves the results whole.

use crate::common::{assert_bad_input, bytes_below, stderr, strandflow, take, text};
use strandflow_core::{Mask, RgbImage};

#[test]
fn a_missing_frame_names_view_and_frame() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = take(root.path());
    std::fs::remove_file(capture.join("images/cam1/000002.png")).unwrap();
    assert_bad_input(&strandflow(&["run", text(&take), "--to", "masks"]), &["cam1", "frame 2", "missing"]);
    assert!(!take.join("results.zarr/masks").exists());
}

#[cfg(unix)]
#[test]
fn a_strangers_take_stays_in_its_folder() {
    let root = tempfile::tempdir().unwrap();
    let (_, outside) = take(root.path());
    for command in ["run", "check"] {
        assert_bad_input(
            &strandflow(&[command, text(&outside), "--confined"]),
            &["calibration.file", "lies outside the take"],
        );
    }
    assert!(!outside.join("run.log").exists());
    let inside = root.path().join("inside");
    crate::common::capture(&inside.join("capture"));
    let made = strandflow(&["new", text(&inside), "--capture", text(&inside.join("capture"))]);
    assert!(made.status.success(), "{}", stderr(&made));
    let run = strandflow(&["run", text(&inside), "--to", "masks", "--confined"]);
    assert!(run.status.success(), "{}", stderr(&run));
    // Results would be written where the link leads.
    std::fs::rename(inside.join("results.zarr"), root.path().join("elsewhere")).unwrap();
    std::os::unix::fs::symlink(root.path().join("elsewhere"), inside.join("results.zarr")).unwrap();
    assert_bad_input(&strandflow(&["run", text(&inside), "--confined"]), &["symbolic link", "results.zarr"]);
}

#[test]
fn a_camera_without_calibration_is_named() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = take(root.path());
    let calibration = crate::common::calibration().replace("\"name\": \"cam2\"", "\"name\": \"other\"");
    crate::common::write(&capture.join("calibration.json"), &calibration);
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
        crate::common::write_rgb(
            &capture.join(format!("images/cam2/{frame:06}.png")),
            &RgbImage::filled(32, 24, [90; 3]),
        );
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
    let (_, straight) = crate::common::take(other.path());
    assert!(strandflow(&["run", text(&straight), "--to", "masks"]).status.success());
    assert_eq!(bytes_below(&take.join("results.zarr")), bytes_below(&straight.join("results.zarr")));
}

#[test]
fn a_mask_that_empties_the_hull_is_an_error_of_the_hull() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = take(root.path());
    for frame in 0..crate::common::FRAMES {
        crate::common::write_mask(
            &capture.join(format!("user/subject_masks/cam1/{frame:06}.png")),
            &Mask::filled(64, 48, 0),
        );
    }
    let manifest = std::fs::read_to_string(take.join("strandflow.toml")).unwrap();
    let folder = format!("subject_masks = {:?}", text(&capture.join("user/subject_masks")));
    let manifest = manifest.replace("# subject_masks = \"corrections/subject_masks\"", &folder);
    std::fs::write(take.join("strandflow.toml"), manifest).unwrap();
    assert_bad_input(&strandflow(&["run", text(&take), "--to", "hull"]), &["cam1"]);
}

#[test]
fn a_folder_that_begins_late_is_not_taken_for_another_clip() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = take(root.path());
    std::fs::remove_file(capture.join("images/cam0/000000.png")).unwrap();
    assert_bad_input(&strandflow(&["run", text(&take), "--to", "masks"]), &["cam0", "frame 0", "begin at number 1"]);
}

#[test]
fn unreadable_plates_and_masks_are_named_with_their_view() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = take(root.path());
    let plate = capture.join("clean/cam1.png");
    let whole = std::fs::read(&plate).unwrap();
    std::fs::write(&plate, "no image").unwrap();
    assert_bad_input(&strandflow(&["run", text(&take), "--to", "masks"]), &["clean/cam1.png", "view cam1"]);
    std::fs::write(&plate, whole).unwrap();
    std::fs::write(capture.join("user/hair_masks/cam2/000000.png"), "no image").unwrap();
    let run = strandflow(&["run", text(&take), "--to", "masks"]);
    assert_bad_input(&run, &["hair_masks/cam2/000000.png", "view cam2, frame 0"]);
}

#[test]
fn labels_outside_the_image_and_of_no_number_are_named() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = take(root.path());
    let labels = crate::common::labels(7);
    let first = labels.find("\"cam1\": [").unwrap() + "\"cam1\": [".len();
    let end = first + labels[first..].find(',').unwrap();
    let with = |number: &str| format!("{}{number}{}", &labels[..first], &labels[end..]);
    crate::common::write(&capture.join("user/marker_labels.json"), &with("900.0"));
    let run = strandflow(&["run", text(&take)]);
    assert_bad_input(&run, &["marker_labels.json", "view cam1, frame 0", "marker 0", "64×48"]);
    crate::common::write(&capture.join("user/marker_labels.json"), &with("NaN"));
    assert_bad_input(&strandflow(&["run", text(&take)]), &["marker_labels.json:1", "non-finite number NaN"]);
}

#[test]
fn fewer_than_five_markers_are_counted() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = take(root.path());
    crate::common::write(&capture.join("user/marker_labels.json"), &crate::common::labels(4));
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
    let calibration = crate::common::calibration().replace("[180, 0, 32]", "[1e999, 0, 32]");
    assert_ne!(calibration, crate::common::calibration());
    crate::common::write(&capture.join("calibration.json"), &calibration);
    assert_bad_input(&strandflow(&["run", text(&take)]), &["calibration.json"]);
}

#[test]
fn stages_run_on_results_that_are_out_of_date_only_with_a_warning() {
    let root = tempfile::tempdir().unwrap();
    let (_, take) = take(root.path());
    assert!(strandflow(&["run", text(&take), "--to", "hull"]).status.success());
    let quiet = strandflow(&["run", text(&take), "--from", "hull", "--to", "hull"]);
    assert!(!stderr(&quiet).contains("warning"), "{}", stderr(&quiet));
    let manifest = std::fs::read_to_string(take.join("strandflow.toml")).unwrap();
    let changed = "\n[settings.masks]\nhair_threshold_that_is_none = 1\n";
    std::fs::write(take.join("strandflow.toml"), manifest.clone() + changed).unwrap();
    assert_bad_input(&strandflow(&["run", text(&take)]), &["strandflow.toml", "hair_threshold_that_is_none"]);
    std::fs::write(take.join("strandflow.toml"), manifest).unwrap();
    let run = strandflow(&["run", text(&take), "--from", "hull", "--to", "hull", "--mode", "paper"]);
    assert!(stderr(&run).contains("warning: --from") && stderr(&run).contains("masks/masks: 12 stale of 12"));
}

#[test]
fn a_view_held_out_must_be_one() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = take(root.path());
    let other = root.path().join("other");
    let new = strandflow(&["new", text(&other), "--capture", text(&capture), "--hold-out", "cam7"]);
    assert_bad_input(&new, &["cam7"]);
    assert!(!other.exists());
    let manifest = std::fs::read_to_string(take.join("strandflow.toml")).unwrap();
    let manifest = manifest.replace("# held_out = [\"cam03\"]", "held_out = [\"cam0\", \"cam1\"]");
    std::fs::write(take.join("strandflow.toml"), manifest).unwrap();
    assert_bad_input(&strandflow(&["run", text(&take)]), &["held_out", "1 views"]);
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

#[test]
fn exports_that_do_not_go_together_are_told_before_the_take_is_read() {
    for (args, told) in [
        (["--stage", "flow", "--to", "abc"].as_slice(), "vdb only"),
        (&["--stage", "blend", "--to", "vdb"], "not strands"),
        (&["--stage", "flow", "--to", "vdb", "--guides", "5"], "no strands"),
        (&["--stage", "blend", "--to", "hair", "--for", "unreal"], "the take's world"),
        (&["--stage", "blend", "--to", "cards"], "along guides"),
        (&["--stage", "blend", "--to", "csv"], "what `fit` found"),
        (&["--stage", "fit", "--to", "csv", "--strands", "5"], "every strand"),
    ] {
        let run = strandflow(&[&["export", "no.take"], args, &["out"]].concat());
        assert_bad_input(&run, &[told]);
        assert!(!std::path::Path::new("out").exists());
    }
}
