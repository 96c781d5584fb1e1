//! A small synthetic take on which all thirteen stages work.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

use std::path::{Path, PathBuf};

use super::{stderr, strandflow, text, write};

/// Frames of the capture.
pub const FRAMES: usize = 4;

/// As small as the stages bear: five views of 128 × 96 pixels, 400 strands of which 60 are simulated.
const SPEC: &str = "
seed = 5
[rig]
frames = 4
views = 5
width = 128
height = 96
subsamples = 2
[groom]
strands = 400
guides = 60
width_mm = 1.5
[motion]
quiet_frames = 2
[physics]
settle_secs = 0.2
";

/// Settings of the take: two blocks of strands, a coarse grid.
const SETTINGS: &str = "
[settings.hull]
voxel_mm = 5.0
[settings.scalp]
root_count = 600
[settings.pose]
marker_radius_px = 2.0
";

/// Makes the capture.
pub fn capture(folder: &Path) {
    let spec = folder.with_extension("toml");
    write(&spec, SPEC);
    let made = strandflow(&["synth", text(folder), "--spec", text(&spec)]);
    assert!(made.status.success(), "{}", stderr(&made));
}

/// A take `name` of a capture beside it, with small settings; `more`: further arguments of `new`.
pub fn take_of(capture: &Path, name: &str, more: &[&str]) -> PathBuf {
    let take = capture.with_file_name(name);
    let made = strandflow(&[&["new", text(&take), "--capture", text(capture)], more].concat());
    assert!(made.status.success(), "{}", stderr(&made));
    let manifest = take.join("strandflow.toml");
    let written = std::fs::read_to_string(&manifest).unwrap();
    std::fs::write(manifest, written + SETTINGS).unwrap();
    take
}
