//! Marker labels: JSON `{"frame": 0, "markers": [{"id": 0, "views": {"cam00": [u, v]}}], "corrections": [{"frame": 12,
//! "markers": [...]}]}`. The markers are labelled in `frame`; corrections say where they are in other frames, and may begin
//! further ones.

use std::{collections::BTreeMap, path::Path};

use serde::{Deserialize, Serialize};

use crate::{
    IoError,
    error::{At, not_json, read_text},
    write_bytes,
};

/// One marker, labelled in some views.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelledMarker {
    /// The marker's number.
    pub id: u32,
    /// Image point \[px, first pixel centre at (0.5, 0.5)\] by view name.
    pub views: BTreeMap<String, [f64; 2]>,
}

/// All labels of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MarkerLabels {
    /// The frame in which the markers were labelled.
    pub frame: usize,
    /// The markers, by rising number.
    pub markers: Vec<LabelledMarker>,
    /// Where some of these markers, or others, are in other frames, by frame; by rising number.
    pub corrections: BTreeMap<usize, Vec<LabelledMarker>>,
}

const CONVENTION: &str = "first pixel centre at (0.5, 0.5)";

#[derive(Deserialize, Serialize)]
struct LabelFile {
    #[serde(default)]
    frame: usize,
    #[serde(default)]
    pixel_convention: Option<String>,
    markers: Vec<LabelEntry>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    corrections: Vec<CorrectionEntry>,
}

#[derive(Deserialize, Serialize)]
struct CorrectionEntry {
    frame: usize,
    markers: Vec<LabelEntry>,
}

#[derive(Deserialize, Serialize)]
struct LabelEntry {
    id: u32,
    views: BTreeMap<String, [f64; 2]>,
}

/// Reads marker labels.
///
/// # Errors
/// The file cannot be read, is not the JSON described above, names a marker twice in a frame, corrects a frame twice or the one
/// that is labelled, or holds a non-finite number.
pub fn read_marker_labels(path: &Path) -> Result<MarkerLabels, IoError> {
    marker_labels_from_json(path, &read_text(path)?)
}

/// The same from text; `path` is for messages.
///
/// # Errors
/// As [`read_marker_labels`].
pub fn marker_labels_from_json(path: &Path, text: &str) -> Result<MarkerLabels, IoError> {
    let file: LabelFile = serde_json::from_str(text).map_err(|cause| {
        let hint = r#"write {"frame": 0, "markers": [{"id": 0, "views": {"cam00": [u, v]}}]}"#;
        not_json(path, text, &cause, "marker labels", hint)
    })?;
    let shift = crate::calibration::pixel_shift(path, file.pixel_convention.as_deref())?;
    let markers = of_one_frame(path, file.frame, file.markers, shift)?;
    let mut corrections = BTreeMap::new();
    for CorrectionEntry { frame, markers: corrected } in file.corrections {
        let corrected = of_one_frame(path, frame, corrected, shift)?;
        let wrong =
            |fact: String, hint: &str| Err(IoError::content(path, At { frame: Some(frame), ..At::FILE }, fact, hint));
        if frame == file.frame {
            return wrong("the frame of the labels is also corrected".into(), "correct the labels themselves");
        }
        if corrections.insert(frame, corrected).is_some() {
            return wrong("the frame is corrected twice".into(), "give every frame one list of markers");
        }
    }
    Ok(MarkerLabels { frame: file.frame, markers, corrections })
}

fn of_one_frame(
    path: &Path,
    frame: usize,
    entries: Vec<LabelEntry>,
    shift: f64,
) -> Result<Vec<LabelledMarker>, IoError> {
    let mut markers = BTreeMap::new();
    for entry in entries {
        if let Some((view, uv)) = entry.views.iter().find(|(_, uv)| !uv.iter().all(|x| x.is_finite())) {
            let fact = format!("marker {} is at the non-finite point {uv:?}", entry.id);
            return Err(IoError::content(path, At::view_frame(view, frame), fact, "label it again"));
        }
        let views = entry.views.into_iter().map(|(view, [u, v])| (view, [u + shift, v + shift])).collect();
        if markers.insert(entry.id, views).is_some() {
            let fact = format!("marker {} is listed twice", entry.id);
            let at = At { frame: Some(frame), ..At::FILE };
            return Err(IoError::content(path, at, fact, "give every marker a number of its own"));
        }
    }
    Ok(markers.into_iter().map(|(id, views)| LabelledMarker { id, views }).collect())
}

impl MarkerLabels {
    /// The labels by frame, those of [`Self::frame`] among them; frames without any are left out.
    pub fn by_frame(&self) -> BTreeMap<usize, &[LabelledMarker]> {
        let all = self.corrections.iter().map(|(&frame, markers)| (frame, markers.as_slice()));
        all.chain([(self.frame, self.markers.as_slice())]).filter(|(_, markers)| !markers.is_empty()).collect()
    }

    /// The first of some frames in which at least `needed` markers are labelled in two views or more, of those views that count;
    /// where there is none, the frame with the most of such markers, and how many these are (`frame` of the file and 0 where
    /// nothing is labelled).
    ///
    /// # Errors
    /// The second of these, as `(frame, markers)`.
    pub fn first_with(
        &self,
        needed: usize,
        is_wanted: impl Fn(usize) -> bool,
        counts: impl Fn(&str) -> bool,
    ) -> Result<usize, (usize, usize)> {
        let mut most = (self.frame, 0);
        for (frame, markers) in self.by_frame().into_iter().filter(|(frame, _)| is_wanted(*frame)) {
            let is_usable = |marker: &&LabelledMarker| marker.views.keys().filter(|view| counts(view)).count() >= 2;
            let usable = markers.iter().filter(is_usable).count();
            if usable >= needed {
                return Ok(frame);
            }
            if usable > most.1 {
                most = (frame, usable);
            }
        }
        Err(most)
    }

