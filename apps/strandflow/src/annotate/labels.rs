//! Labels of markers, as the take's label file holds them.

use std::path::Path;

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
    check(&labels, rig, frames)?;
    let files = home.for_writing(|files| must_be_current("the file of labels", made_from, &read(&files.labels)?.0))?;
    let text = labels.to_json();
    files.write(&files.labels, text.as_bytes())?;
    Ok(version(text.as_bytes()))
}

fn parsed(path: &Path, json: &[u8]) -> Result<MarkerLabels, Refusal> {
    let text = std::str::from_utf8(json).map_err(|_| Refusal::bad("the labels are no text", "send JSON in UTF-8"))?;
    marker_labels_from_json(path, text).map_err(|error: IoError| Refusal::bad(error.to_string(), error.hint()))
}

fn check(labels: &MarkerLabels, rig: &Rig, frames: FrameRange) -> Result<(), Refusal> {
    let all = std::iter::once((labels.frame, &labels.markers)).chain(labels.corrections.iter().map(|(&t, m)| (t, m)));
    all.into_iter().try_for_each(|(frame, markers)| {
        if frame < frames.start || frame >= frames.end {
            let fact = format!("labels of frame {frame}, the take has the frames {frames}");
            return Err(Refusal::bad(fact, "label frames of the take"));
        }
        markers.iter().try_for_each(|marker| in_view(marker, frame, rig))
    })
}

fn in_view(marker: &LabelledMarker, frame: usize, rig: &Rig) -> Result<(), Refusal> {
    marker.views.iter().try_for_each(|(view, &[u, v])| {
        let place = || format!("marker {}, view {view}, frame {frame}", marker.id);
        let Some(index) = rig.view_named(view) else {
            return Err(Refusal::bad(format!("{}: there is no such view", place()), "label views of the take"));
        };
        let (w, h) = (rig.cameras[index].width, rig.cameras[index].height);
        let inside = (0.0..=w as f64).contains(&u) && (0.0..=h as f64).contains(&v);
        let fact = || format!("{}: {u}, {v} is outside the image of {w}×{h} pixels", place());
        inside.then_some(()).ok_or_else(|| Refusal::bad(fact(), "label it within the image"))
    })
}
