//! Images, masks, meshes, velocity fields, arrays: the other files that are read.
#![no_main]

use std::{fs, path::PathBuf, sync::OnceLock};

use libfuzzer_sys::fuzz_target;
use strandflow_core::{Grid, Mask, SparseVoxels};
use strandflow_fuzz::{folder, seeds, single_files, told};
use strandflow_io::{
    VdbOptions, exr_image::read_exr, mask_png, read_mask, read_npz, read_obj, read_rgb, read_vdb, write_velocity_vdb,
};

static FOLDER: OnceLock<PathBuf> = OnceLock::new();

fn written() -> Vec<Vec<u8>> {
    let mut seeds = vec![b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec()];
    seeds.extend(mask_png(&Mask::filled(3, 2, 200)));
    let folder = folder();
    let file = folder.join("a.vdb");
    let field = SparseVoxels {
        grid: Grid { origin: glam::DVec3::ZERO, voxel_mm: 4.0, dims: [2, 2, 2] },
        indices: vec![0, 3],
        values: vec![glam::Vec3::X, glam::Vec3::Y],
    };
    write_velocity_vdb(&file, &field, &VdbOptions::default()).expect("vdb");
    seeds.push(fs::read(&file).expect("a seed"));
    let _ = fs::remove_dir_all(folder);
    // The archive of arrays among the calibrations.
    seeds.extend(single_files().into_iter().filter(|bytes| bytes.starts_with(b"PK")));
    seeds
}

fuzz_target!(
    init: {
        seeds(written);
    },
    |data: &[u8]| {
        let path = FOLDER.get_or_init(folder).join("a.png");
        fs::write(&path, data).expect("the file");
        told(&path, read_rgb(&path));
        told(&path, read_mask(&path));
        told(&path, read_exr(&path));
        told(&path, read_obj(&path));
        told(&path, read_vdb(&path));
        told(&path, read_npz(&path));
    }
);
