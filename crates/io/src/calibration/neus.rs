//! NeuS's (and IDR's) `cameras.npz`, `cameras_sphere.npz`: `world_mat_i`, a projection matrix of image i, and `scale_mat_i`,
//! which scales the scene into the unit sphere and does not touch the world of `world_mat_i`. First pixel centre (0, 0), as
//! NeuS's rays have it; no image size, no unit.

use std::{io::Cursor, path::Path};

use npyz::zip::ZipArchive;

use super::{convention::Unit, projection::taken_apart, settle::Described};
use crate::{IoError, error::At, strands::npy::NpyArray};

/// A matrix with its header is far below this \[bytes\]; a deflated entry may claim anything.
const MAX_ENTRY: u64 = 1 << 16;

/// What an archive says.
pub(super) fn described(path: &Path, bytes: Vec<u8>) -> Result<Described, IoError> {
    let wrong = |at: At, fact: String| {
        IoError::content(
            path,
            at,
            fact,
            "give NeuS's cameras_sphere.npz or cameras.npz, with world_mat_0, world_mat_1, …",
        )
    };
    let mut archive =
        ZipArchive::new(Cursor::new(bytes)).map_err(|cause| wrong(At::FILE, format!("is no .npz archive: {cause}")))?;
    let mut matrices: Vec<(usize, Vec<f64>)> = Vec::new();
    for index in 0..archive.len() {
        let entry = archive.by_index(index).map_err(|cause| wrong(At::FILE, format!("is damaged: {cause}")))?;
        let number = entry.name().strip_suffix(".npy").and_then(|name| name.strip_prefix("world_mat_"));
        let Some(number) = number.and_then(|number| number.parse().ok()) else { continue };
        let array = NpyArray::read(&mut std::io::Read::take(entry, MAX_ENTRY)).and_then(|array| {
            let numbers = array.as_f64()?;
            let fits = [[4, 4].as_slice(), &[3, 4]].contains(&array.shape.as_slice());
            if fits { Ok(numbers) } else { Err(format!("has the shape {:?}", array.shape)) }
        });
        matrices
            .push((number, array.map_err(|fact| wrong(At::view(&number.to_string()), format!("`world_mat` {fact}")))?));
    }
    matrices.sort_by_key(|(number, _)| *number);
    let mut cameras = Vec::new();
    for (number, matrix) in matrices {
        let parts = taken_apart(format!("{number:03}"), &matrix);
        let fact = || wrong(At::view(&number.to_string()), "`world_mat` is no projection matrix".into());
        cameras.push(parts.ok_or_else(fact)?);
    }
    Ok(Described::opencv("NeuS", cameras, Unit::Arbitrary, 0.0))
}
