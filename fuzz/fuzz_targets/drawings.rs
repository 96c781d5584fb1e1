//! What people label and draw: markers and sketches, JSON.
#![no_main]

use std::{fs, path::PathBuf, sync::OnceLock};

use libfuzzer_sys::fuzz_target;
use strandflow_fuzz::{folder, seeds, told};
use strandflow_io::{read_marker_labels, sketches::read_sketches};

static FOLDER: OnceLock<PathBuf> = OnceLock::new();

const SEEDS: [&str; 3] = [
    r#"{"strands": [{"id": 4, "views": {"a": [[1, 2], [3, 4.5]], "b": [[1, 2]]}}, {"id": 1, "views": {}}]}"#,
    r#"{"pixel_convention": "first pixel centre at (0.5, 0.5)", "markers": [{"id": 0, "views": {"a": [1.5, 2.0], "b": [3, 4]}}]}"#,
    r#"{"frame": 0, "markers": [{"id": 3, "views": {"a": [1.5, 2.0]}}], "corrections": [{"frame": 4, "markers": [{"id": 3, "views": {"a": [1, 2]}}]}]}"#,
];

fuzz_target!(
    init: {
        seeds(|| SEEDS.iter().map(|text| text.as_bytes().to_vec()).collect());
    },
    |data: &[u8]| {
        let path = FOLDER.get_or_init(folder).join("drawn.json");
        fs::write(&path, data).expect("the file");
        if let Some(strands) = told(&path, read_sketches(&path)) {
            let points = strands.iter().flat_map(|strand| strand.views.values()).flatten().flatten();
            assert!(points.into_iter().all(|x| x.is_finite()), "points are numbers");
        }
        told(&path, read_marker_labels(&path));
    }
);
