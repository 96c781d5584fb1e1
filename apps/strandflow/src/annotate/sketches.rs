//! Sketched strands: `user/sketches/FRAME.json` holds those drawn in two or more views, which have a place in space; those
//! drawn in one view only wait in `user/sketch_drafts/FRAME.json`. The page sees one list.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use serde::{Deserialize, Serialize};
use strandflow_core::Rig;
use strandflow_engine::footage::numbered;
use strandflow_view::{
    Refusal,
    desk::{ABSENT, Document},
};

use super::home::{Files, Home, must_be_current, not_written, read, version};

const COMPLETE: &str = "sketches";
const DRAFTS: &str = "sketch_drafts";
/// Fewest views that give a strand a place in space.
const VIEWS: usize = 2;

/// The file.
#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Sketches {
    strands: Vec<Sketch>,
}

/// A strand in some views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Sketch {
    id: u32,
    /// Image points \[px, first pixel centre at (0.5, 0.5)\] by view, root first.
    views: BTreeMap<String, Vec<[f64; 2]>>,
}

impl Sketch {
    fn is_complete(&self) -> bool {
        self.views.len() >= VIEWS
    }
}

/// Frames with sketches.
pub fn given(home: &Home) -> Result<Vec<usize>, Refusal> {
    let files = home.files();
    let mut frames = Vec::new();
    for folder in [COMPLETE, DRAFTS] {
        frames.extend(files_of(&files, folder)?.into_keys());
    }
    frames.sort_unstable();
    frames.dedup();
    Ok(frames)
}

/// The sketches of a frame.
pub fn get(home: &Home, frame: usize) -> Result<Document, Refusal> {
    let (version, complete, drafts) = both(&home.files(), frame)?;
    let mut strands: BTreeMap<u32, Sketch> = drafts.into_iter().map(|s| (s.id, s)).collect();
    strands.extend(complete.into_iter().map(|s| (s.id, s)));
    let json = json(strands.into_values().collect());
    Ok(Document { version, json })
}

/// New sketches of a frame.
pub fn put(home: &Home, rig: &Rig, frame: usize, made_from: &str, json_sent: &[u8]) -> Result<String, Refusal> {
    let strands = parsed("the sketches", json_sent)?;
    check(&strands, rig)?;
    let files = home.for_writing(|files| {
        must_be_current(&format!("the sketches of frame {frame}"), made_from, &both(files, frame)?.0)
    })?;
    let (_, old, _) = both(&files, frame)?;
    let (complete, drafts): (Vec<Sketch>, Vec<Sketch>) = strands.into_iter().partition(Sketch::is_complete);
    // Killed between the two files, no strand is lost: it stands in both, and the complete one counts.
    let becomes_draft = drafts.iter().any(|draft| old.iter().any(|sketch| sketch.id == draft.id));
    let mut writes = [(COMPLETE, complete), (DRAFTS, drafts)];
    if becomes_draft {
        writes.reverse();
    }
    for (folder, strands) in writes {
        let path = path(&files, folder, frame)?;
        if strands.is_empty() {
            files.remove(&path)?;
        } else {
            files.write(&path, &json(strands))?;
        }
    }
    Ok(both(&files, frame)?.0)
}

/// The files of a folder by frame.
fn files_of(files: &Files, folder: &str) -> Result<BTreeMap<usize, PathBuf>, Refusal> {
    let is_json = |path: &Path| path.extension().is_some_and(|e| e == "json");
    numbered(&files.sketches(folder), is_json).map_err(|error| not_written(&error))
}

/// The file of a frame, with as many zeros as it has.
fn path(files: &Files, folder: &str, frame: usize) -> Result<PathBuf, Refusal> {
    let there = files_of(files, folder)?.remove(&frame);
    Ok(there.unwrap_or_else(|| files.sketches(folder).join(format!("{frame:06}.json"))))
}

/// The version of both files, and what they hold.
fn both(files: &Files, frame: usize) -> Result<(String, Vec<Sketch>, Vec<Sketch>), Refusal> {
    let mut all = Vec::new();
    let [complete, drafts] = [COMPLETE, DRAFTS].map(|folder| -> Result<Vec<Sketch>, Refusal> {
        let path = path(files, folder, frame)?;
        let (version, bytes) = read(&path)?;
        all.extend(version.into_bytes());
        let parsed = |bytes: Vec<u8>| parsed(&path.display().to_string(), &bytes);
        bytes.map_or(Ok(Vec::new()), |bytes| parsed(bytes).map_err(|r| Refusal::broken(r.error, r.hint)))
    });
    let (complete, drafts) = (complete?, drafts?);
    let version = if complete.is_empty() && drafts.is_empty() { ABSENT.into() } else { version(&all) };
    Ok((version, complete, drafts))
}

fn json(strands: Vec<Sketch>) -> Vec<u8> {
    // Whole and finite numbers: nothing that JSON could not hold.
    serde_json::to_vec(&Sketches { strands }).unwrap_or_default()
}

fn parsed(what: &str, json: &[u8]) -> Result<Vec<Sketch>, Refusal> {
    let hint = r#"{"strands": [{"id": 0, "views": {"cam00": [[u, v], ...], ...}}]} is what is read"#;
    let read: Result<Sketches, _> = serde_json::from_slice(json);
    Ok(read.map_err(|error| Refusal::bad(format!("{what} cannot be read: {error}"), hint))?.strands)
}

