//! A frame without a volume costs that frame; the frames after it are grown all the same, and mending it heals the take.

use crate::common::{assert_bad_input, stderr, strandflow, synthetic, text, write_mask};
use strandflow_core::Mask;

#[test]
fn a_frame_without_a_hull_costs_no_other_frame() {
    let root = tempfile::tempdir().unwrap();
    let capture = root.path().join("capture");
    synthetic::capture(&capture);
    let take = synthetic::take_of(&capture, "take", &[]);
    let masks = root.path().join("subject_masks");
    let spoilt = masks.join("cam01/000002.png");
    write_mask(&spoilt, &Mask::filled(128, 96, 0));
    let manifest = std::fs::read_to_string(take.join("strandflow.toml")).unwrap();
    let folder = format!("subject_masks = {:?}", text(&masks));
    let manifest = manifest.replace("# subject_masks = \"corrections/subject_masks\"", &folder);
    std::fs::write(take.join("strandflow.toml"), manifest).unwrap();

    let run = strandflow(&["run", text(&take), "--to", "grow"]);
    assert_bad_input(&run, &["view cam01, frame 2", "the subject mask is empty"]);
    let grown = |frame: usize| take.join(format!("results.zarr/.items/grow/grow/{frame:06}.json")).exists();
    assert_eq!([0, 1, 2, 3].map(grown), [true, true, false, true]);

    std::fs::remove_file(&spoilt).unwrap();
    let run = strandflow(&["run", text(&take), "--to", "grow"]);
    assert!(run.status.success(), "{}", stderr(&run));
    let status = strandflow(&["status", text(&take)]);
    let table = String::from_utf8_lossy(&status.stdout).into_owned();
    let row = table.lines().find(|line| line.starts_with("grow/grow")).unwrap_or_else(|| panic!("{table}"));
    assert_eq!(row.split_whitespace().skip(1).collect::<Vec<_>>(), ["4", "4", "0", "0", "0"], "{table}");
}