    /// The JSON of a file of these labels.
    pub fn to_json(&self) -> String {
        let entries = |markers: &[LabelledMarker]| {
            markers.iter().map(|m| LabelEntry { id: m.id, views: m.views.clone() }).collect::<Vec<_>>()
        };
        let file = LabelFile {
            frame: self.frame,
            pixel_convention: Some(CONVENTION.into()),
            markers: entries(&self.markers),
            corrections: self
                .corrections
                .iter()
                .map(|(&frame, markers)| CorrectionEntry { frame, markers: entries(markers) })
                .collect(),
        };
        // Strings, whole and finite numbers: nothing that JSON could not hold.
        serde_json::to_string_pretty(&file).unwrap_or_default() + "\n"
    }
}

/// Writes marker labels, as a whole or not at all.
///
/// # Errors
/// The file cannot be written.
pub fn write_marker_labels(path: &Path, labels: &MarkerLabels) -> Result<(), IoError> {
    write_bytes(path, labels.to_json().as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const GOOD: &str = r#"{"frame": 2, "pixel_convention": "first pixel centre at (0.5, 0.5)", "markers": [
        {"id": 3, "views": {"a": [1.5, 2.0], "b": [3, 4]}}, {"id": 1, "views": {"a": [5.5, 6]}}],
        "corrections": [{"frame": 9, "markers": [{"id": 3, "views": {"b": [7, 8]}}]}]}"#;

    #[test]
    fn labels_are_read_and_sorted() {
        let labels = marker_labels_from_json(Path::new("m.json"), GOOD).unwrap();
        assert_eq!((labels.frame, labels.markers.len()), (2, 2));
        assert_eq!((labels.markers[0].id, labels.markers[1].views["b"]), (1, [3.0, 4.0]));
        assert_eq!((labels.corrections[&9][0].id, labels.corrections[&9][0].views["b"]), (3, [7.0, 8.0]));
        let begun = GOOD.replace("[{\"id\": 3, \"views\": {\"b\": [7", "[{\"id\": 4, \"views\": {\"b\": [7");
        let begun = marker_labels_from_json(Path::new("m.json"), &begun).unwrap();
        assert_eq!((begun.markers.len(), begun.corrections[&9][0].id), (2, 4), "markers may begin in any frame");
        let of_one_frame = r#"{"markers": [{"id": 0, "views": {"a": [1, 2]}}]}"#;
        let labels = marker_labels_from_json(Path::new("m.json"), of_one_frame).unwrap();
        assert!(labels.frame == 0 && labels.markers.len() == 1 && labels.corrections.is_empty());
    }

    #[test]
    fn what_is_written_is_read_again() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("m.json");
        let labels = marker_labels_from_json(&path, GOOD).unwrap();
        write_marker_labels(&path, &labels).unwrap();
        assert_eq!(read_marker_labels(&path).unwrap(), labels);
    }

    #[test]
    fn wrong_labels_name_file_and_line() {
        let twice = GOOD.replace("\"id\": 3", "\"id\": 1");
        assert!(marker_labels_from_json(Path::new("m.json"), &twice).unwrap_err().to_string().contains("twice"));
        let error = marker_labels_from_json(Path::new("m.json"), &GOOD.replace("[5.5, 6]", "[5.5]")).unwrap_err();
        assert!(error.to_string().starts_with("m.json:2"), "{error}");
        assert!(!error.hint().is_empty());
    }

    #[test]
    fn wrong_corrections_name_the_frame() {
        let said = |from: &str, to: &str| {
            marker_labels_from_json(Path::new("m.json"), &GOOD.replace(from, to)).unwrap_err().to_string()
        };
        assert!(said("\"frame\": 9", "\"frame\": 2").contains("frame 2: the frame of the labels"));
        assert!(
            said("}]}]}", "}]}, {\"frame\": 9, \"markers\": []}]}").contains("frame 9: the frame is corrected twice")
        );
    }

    #[test]
    fn tracks_begin_in_the_first_frame_with_enough_labels() {
        let marker = |id: u32, views: &[&str]| LabelledMarker {
            id,
            views: views.iter().map(|view| ((*view).to_owned(), [1.0, 2.0])).collect(),
        };
        let few = vec![marker(0, &["a", "b"]), marker(1, &["a"])];
        let labels = MarkerLabels {
            frame: 7,
            markers: vec![marker(0, &["a", "b"]), marker(1, &["a", "b", "c"])],
            corrections: BTreeMap::from([(3, few.clone()), (9, few)]),
        };
        assert_eq!(labels.by_frame().into_keys().collect::<Vec<_>>(), [3, 7, 9]);
        assert_eq!(labels.first_with(2, |_| true, |_| true), Ok(7));
        assert_eq!(labels.first_with(1, |_| true, |_| true), Ok(3));
        assert_eq!(labels.first_with(2, |_| true, |view| view != "b"), Err((7, 1)));
        assert_eq!(labels.first_with(2, |frame| frame > 7, |_| true), Err((9, 1)));
        assert_eq!(MarkerLabels { frame: 4, ..MarkerLabels::default() }.first_with(5, |_| true, |_| true), Err((4, 0)));
    }

    proptest! {
        #[test]
        fn any_text_is_safe(text in ".{0,80}", cut in 0usize..260) {
            let _ = marker_labels_from_json(Path::new("m"), &text);
            let _ = marker_labels_from_json(Path::new("m"), &GOOD[..cut.min(GOOD.len())]);
        }
    }
}
