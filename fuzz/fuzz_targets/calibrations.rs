//! Calibrations of one file: the same bytes under every ending, because content decides before the name.
#![no_main]

use std::{fs, path::PathBuf, sync::OnceLock};

use libfuzzer_sys::fuzz_target;
use strandflow_fuzz::{calibration, folder, seeds, single_files};

const NAMES: [&str; 7] = ["a.toml", "a.json", "transforms.json", "a.yml", "a.xml", "a.txt", "a.npz"];
static FOLDER: OnceLock<PathBuf> = OnceLock::new();

fuzz_target!(
    init: {
        seeds(single_files);
    },
    |data: &[u8]| {
        let folder = FOLDER.get_or_init(folder);
        let mut last = folder.join("written");
        fs::write(&last, data).expect("the file");
        for name in NAMES {
            let path = folder.join(name);
            fs::rename(&last, &path).expect("the file by another name");
            calibration(&path);
            last = path;
        }
        let _ = fs::remove_file(last);
    }
);
