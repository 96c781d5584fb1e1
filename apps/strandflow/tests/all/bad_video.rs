//! Bad input of takes whose views are videos; skipped where ffmpeg is not installed.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use crate::common::{FRAMES, VIEWS, assert_bad_input, stderr, strandflow, text};

/// The tiny capture with lossless videos instead of images, and its take. `None` without ffmpeg.
fn take(root: &Path) -> Option<(PathBuf, PathBuf)> {
    if !strandflow_io::source::probe::ffmpeg_is_installed() {
        eprintln!("skipped: no ffmpeg");
        return None;
    }
    let (capture, take) = (root.join("capture"), root.join("take"));
    crate::common::capture(&capture);
    for view in 0..VIEWS {
        encode(&capture, view, FRAMES, "64x48", LOSSLESS);
    }
    std::fs::rename(capture.join("images"), root.join("images")).unwrap();
    let made = strandflow(&["new", text(&take), "--capture", text(&capture)]);
    assert!(made.status.success(), "{}", stderr(&made));
    Some((capture, take))
}

const LOSSLESS: &[&str] = &["-c:v", "ffv1"];

/// Encodes the first frames of a view, in some size and codec.
fn encode(capture: &Path, view: usize, frames: usize, size: &str, codec: &[&str]) {
    let images = [capture.join("images"), capture.with_file_name("images")].into_iter().find(|p| p.exists()).unwrap();
    std::fs::create_dir_all(capture.join("video")).unwrap();
    let made = Command::new("ffmpeg")
        .args(["-y", "-v", "error", "-framerate", "100", "-i"])
        .arg(images.join(format!("cam{view}/%06d.png")))
        .args(["-frames:v", &frames.to_string(), "-s", size])
        .args(codec)
        .arg(capture.join(format!("video/cam{view}.mkv")))
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", stderr(&made));
}

#[test]
fn videos_run_like_images() {
    let root = tempfile::tempdir().unwrap();
    let Some((_, take)) = take(root.path()) else { return };
    let run = strandflow(&["run", text(&take), "--to", "masks"]);
    assert!(run.status.success(), "{}", stderr(&run));
}

#[test]
fn a_clip_of_another_length_or_size_is_named() {
    let root = tempfile::tempdir().unwrap();
    let Some((capture, take)) = take(root.path()) else { return };
    encode(&capture, 1, FRAMES - 1, "64x48", LOSSLESS);
    assert_bad_input(&strandflow(&["run", text(&take)]), &["cam1.mkv", "view cam1", "frame 3", "3 frames"]);
    encode(&capture, 1, FRAMES, "32x24", LOSSLESS);
    assert_bad_input(&strandflow(&["run", text(&take)]), &["cam1.mkv", "view cam1", "32×24", "64×48"]);
    assert!(!take.join("results.zarr/masks").exists());
}

#[test]
fn a_clip_that_is_missing_or_no_video_is_named() {
    let root = tempfile::tempdir().unwrap();
    let Some((capture, take)) = take(root.path()) else { return };
    let clip = capture.join("video/cam2.mkv");
    std::fs::write(&clip, "no video").unwrap();
    assert_bad_input(&strandflow(&["run", text(&take)]), &["cam2.mkv", "view cam2", "no readable video"]);
    std::fs::remove_file(&clip).unwrap();
    assert_bad_input(&strandflow(&["run", text(&take)]), &["cam2.mkv", "view cam2"]);
}

/// The container still tells of all frames, and a player would show something for each; only decoding meets the damage.
#[test]
fn a_clip_damaged_in_the_middle_costs_its_view_from_there_on_and_nothing_else() {
    let root = tempfile::tempdir().unwrap();
    let Some((capture, take)) = take(root.path()) else { return };
    let clip = capture.join("video/cam0.mkv");
    encode(&capture, 0, FRAMES, "64x48", &["-f", "mp4", "-c:v", "mjpeg", "-q:v", "2"]);
    let mut bytes = std::fs::read(&clip).unwrap();
    // All frames lie in one box, `mdat`, behind its length.
    let at = bytes.windows(4).position(|name| name == b"mdat").unwrap();
    let length = u32::from_be_bytes(bytes[at - 4..at].try_into().unwrap()) as usize;
    bytes[at + length * 60 / 100..at + length * 70 / 100].iter_mut().for_each(|byte| *byte ^= 0x5a);
    std::fs::write(&clip, bytes).unwrap();
    assert_bad_input(&strandflow(&["run", text(&take), "--to", "masks"]), &["cam0.mkv", "view cam0", "decoded"]);
    let items = take.join("results.zarr/.items/masks/masks");
    assert!(items.join("view01/000003.json").exists() && items.join("view02/000003.json").exists());
    assert!(!items.join("view00/000002.json").exists());
}

#[test]
fn without_ffmpeg_the_install_hint_is_given() {
    let root = tempfile::tempdir().unwrap();
    let Some((_, take)) = take(root.path()) else { return };
    let run = Command::new(env!("CARGO_BIN_EXE_strandflow"))
        .args(["run", text(&take)])
        .env("PATH", root.path())
        .output()
        .unwrap();
    assert_bad_input(&run, &["ffprobe", "was not found", "cam0.mkv"]);
    assert!(stderr(&run).contains("apt install ffmpeg"));
}
