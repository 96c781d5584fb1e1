//! Grooms: `.hair`, `.data`, PLY, arrays of NumPy, Alembic, USD in text and binary. Content decides; `.hair` and `.data` without a
//! mark need their names.
#![no_main]

use std::{fs, path::PathBuf, sync::OnceLock};

use glam::Vec3;
use libfuzzer_sys::fuzz_target;
use strandflow_core::{Provenance, StrandSequence};
use strandflow_fuzz::{folder, seeds, told};
use strandflow_io::{
    Interchange, SceneOptions, read_groom, write_alembic, write_hair, write_npz, write_ply, write_usc_data, write_usd,
};

static FOLDER: OnceLock<PathBuf> = OnceLock::new();

/// Two strands of three and two points, in every format that is written.
fn written() -> Vec<Vec<u8>> {
    let mut sequence = StrandSequence::missing(vec![0], vec![3, 2], 3);
    for n in 0..2 {
        for (k, at) in sequence.range(0, n).enumerate() {
            sequence.points[at] = Vec3::new(k as f32, 10.0 * n as f32, -1.5);
            sequence.provenance[at] = Provenance::Observed;
        }
    }
    let folder = folder();
    let at = |name: &str| folder.join(name);
    let strands = Interchange::new(&sequence).expect("strands");
    let options = SceneOptions::default();
    write_hair(&at("a.hair"), &strands, 0).expect("hair");
    write_usc_data(&at("a.data"), &strands, 0).expect("data");
    write_ply(&at("a.ply"), &strands, 0).expect("ply");
    write_npz(&at("a.npz"), &sequence, &[]).expect("npz");
    write_alembic(&at("a.abc"), &sequence, None, &options).expect("abc");
    write_usd(&at("a.usda"), &sequence, &options).expect("usda");
    write_usd(&at("a.usdc"), &sequence, &options).expect("usdc");
    let names = ["a.hair", "a.data", "a.ply", "a.npz", "a.abc", "a.usda", "a.usdc"];
    let seeds = names.iter().map(|name| fs::read(at(name)).expect("a seed")).collect();
    let _ = fs::remove_dir_all(&folder);
    seeds
}

fuzz_target!(
    init: {
        seeds(written);
    },
    |data: &[u8]| {
        let folder = FOLDER.get_or_init(folder);
        let [hair, bare] = ["a.hair", "a.data"].map(|name| folder.join(name));
        fs::write(&hair, data).expect("the file");
        if let Some(groom) = told(&hair, read_groom(&hair)) {
            assert!(groom.strands.iter().flatten().all(|point| point.is_finite()), "points are numbers");
        }
        fs::rename(&hair, &bare).expect("the file by another name");
        told(&bare, read_groom(&bare));
        let _ = fs::remove_file(bare);
    }
);