fn check(strands: &[Sketch], rig: &Rig) -> Result<(), Refusal> {
    let mut ids = std::collections::BTreeSet::new();
    for strand in strands {
        let bad = |fact: String| Err(Refusal::bad(format!("strand {}: {fact}", strand.id), "draw it within the views"));
        if !ids.insert(strand.id) {
            return bad("is there twice".into());
        }
        if strand.views.is_empty() {
            return bad("is drawn in no view".into());
        }
        for (view, points) in &strand.views {
            let Some(index) = rig.view_named(view) else { return bad(format!("there is no view `{view}`")) };
            let (w, h) = (rig.cameras[index].width as f64, rig.cameras[index].height as f64);
            if points.len() < 2 {
                return bad(format!("has fewer than two points in view {view}"));
            }
            let out = |&&[u, v]: &&[f64; 2]| !((0.0..=w).contains(&u) && (0.0..=h).contains(&v));
            if let Some([u, v]) = points.iter().find(out) {
                return bad(format!("{u}, {v} is outside view {view}"));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use strandflow_engine::{Manifest, manifest::MANIFEST};

    use super::*;

    const RIG: &str = r#"{"cameras": [
        {"name": "a", "width": 8, "height": 8, "focal": [1, 1], "principal": [4, 4],
         "camera_from_world": {"rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "translation": [0, 0, 0]}},
        {"name": "b", "width": 8, "height": 8, "focal": [1, 1], "principal": [4, 4],
         "camera_from_world": {"rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "translation": [0, 0, 0]}}]}"#;

    #[test]
    fn a_strand_of_one_view_waits_and_one_of_two_counts() {
        let dir = tempfile::tempdir().unwrap();
        let text = "fps = 30.0\ngravity = [0, 0, -9810]\nviews = []\n[calibration]\nfile = \"c.json\"\n[labels]\n\
                    markers = \"user/marker_labels.json\"\nhair_masks = \"user/hair_masks\"\nsubject_masks = \"user/s\"\n";
        std::fs::write(dir.path().join(MANIFEST), text).unwrap();
        let home = Home::open(dir.path(), &Manifest::parse(text, "m").unwrap()).unwrap();
        let rig: Rig = serde_json::from_str(RIG).unwrap();
        let (complete, draft) =
            (dir.path().join("user/sketches/000003.json"), dir.path().join("user/sketch_drafts/000003.json"));
        let one = br#"{"strands":[{"id":4,"views":{"a":[[1,1],[2,3]]}}]}"#;
        let made = put(&home, &rig, 3, ABSENT, one).unwrap();
        assert!(draft.is_file() && !complete.exists() && given(&home).unwrap() == [3]);
        assert_eq!(get(&home, 3).unwrap().version, made);
        let two = br#"{"strands":[{"id":4,"views":{"a":[[1.0,1.0],[2.0,3.0]],"b":[[5.0,1.0],[5.5,3.0]]}}]}"#;
        let changed = put(&home, &rig, 3, ABSENT, two).unwrap_err();
        assert_eq!(changed.status(), 409);
        let made = put(&home, &rig, 3, &made, two).unwrap();
        assert!(!draft.exists() && std::fs::read(&complete).unwrap() == two);
        assert_eq!(get(&home, 3).unwrap().json, two);
        let made = put(&home, &rig, 3, &made, one).unwrap();
        assert!(draft.exists() && !complete.exists());
        put(&home, &rig, 3, &made, br#"{"strands":[]}"#).unwrap();
        // A file that a person named with fewer zeros is the frame's, too.
        let named = dir.path().join("user/sketches/5.json");
        std::fs::write(&named, two).unwrap();
        let there = get(&home, 5).unwrap();
        assert_eq!(there.json, two);
        put(&home, &rig, 5, &there.version, br#"{"strands":[]}"#).unwrap();
        assert!(!named.exists());
        assert!(!draft.exists() && given(&home).unwrap().is_empty());
    }

    #[test]
    fn what_is_no_sketch_is_told() {
        let rig: Rig = serde_json::from_str(RIG).unwrap();
        let said = |json: &str| parsed("x", json.as_bytes()).and_then(|s| check(&s, &rig)).unwrap_err().error;
        assert!(said("{").contains("cannot be read"));
        assert!(said(r#"{"strands":[{"id":1,"views":{}}]}"#).contains("no view"));
        assert!(said(r#"{"strands":[{"id":1,"views":{"../a":[[1,1],[2,2]]}}]}"#).contains("`../a`"));
        assert!(said(r#"{"strands":[{"id":1,"views":{"a":[[1,1]]}}]}"#).contains("two points"));
        assert!(said(r#"{"strands":[{"id":1,"views":{"a":[[1,1],[9,1]]}}]}"#).contains("outside view a"));
        let twice = r#"{"id":1,"views":{"a":[[1,1],[2,2]]}}"#;
        assert!(said(&format!(r#"{{"strands":[{twice},{twice}]}}"#)).contains("twice"));
    }
}
