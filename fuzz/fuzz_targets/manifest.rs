//! The take's manifest: TOML, the settings of all stages and their ranges.
#![no_main]

use std::{fs, path::PathBuf, sync::OnceLock};

use libfuzzer_sys::fuzz_target;
use strandflow_engine::{Manifest, Settings, manifest::MANIFEST};
use strandflow_fuzz::{folder, seeds};

static FOLDER: OnceLock<PathBuf> = OnceLock::new();

const HEAD: &str = r#"
fps = 100.0
gravity = [0.0, 0.0, -9810.0]
frames = "0..30"
mode = "paper"
seed = 7
held_out = ["b"]
calibration = { file = "calibration.toml", unit_mm = 10.0 }
labels = { markers = "markers.json", hair_masks = "masks", subject_masks = "subjects" }
views = [{ name = "a", source = "a.mp4", plate = "a.png" }, { name = "b", source = "b", plate = "b.png" }]
"#;

/// A manifest with every setting, one without any, and one whose numbers are at fault.
fn written() -> Vec<Vec<u8>> {
    let settings = toml::Value::try_from(Settings::default()).expect("settings are TOML");
    let settings =
        toml::to_string(&toml::Table::from_iter([("settings".into(), settings)])).expect("settings are TOML");
    let odd = "[settings.hull]\nvoxel_mm = -1\n[settings.fit]\n[settings.pose]\nmarker_radius_px = nan\n";
    vec![(HEAD.to_owned() + &settings).into_bytes(), HEAD.into(), (HEAD.to_owned() + odd).into_bytes()]
}

fuzz_target!(
    init: {
        seeds(written);
    },
    |data: &[u8]| {
        let take = FOLDER.get_or_init(folder);
        fs::write(take.join(MANIFEST), data).expect("the file");
        match Manifest::read(take) {
            Ok(manifest) => {
                let numbers = manifest.gravity.iter().chain(&manifest.calibration.unit_mm).all(|x| x.is_finite());
                assert!(manifest.fps.is_finite() && numbers, "{manifest:?}");
                // What is in force is written beside the results, and must say the same.
                let text = toml::to_string(&manifest).expect("a manifest is TOML");
                assert_eq!(Manifest::parse(&text, "written").as_ref().ok(), Some(&manifest), "{text}");
            }
            Err(error) => {
                assert!(error.to_string().contains(MANIFEST), "{error} does not name {MANIFEST}");
                assert!(!error.hint().is_empty(), "{error} has no hint");
            }
        }
    }
);
