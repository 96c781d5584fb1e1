//! Calibrations of several files: COLMAP's models in text and binary, EasyMocap's pairs, folders of K, R, t.
#![no_main]

use std::{fs, path::PathBuf, sync::OnceLock};

use libfuzzer_sys::fuzz_target;
use strandflow_fuzz::{calibration, folder, folders, seeds, unpack};

static FOLDER: OnceLock<PathBuf> = OnceLock::new();

fuzz_target!(
    init: {
        seeds(folders);
    },
    |data: &[u8]| {
        let model = FOLDER.get_or_init(folder).join("model");
        fs::create_dir_all(&model).expect("the folder");
        for (name, bytes) in unpack(data) {
            fs::write(model.join(name), bytes).expect("a file");
        }
        calibration(&model);
        let _ = fs::remove_dir_all(model);
    }
);
