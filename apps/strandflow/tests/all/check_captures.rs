//! `strandflow check` is silent on footage with truth, recovers the delay of a view that is shown late, and names a camera that was
//! turned.
//!
//! `STRANDFLOW_WRITE_DOCS=1 cargo test -p strandflow --test all check_captures` writes the table of `docs/check.md` anew.

use std::path::{Path, PathBuf};

use crate::common::{stderr, strandflow, text};
use glam::{DMat3, DVec3};
use serde_json::Value;
use strandflow_core::{ImageSource, RgbImage, RigidTransform};
use strandflow_io::{TakeSource, ViewInput, calibration::own_toml::write_toml, read_calibration, write_rgb_png};

/// Captures of 30 frames: `STRANDFLOW_CAPTURES`, or `shared/captures` beside the repository.
fn captures() -> Vec<(&'static str, PathBuf)> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/captures");
    let root = std::env::var_os("STRANDFLOW_CAPTURES").map_or_else(|| PathBuf::from(beside), PathBuf::from);
    let all = ["dev-straight", "dev-long-wavy"].map(|name| (name, root.join(name)));
    all.into_iter().filter(|(_, folder)| folder.is_dir()).collect()
}

fn take_of(capture: &Path, take: &Path) -> PathBuf {
    let made = strandflow(&["new", text(take), "--capture", text(capture)]);
    assert!(made.status.success(), "{}", stderr(&made));
    take.join("strandflow.toml")
}

/// What the checks up to `last` find.
fn findings(take: &Path, last: &str) -> Vec<Value> {
    let run = strandflow(&["check", text(take), "--to", last, "--json"]);
    let checks: Vec<Value> = serde_json::from_slice(&run.stdout).unwrap_or_else(|_| panic!("{}", stderr(&run)));
    checks.iter().flat_map(|check| check["findings"].as_array().cloned().unwrap_or_default()).collect()
}

#[test]
fn sound_captures_are_sound() {
    let root = tempfile::tempdir().expect("a folder");
    for (name, folder) in captures() {
        let take = root.path().join(name);
        take_of(&folder, &take);
        let said = findings(&take, "cost");
        assert!(said.is_empty(), "{name}: {said:#?}");
    }
}

#[test]
fn a_view_turned_by_half_a_degree_is_named() {
    let root = tempfile::tempdir().expect("a folder");
    for (name, folder) in captures() {
        for (view, axis) in [(5, DVec3::Y), (3, DVec3::Z)] {
            let take = root.path().join(format!("{name}-turned-{view}"));
            let manifest = take_of(&folder, &take);
            let written = std::fs::read_to_string(&manifest).expect("the manifest is there");
            let given = folder.join("calibration.json").canonicalize().expect("the calibration is there");
            let mut calibration = read_calibration(&given, None).expect("the calibration is read");
            let camera = &mut calibration.rig.cameras[view];
            let rotation = DMat3::from_axis_angle(axis, 0.5f64.to_radians());
            let turn = RigidTransform { rotation, translation: DVec3::ZERO };
            camera.camera_from_world = turn.after(&camera.camera_from_world);
            let place = format!("view {}", camera.name);
            let turned = take.join("turned.toml");
            write_toml(&turned, &calibration).expect("the calibration is written");
            let replaced = written.replace(text(&given), text(&turned));
            assert_ne!(replaced, written, "the manifest names the calibration");
            std::fs::write(manifest, replaced).expect("the manifest is written");
            let said = findings(&take, "followed");
            // Half a degree sideways moves markers by 13 px, which the labels show; about the axis by half a pixel.
            let fault = if axis == DVec3::Z { "epipolar" } else { "view-off" };
            assert!(
                said.len() == 1 && said[0]["fault"] == fault && said[0]["place"] == place.as_str(),
                "{name}: {said:#?}"
            );
            let fact = said[0]["fact"].as_str().unwrap_or_default();
            let degrees = fact.split("turned by ").nth(1).and_then(|rest| rest.split('°').next()?.parse::<f64>().ok());
            assert!(degrees.is_some_and(|degrees| (degrees - 0.5).abs() < 0.1), "{name}: {fact}");
        }
    }
}

