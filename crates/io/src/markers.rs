//! First-frame marker labels: JSON `{"frame": 0, "markers": [{"id": 0, "views": {"cam00": [u, v]}}]}`.

use std::{collections::BTreeMap, path::Path};

use serde::Deserialize;

use crate::{
    IoError,
    error::{At, not_json, read_text},
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
#[derive(Clone, Debug, PartialEq)]
pub struct MarkerLabels {
    /// The frame in which the markers were labelled.
    pub frame: usize,
    /// The markers, by rising number.
    pub markers: Vec<LabelledMarker>,
}

#[derive(Deserialize)]
struct LabelFile {
    #[serde(default)]
    frame: usize,
    #[serde(default)]
    pixel_convention: Option<String>,
    markers: Vec<LabelEntry>,
}

#[derive(Deserialize)]
struct LabelEntry {
    id: u32,
    views: BTreeMap<String, [f64; 2]>,
}

/// Reads marker labels.
///
/// # Errors
/// The file cannot be read, is not the JSON described above, names a marker twice, or holds a non-finite number.
pub fn read_marker_labels(path: &Path) -> Result<MarkerLabels, IoError> {
    labels_from_json(path, &read_text(path)?)
}

fn labels_from_json(path: &Path, text: &str) -> Result<MarkerLabels, IoError> {
    let file: LabelFile = serde_json::from_str(text).map_err(|cause| {
        let hint = r#"write {"frame": 0, "markers": [{"id": 0, "views": {"cam00": [u, v]}}]}"#;
        not_json(path, text, &cause, "marker labels", hint)
    })?;
    let shift = crate::calibration::pixel_shift(path, file.pixel_convention.as_deref())?;
    let mut markers = BTreeMap::new();
    for entry in file.markers {
        if let Some((view, uv)) = entry.views.iter().find(|(_, uv)| !uv.iter().all(|x| x.is_finite())) {
            let fact = format!("marker {} is at the non-finite point {uv:?}", entry.id);
            return Err(IoError::content(path, At::view(view), fact, "label it again"));
        }
        let views = entry.views.into_iter().map(|(view, [u, v])| (view, [u + shift, v + shift])).collect();
        if markers.insert(entry.id, views).is_some() {
            let fact = format!("marker {} is listed twice", entry.id);
            return Err(IoError::content(path, At::FILE, fact, "give every marker a number of its own"));
        }
    }
    let markers = markers.into_iter().map(|(id, views)| LabelledMarker { id, views }).collect();
    Ok(MarkerLabels { frame: file.frame, markers })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const GOOD: &str = r#"{"frame": 2, "pixel_convention": "first pixel centre at (0.5, 0.5)", "markers": [
        {"id": 3, "views": {"a": [1.5, 2.0], "b": [3, 4]}}, {"id": 1, "views": {"a": [5.5, 6]}}]}"#;

    #[test]
    fn labels_are_read_and_sorted() {
        let labels = labels_from_json(Path::new("m.json"), GOOD).unwrap();
        assert_eq!((labels.frame, labels.markers.len()), (2, 2));
        assert_eq!((labels.markers[0].id, labels.markers[1].views["b"]), (1, [3.0, 4.0]));
    }

    #[test]
    fn wrong_labels_name_file_and_line() {
        let twice = GOOD.replace("\"id\": 3", "\"id\": 1");
        assert!(labels_from_json(Path::new("m.json"), &twice).unwrap_err().to_string().contains("twice"));
        let error = labels_from_json(Path::new("m.json"), &GOOD.replace("[5.5, 6]", "[5.5]")).unwrap_err();
        assert!(error.to_string().starts_with("m.json:2"), "{error}");
        assert!(!error.hint().is_empty());
    }

    proptest! {
        #[test]
        fn any_text_is_safe(text in ".{0,80}", cut in 0usize..150) {
            let _ = labels_from_json(Path::new("m"), &text);
            let _ = labels_from_json(Path::new("m"), &GOOD[..cut.min(GOOD.len())]);
        }
    }
}
