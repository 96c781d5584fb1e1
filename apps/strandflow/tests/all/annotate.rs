//! `strandflow annotate`: what is handed in is checked and stays in the take, `run` uses it, and the page in a browser.
#![expect(clippy::unwrap_used, reason = "a failing unwrap is a failing test")]

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
    process::Command,
};

use crate::common::{
    bytes_below, stderr, strandflow, synthetic, text,
    viewer::{Answer, Viewer, pages},
};
use serde_json::{Value, json};
use strandflow_core::Mask;
use strandflow_engine::Take;
use strandflow_io::{mask_png, read_mask};

const ABSENT: &str = "absent";

/// The page of a take.
struct Desk(Viewer);

impl Desk {
    fn of(take: &Path) -> Self {
        Self(Viewer::by("annotate", take, &[]))
    }

    fn version(&self, path: &str) -> String {
        let answer = self.0.get(path);
        assert_eq!(answer.status, 200, "{path}: {}", String::from_utf8_lossy(&answer.body));
        answer.headers["etag"].trim_matches('"').to_owned()
    }

    fn json(&self, path: &str) -> Value {
        serde_json::from_slice(&self.0.body(path)).unwrap()
    }

    fn put(&self, path: &str, version: &str, body: &[u8]) -> Answer {
        self.sent("PUT", path, &[&format!("If-Match: \"{version}\"")], body)
    }

    fn delete(&self, path: &str, version: &str) -> Answer {
        self.sent("DELETE", path, &[&format!("If-Match: \"{version}\"")], &[])
    }

    /// With host and token.
    fn sent(&self, method: &str, path: &str, more: &[&str], body: &[u8]) -> Answer {
        let own = ["Host: localhost".to_owned(), format!("Authorization: Bearer {}", self.0.token)];
        let own = own.into_iter().chain([format!("Content-Length: {}", body.len())]).collect::<Vec<_>>();
        let headers: Vec<&str> = own.iter().map(String::as_str).chain(more.iter().copied()).collect();
        self.0.send(method, path, &headers, body)
    }
}

fn made(root: &Path) -> (PathBuf, PathBuf) {
    let capture = root.join("capture");
    synthetic::capture(&capture);
    let take = synthetic::take_of(&capture, "take", &[]);
    (capture, take)
}

/// Keys of the items that a run did.
fn done_by_run(take: &Path, to: &str) -> BTreeSet<String> {
    let run = strandflow(&["run", text(take), "--to", to, "--json"]);
    assert!(run.status.success(), "{}", stderr(&run));
    let events = String::from_utf8_lossy(&run.stdout).into_owned();
    let events = events.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let done = events.filter(|event| event["event"] == "item" && event["outcome"] == "done");
    done.map(|event| event["item"].as_str().unwrap().to_owned()).collect()
}

fn keys(items: &[&str]) -> BTreeSet<String> {
    items.iter().map(|&item| item.to_owned()).collect()
}