/// Frames between which a view is shown: one and a half late.
const LATE: f64 = 1.5;
/// Frames of a capture.
const FRAMES: usize = 30;

/// The mean of two images.
fn mean(a: &RgbImage, b: &RgbImage) -> RgbImage {
    let half = |a: u8, b: u8| (u16::from(a) + u16::from(b)).div_ceil(2) as u8;
    let data = a.data.iter().zip(&b.data).map(|(a, b)| [0, 1, 2].map(|c| half(a[c], b[c]))).collect();
    RgbImage { data, ..*a }
}

/// A take in which frame k of a view is the mean of its frames k + 1 and k + 2.
fn with_late_view(capture: &Path, take: &Path, view: &str) {
    let clip = capture.join(format!("video/{view}.mp4"));
    let source = TakeSource::open(&[(view.to_owned(), ViewInput::of(&clip))]).expect("the clip can be opened");
    let late = take.join("late").join(view);
    std::fs::create_dir_all(&late).expect("a folder can be made");
    let image = |frame: usize| source.image(0, frame).expect("the frame is there");
    for frame in 0..FRAMES - 2 {
        let shown = mean(&image(frame + 1), &image(frame + 2));
        write_rgb_png(&late.join(format!("{frame:06}.png")), &shown).expect("an image can be written");
    }
    let manifest = take_of(capture, take);
    let written = std::fs::read_to_string(&manifest).expect("the manifest is there");
    let written = written
        .replace(text(&clip.canonicalize().expect("the clip is there")), text(&late))
        .replace("# frames = \"0..30\"", &format!("frames = \"0..{}\"", FRAMES - 2));
    std::fs::write(manifest, written).expect("the manifest can be written");
}

#[test]
fn a_late_view_is_timed() {
    let root = tempfile::tempdir().expect("a folder");
    let mut rows =
        vec!["| capture | view shown 1.5 frames late | found | error |".to_owned(), "|---|---|---:|---:|".to_owned()];
    let all = captures();
    if all.is_empty() {
        eprintln!("skipped: captures not found");
        return;
    }
    for (name, folder) in all {
        for view in ["cam00", "cam03", "cam05"] {
            let take = root.path().join(format!("{name}-{view}"));
            with_late_view(&folder, &take, view);
            let said = findings(&take, "time");
            let offsets: Vec<&Value> = said.iter().filter(|f| f["fault"] == "offset").collect();
            assert_eq!(offsets.len(), 1, "{name}, {view}: {said:#?}");
            let fact = offsets[0]["fact"].as_str().unwrap_or_default();
            assert!(offsets[0]["place"].as_str().is_some_and(|place| place.contains(view)), "{said:#?}");
            let found: f64 = fact.split(' ').nth(2).and_then(|number| number.parse().ok()).expect("the delay is said");
            assert!(fact.contains("later") && (found - LATE).abs() <= 0.2, "{name}, {view}: {fact}");
            rows.push(format!("| {name} | {view} | {found:.2} | {:+.2} |", found - LATE));
        }
    }
    if std::env::var_os("STRANDFLOW_WRITE_DOCS").is_some() {
        write_rows(&rows.join("\n"));
    }
}

fn write_rows(table: &str) {
    const BEGIN: &str = "<!-- begin: written by tests/all/check_captures.rs -->\n";
    const END: &str = "\n<!-- end: captures -->";
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/check.md");
    let written = std::fs::read_to_string(&file).expect("docs/check.md is there");
    let (head, rest) = written.split_once(BEGIN).expect("the table's beginning is marked");
    let (_, tail) = rest.split_once(END).expect("the table's end is marked");
    std::fs::write(&file, format!("{head}{BEGIN}{table}{END}{tail}")).expect("docs/check.md can be written");
}
