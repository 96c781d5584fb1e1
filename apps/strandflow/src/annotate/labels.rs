//! Labels of markers, as the take's label file holds them.

use std::{collections::BTreeSet, path::Path};

use strandflow_core::{FrameRange, Rig};
use strandflow_io::{IoError, LabelledMarker, MarkerLabels, marker_labels_from_json};
use strandflow_view::{Refusal, desk::Document};

use super::home::{Home, must_be_current, read, version};

/// The labels as they are; those of a new take are none, of its first frame.
pub fn get(home: &Home, first: usize) -> Result<Document, Refusal> {
    let files = home.files();
    let (version, bytes) = read(&files.labels)?;
    let labels = match bytes {
        Some(bytes) => parsed(&files.labels, &bytes).map_err(|r| Refusal::broken(r.error, r.hint))?,
        None => MarkerLabels { frame: first, ..MarkerLabels::default() },
    };
    Ok(Document { version, json: labels.to_json().into_bytes() })
}

/// New labels.
pub fn put(home: &Home, rig: &Rig, frames: FrameRange, made_from: &str, json: &[u8]) -> Result<String, Refusal> {
    let labels = parsed(Path::new("labels"), json)?;
    let files = home.for_writing(|files| {
        let (version, bytes) = read(&files.labels)?;
        let old = bytes.and_then(|bytes| parsed(&files.labels, &bytes).ok());
        check(&labels, old.as_ref(), rig, frames)?;
        must_be_current("the file of labels", made_from, &version)
    })?;
    let text = labels.to_json();
    files.write(&files.labels, text.as_bytes())?;
    Ok(version(text.as_bytes()))
}

fn parsed(path: &Path, json: &[u8]) -> Result<MarkerLabels, Refusal> {
    let text = std::str::from_utf8(json).map_err(|_| Refusal::bad("the labels are no text", "send JSON in UTF-8"))?;
    marker_labels_from_json(path, text).map_err(|error: IoError| Refusal::bad(error.to_string(), error.hint()))
}

/// A label: frame, marker, view, and the bits of its image point.
type Point = (usize, u32, String, [u64; 2]);

/// The labelled frames.
fn by_frame(labels: &MarkerLabels) -> impl Iterator<Item = (usize, &Vec<LabelledMarker>)> {
    std::iter::once((labels.frame, &labels.markers)).chain(labels.corrections.iter().map(|(&t, m)| (t, m)))
}

fn points_of(labels: &MarkerLabels) -> BTreeSet<Point> {
    let of_marker = |frame: usize, marker: &LabelledMarker| -> Vec<Point> {
        marker.views.iter().map(|(view, at)| (frame, marker.id, view.clone(), at.map(f64::to_bits))).collect()
    };
    by_frame(labels).flat_map(|(frame, markers)| markers.iter().flat_map(move |m| of_marker(frame, m))).collect()
}

/// What is new must be of the take. The file may hold labels of frames and views that the take leaves out: they do no harm.
fn check(labels: &MarkerLabels, old: Option<&MarkerLabels>, rig: &Rig, frames: FrameRange) -> Result<(), Refusal> {
    let is_old = |frame: usize| old.is_some_and(|old| by_frame(old).any(|(known, _)| known == frame));
    if let Some((frame, _)) = by_frame(labels).find(|&(frame, _)| !frames.contains(frame) && !is_old(frame)) {
        let fact = format!("labels of frame {frame}, the take has the frames {frames}");
        return Err(Refusal::bad(fact, "label frames of the take"));
    }
    let old_points = old.map(points_of).unwrap_or_default();
    points_of(labels).difference(&old_points).try_for_each(|(frame, id, view, at)| {
        in_view(&format!("marker {id}, view {view}, frame {frame}"), view, at.map(f64::from_bits), rig)
    })
}

fn in_view(place: &str, view: &str, [u, v]: [f64; 2], rig: &Rig) -> Result<(), Refusal> {
    let Some(index) = rig.view_named(view) else {
        return Err(Refusal::bad(format!("{place}: there is no such view"), "label views of the take"));
    };
    let (w, h) = (rig.cameras[index].width, rig.cameras[index].height);
    let inside = (0.0..=w as f64).contains(&u) && (0.0..=h as f64).contains(&v);
    let fact = || format!("{place}: {u}, {v} is outside the image of {w}×{h} pixels");
    inside.then_some(()).ok_or_else(|| Refusal::bad(fact(), "label it within the image"))
}