/// Everything that may not be handed in is refused, told in the terminal and the log, and changes nothing.
#[cfg(unix)]
#[test]
fn what_may_not_be_handed_in_is_refused_and_told() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = crate::common::take(root.path());
    let before = (bytes_below(&take), bytes_below(&capture));
    let desk = Desk::of(&take);
    let host = "Host: localhost";
    let token = format!("Authorization: Bearer {}", desk.0.token);
    let labels = desk.version("/api/labels");
    let current = format!("If-Match: \"{labels}\"");
    let good = desk.0.body("/api/labels");
    let length = format!("Content-Length: {}", good.len());
    let sent = |headers: &[&str]| desk.0.send("PUT", "/api/labels", headers, &good).status;

    // Who asks.
    assert_eq!(sent(&[host, &length, &current]), 401);
    assert_eq!(sent(&[host, &length, &current, "Authorization: Bearer 0123456789abcdef0123456789abcdef"]), 401);
    assert_eq!(sent(&["Host: example.org", &length, &current, &token]), 403);
    for origin in ["Origin: http://example.org", "Origin: null", "Origin: http://localhost:1"] {
        assert_eq!(sent(&[host, &length, &current, &token, origin]), 403, "{origin}");
    }
    // How much: a length that is too large is refused before a byte of it is read.
    assert_eq!(sent(&[host, &token, &current, "Content-Length: 99999999999"]), 413);
    let too_much = [host, &token, "If-Match: \"absent\"", "Content-Length: 9999999"];
    assert_eq!(desk.0.send("PUT", "/api/mask/hair/cam0/1", &too_much, &[]).status, 413);
    // Which version.
    assert_eq!(sent(&[host, &length, &token]), 400);
    assert_eq!(desk.put("/api/labels", "0000000000000000", &good).status, 409);
    // Where.
    for path in ["..%2F..%2Fetc", "%2e%2e", "cam9", "cam0%2F..%2Fcam1", "%00"] {
        let png = mask_png(&Mask::filled(64, 48, 255)).unwrap();
        assert_eq!(desk.put(&format!("/api/mask/hair/{path}/1"), ABSENT, &png).status, 404, "{path}");
    }
    assert_eq!(desk.put("/api/mask/skin/cam0/1", ABSENT, &mask_png(&Mask::filled(64, 48, 1)).unwrap()).status, 404);
    assert_eq!(desk.put("/api/sketches/4", ABSENT, br#"{"strands":[]}"#).status, 404);
    assert_eq!(desk.put("/api/sketches/..%2F0", ABSENT, br#"{"strands":[]}"#).status, 400);
    assert_eq!(desk.put("/api/work", ABSENT, b"{}").status, 405);
    assert_eq!(desk.put("/api/mask/hair/%ff/1", ABSENT, b"{}").status, 400);
    // What.
    let size = mask_png(&Mask::filled(48, 64, 255)).unwrap();
    let cut = &mask_png(&Mask::from_fn(64, 48, |x, y| (x * y) as u8)).unwrap()[..200];
    for (png, word) in [(&size[..], "48×64"), (cut, "PNG"), (b"{}", "PNG")] {
        let answer = desk.put("/api/mask/hair/cam0/1", ABSENT, png);
        let said = String::from_utf8_lossy(&answer.body).into_owned();
        assert!(answer.status == 400 && said.contains(word), "{said}");
    }
    for (json, word) in [
        ("{", "marker labels"),
        (r#"{"frame":0,"markers":[{"id":0,"views":{"cam0":[1e400,2]}}]}"#, "marker labels"),
        (r#"{"frame":0,"markers":[{"id":0,"views":{"cam0":[900,2]}}]}"#, "64×48"),
        (r#"{"frame":0,"markers":[{"id":0,"views":{"../x":[1,2]}}]}"#, "no such view"),
        (r#"{"frame":9,"markers":[]}"#, "frame 9"),
        (r#"{"frame":0,"markers":[],"corrections":[{"frame":2,"markers":[]},{"frame":2,"markers":[]}]}"#, "twice"),
    ] {
        let answer = desk.put("/api/labels", &labels, json.as_bytes());
        let said = String::from_utf8_lossy(&answer.body).into_owned();
        assert!(answer.status == 400 && said.contains(word), "{json}: {} {said}", answer.status);
    }
    let one_point = br#"{"strands":[{"id":0,"views":{"cam0":[[1,1]]}}]}"#;
    assert_eq!(desk.put("/api/sketches/1", ABSENT, one_point).status, 400);

    let (said, well) = desk.0.interrupt();
    let log = std::fs::read_to_string(take.join("run.log")).unwrap();
    for word in [
        "PUT /api/labels: 401",
        "403 the request comes from another page",
        ": 413 ",
        ": 409 ",
        "48×64",
        "..%2F..%2Fetc",
    ] {
        assert!(said.contains(word), "{word} is not in {said}");
    }
    let told = said.lines().filter(|line| line.starts_with("refused: ")).count();
    assert!(well && told > 20 && log.lines().count() == told, "{told} {log}");
    std::fs::remove_file(take.join("run.log")).unwrap();
    assert!((bytes_below(&take), bytes_below(&capture)) == before, "nothing was changed");
}

/// A folder of the take that is a link to another place is not written through.
#[cfg(unix)]
#[test]
fn links_out_of_the_take_are_not_followed() {
    let root = tempfile::tempdir().unwrap();
    let (_, take) = crate::common::take(root.path());
    let outside = root.path().join("outside");
    std::fs::create_dir_all(&outside).unwrap();
    std::os::unix::fs::symlink(&outside, take.join("user")).unwrap();
    let desk = Desk::of(&take);
    let labels = desk.0.body("/api/labels");
    let answer = desk.put("/api/labels", &desk.version("/api/labels"), &labels);
    let said = String::from_utf8_lossy(&answer.body).into_owned();
    assert!(answer.status == 500 && said.contains("leads out of the take"), "{said}");
    assert_eq!(std::fs::read_dir(&outside).unwrap().count(), 0);
}

/// What is handed in lands in the take, and `run` repeats what rests on it and nothing else.
#[test]
fn a_run_uses_what_was_handed_in_and_repeats_no_more() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = made(root.path());
    let kept = bytes_below(&capture);
    assert_eq!(done_by_run(&take, "pose").len(), 5 * 4 + 1 + 4 + 1);
    let desk = Desk::of(&take);
    let work = desk.json("/api/work");
    assert_eq!((&work["frames"], &work["hair"]["cam02"]), (&json!([0, 4]), &json!([0])));
    let view = &work["views"][1];
    assert!(view["width"] == 128 && view["distortion"] == "none", "{view}");

    // The tracker's points carry the markers' numbers, and labels go to the take's own file; nothing else becomes stale.
    let mut labels = desk.json("/api/labels");
    let tracks = desk.json("/api/tracks/2");
    let marker =
        labels["markers"].as_array().unwrap().iter().find(|m| tracks["views"]["cam01"][m["id"].to_string()].is_array());
    let id = marker.unwrap()["id"].clone();
    let tracked = tracks["views"]["cam01"][id.to_string()].clone();
    assert!(tracks["used"].as_u64().unwrap() >= 5 && tracks["rms_px"].as_f64().unwrap() < 2.0, "{tracks}");
    let version = desk.version("/api/labels");
    assert_eq!(desk.put("/api/labels", &version, labels.to_string().as_bytes()).status, 204);
    assert_eq!(done_by_run(&take, "masks"), keys(&[]), "copies are what they were copied from");
    let moved = [tracked[0].as_f64().unwrap() + 0.4, tracked[1].as_f64().unwrap() - 0.3];
    labels["corrections"] = json!([{"frame": 2, "markers": [{"id": id, "views": {"cam01": moved}}]}]);
    let version = desk.version("/api/labels");
    let answer = desk.put("/api/labels", &version, labels.to_string().as_bytes());
    assert_eq!(answer.status, 204);
    assert_eq!(answer.headers["etag"].trim_matches('"'), desk.version("/api/labels"));
    assert_eq!(desk.put("/api/labels", &version, labels.to_string().as_bytes()).status, 409, "of an older version");
    assert_eq!(done_by_run(&take, "pose"), keys(&["pose/pose/take"]));
    let opened = Take::open(&take).unwrap();
    let ids: Vec<u32> = opened.store().read_all("pose/ids").unwrap();
    let index = ids.iter().position(|i| *i == id).unwrap();
    let found = opened.read_poses().unwrap().tracks[2][1][index].unwrap();
    let off = (found.x - moved[0]).hypot(found.y - moved[1]);
    // The marker's centre is measured where the label says to look.
    assert!(off < 0.6 * 2.0 + 1e-9, "{off}");

    // A hair mask at the last frame holds for the frames nearer to it than to the first.
    let path = "/api/mask/hair/cam01/3";
    let body = desk.0.body(path);
    assert_eq!((desk.version(path).as_str(), body[12]), (ABSENT, 2), "made by the run");
    let mut mask = Mask { width: 128, height: 96, data: body[16..].to_vec() };
    (40..50).for_each(|x| mask[(x, 30)] = 255);
    assert_eq!(desk.put(path, ABSENT, &mask_png(&mask).unwrap()).status, 204);
    let file = take.join("user/hair_masks/cam01/000003.png");
    assert_eq!(read_mask(&file).unwrap(), mask);
    assert_eq!(done_by_run(&take, "masks"), keys(&["masks/masks/view01/000002", "masks/masks/view01/000003"]));
    assert_eq!(Take::open(&take).unwrap().read_hair(1, 3).unwrap(), mask);
    assert_eq!(desk.0.body(path)[12], 1, "given");
    let version = desk.version(path);
    assert_eq!(desk.delete(path, ABSENT).status, 409);
    assert_eq!(desk.delete(path, &version).status, 204);
    assert!(!file.exists() && done_by_run(&take, "masks").len() == 2);

    // A subject mask replaces that of its frame alone; hair is carried on from there.
    let subject = Mask::filled(128, 96, 255);
    assert_eq!(desk.put("/api/mask/subject/cam00/3", ABSENT, &mask_png(&subject).unwrap()).status, 204);
    assert_eq!(done_by_run(&take, "masks"), keys(&["masks/masks/view00/000003"]));
    assert_eq!(Take::open(&take).unwrap().read_subject(0, 3).unwrap(), subject);

    // Sketches; those of one view wait.
    let points = json!([[10.5, 20.5], [11.0, 30.0]]);
    let sketch = json!({"strands": [{"id": 0, "views": {"cam00": points, "cam03": points}}, {"id": 1, "views": {"cam00": points}}]});
    assert_eq!(desk.put("/api/sketches/2", ABSENT, sketch.to_string().as_bytes()).status, 204);
    let written: Value =
        serde_json::from_slice(&std::fs::read(take.join("user/sketches/000002.json")).unwrap()).unwrap();
    assert_eq!(written["strands"].as_array().unwrap().len(), 1);
    assert_eq!((desk.json("/api/sketches/2"), &desk.json("/api/work")["sketches"]), (sketch, &json!([2])));
    assert_eq!(bytes_below(&capture), kept, "the capture is as it was");
    let scored = crate::common::strandflow(&["evaluate", crate::common::text(&take), "--sketches"]);
    crate::common::assert_bad_input(&scored, &["nothing to score"]);
    assert!(done_by_run(&take, "pose").len() <= 6, "hulls of the frame with another subject");
    assert_eq!(done_by_run(&take, "pose"), keys(&[]));

    // The file may hold labels of views that the take leaves out: they stay, and what is added is saved.
    let file = take.join("user/marker_labels.json");
    let mut labels: Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    labels["markers"][0]["views"]["left out"] = json!([1.0, 2.0]);
    std::fs::write(&file, labels.to_string()).unwrap();
    let mut more = desk.json("/api/labels");
    more["markers"][1]["views"]["cam00"] = json!([3.5, 4.5]);
    let saved = desk.put("/api/labels", &desk.version("/api/labels"), more.to_string().as_bytes());
    assert_eq!(saved.status, 204, "{}", String::from_utf8_lossy(&saved.body));
    assert_eq!(desk.json("/api/labels"), more);
    more["markers"][1]["views"]["another"] = json!([3.5, 4.5]);
    assert_eq!(desk.put("/api/labels", &desk.version("/api/labels"), more.to_string().as_bytes()).status, 400);
}

/// What of both pages needs no browser: `web/test/*.test.ts`.
#[test]
fn parts_of_the_pages() {
    let Some(web) = pages() else { return };
    for args in [["build.mjs", "--tests"], ["--test", ".test/"]] {
        let run = Command::new("node").current_dir(&web).args(args).output().unwrap();
        assert!(run.status.success(), "{}{}", String::from_utf8_lossy(&run.stdout), stderr(&run));
    }
}

/// The page in a real Chromium, driven by `web/test/annotate.mjs`: markers are labelled, masks painted, strands sketched; the
/// program and the browser are killed in between. Then `run` uses what was labelled.
#[test]
fn annotate_page() {
    let Some(web) = pages() else { return };
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = made(root.path());
    // The page begins with an empty table; the script knows where the markers are.
    let truth = root.path().join("truth.json");
    std::fs::rename(capture.join("user/marker_labels.json"), &truth).unwrap();
    let shots = Path::new(env!("CARGO_TARGET_TMPDIR")).join("annotate_page");
    let program = env!("CARGO_BIN_EXE_strandflow");
    let mut script = Command::new("node");
    script.current_dir(&web).args(["test/annotate.mjs", program, text(&take), text(&truth), text(&shots)]);
    let run = script.output().unwrap();
    let said = String::from_utf8_lossy(&run.stdout);
    assert!(run.status.success(), "{said}{}", stderr(&run));

    let labels = strandflow_io::read_marker_labels(&take.join("user/marker_labels.json")).unwrap();
    let labelled = labels.markers.iter().filter(|m| m.views.len() >= 2).count();
    assert!(labelled >= 5 && labels.corrections.keys().eq(&[2]), "{labels:?}");
    let painted = read_mask(&take.join("user/hair_masks/cam01/000002.png")).unwrap();
    done_by_run(&take, "pose");
    let opened = Take::open(&take).unwrap();
    assert_eq!(opened.read_hair(1, 2).unwrap(), painted);
    let poses = opened.read_poses().unwrap();
    assert!(
        poses.interpolated.iter().all(|lost| !lost) && poses.rms_px.iter().all(|rms| *rms < 1.0),
        "{:?}",
        poses.rms_px
    );
    println!("{said}{} pictures in {}", std::fs::read_dir(&shots).unwrap().count(), shots.display());
}
