//! Strands that a person drew over the views of one frame: JSON `{"strands": [{"id": 0, "views": {"cam00": [[u, v], …]}}]}`,
//! root first, pixels with the first pixel's centre at (0.5, 0.5) where `pixel_convention` says nothing else.

use std::{collections::BTreeMap, path::Path};

use serde::Deserialize;

use crate::{
    IoError,
    calibration::pixel_shift,
    error::{At, not_json, read_text},
};

/// One strand, drawn in some views.
#[derive(Clone, Debug, PartialEq)]
pub struct SketchedStrand {
    /// The number of the strand, the same in every frame.
    pub id: u32,
    /// Image points \[px\] by view name, root first; two or more a view.
    pub views: BTreeMap<String, Vec<[f64; 2]>>,
}

#[derive(Deserialize)]
struct SketchFile {
    /// As in the labels of markers.
    #[serde(default)]
    pixel_convention: Option<String>,
    strands: Vec<SketchEntry>,
}

#[derive(Deserialize)]
struct SketchEntry {
    id: u32,
    views: BTreeMap<String, Vec<[f64; 2]>>,
}

/// Reads the sketches of a frame, by rising number. Views in which a strand has fewer than two points are left out.
///
/// # Errors
/// The file cannot be read, is not the JSON described above, names a strand twice, or holds a non-finite number.
pub fn read_sketches(path: &Path) -> Result<Vec<SketchedStrand>, IoError> {
    sketches_from_json(path, &read_text(path)?)
}

fn sketches_from_json(path: &Path, text: &str) -> Result<Vec<SketchedStrand>, IoError> {
    let file: SketchFile = serde_json::from_str(text).map_err(|cause| {
        let hint = r#"write {"strands": [{"id": 0, "views": {"cam00": [[u, v], [u, v]]}}]}, root first"#;
        not_json(path, text, &cause, "sketched strands", hint)
    })?;
    let shift = pixel_shift(path, file.pixel_convention.as_deref())?;
    let mut strands = BTreeMap::new();
    for SketchEntry { id, mut views } in file.strands {
        let bad = views.iter().find(|(_, points)| points.iter().flatten().any(|x| !x.is_finite()));
        if let Some((view, _)) = bad {
            let fact = format!("strand {id} has a non-finite point");
            return Err(IoError::content(path, At::view(view), fact, "draw it again"));
        }
        views.retain(|_, points| points.len() >= 2);
        views.values_mut().flatten().for_each(|point| *point = point.map(|x| x + shift));
        if strands.insert(id, views).is_some() {
            let fact = format!("strand {id} is listed twice");
            return Err(IoError::content(path, At::FILE, fact, "give every strand a number of its own"));
        }
    }
    Ok(strands.into_iter().map(|(id, views)| SketchedStrand { id, views }).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = r#"{"strands": [{"id": 4, "views": {"a": [[1, 2], [3, 4.5]], "b": [[1, 2]]}},
        {"id": 1, "views": {}}]}"#;

    #[test]
    fn strands_are_sorted_and_dots_left_out() {
        let strands = sketches_from_json(Path::new("s.json"), GOOD).unwrap();
        assert_eq!((strands[0].id, strands[1].id, strands[1].views.len()), (1, 4, 1));
        assert_eq!(strands[1].views["a"], [[1.0, 2.0], [3.0, 4.5]]);
    }

    #[test]
    fn wrong_sketches_name_the_place() {
        let twice = GOOD.replace("\"id\": 1", "\"id\": 4");
        assert!(sketches_from_json(Path::new("s.json"), &twice).unwrap_err().to_string().contains("twice"));
        let error = sketches_from_json(Path::new("s.json"), &GOOD.replace("[3, 4.5]", "[3]")).unwrap_err();
        assert!(error.to_string().starts_with("s.json:1"), "{error}");
        for cut in 0..GOOD.len() {
            assert!(sketches_from_json(Path::new("s.json"), &GOOD[..cut]).is_err());
        }
    }
}
