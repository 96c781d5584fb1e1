//! Grooms of other programs: one frame of strands, whatever the format, told apart by content before name.
//!
//! | content or ending | format | unit | up |
//! |---|---|---|---|
//! | `HAIR` | Cem Yuksel's `.hair` | of ours known | |
//! | `.hair` without that | MonoHair's | | |
//! | `.data` | USC's hair | metres | |
//! | `.npz` | `points` (T, N, P, 3) as ours, or (N, P, 3) | of ours known | |
//! | `ply` | polygon file; by edges, `strand`, or a fixed number of points | of ours known | |
//! | `Ogawa` | Alembic curves | | |
//! | `#usda`, `PXR-USDC` | USD basis curves | `metersPerUnit` | `upAxis` |

use std::{fs::File, io::Read, path::Path};

use glam::Vec3;
use strandflow_core::Strands;

use crate::{
    IoError, Up, alembic,
    error::At,
    strands::{bare_hair, hair, npz_groom, ply_groom, usc_data},
    usd,
};

/// One frame of strands.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Groom {
    /// Points of each strand, root first as far as the file has it so: \[mm\] if `unit_known`, else in units of the file.
    /// All finite.
    pub strands: Vec<Vec<Vec3>>,
    /// Whether the file, or its format, states the unit.
    pub unit_known: bool,
    /// The axis against gravity, where the file states it.
    pub up_axis: Option<Up>,
}

impl Groom {
    /// Strands of a format without axes.
    pub(crate) fn of(strands: &Strands, unit_known: bool) -> Self {
        let strands = (0..strands.strand_count()).map(|n| strands.strand(n).to_vec()).collect();
        Self { strands, unit_known, up_axis: None }
    }

    /// The same groom if every point is a number.
    pub(crate) fn finite(self) -> Result<Self, String> {
        let broken = |strand: &Vec<Vec3>| strand.iter().position(|p| !p.is_finite());
        match self.strands.iter().enumerate().find_map(|(n, strand)| Some((n, broken(strand)?))) {
            Some((strand, at)) => Err(format!("strand {strand}: point {at} is not finite")),
            None => Ok(self),
        }
    }
}

const HINT: &str = "give .hair, .data, .npz, .ply, .abc (Ogawa), .usda or .usdc";

/// Reads the strands of one frame: the first of files that move.
///
/// # Errors
/// The file cannot be read, is of no format of the table above, is broken, holds no strand, or a point is not finite.
pub fn read_groom(path: &Path) -> Result<Groom, IoError> {
    let wrong = |fact: &str, hint: &str| Err(IoError::content(path, At::FILE, fact, hint));
    let mut magic = Vec::new();
    let file = File::open(path).map_err(IoError::reading(path))?;
    file.take(16).read_to_end(&mut magic).map_err(IoError::reading(path))?;
    let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    let groom = match (magic.as_slice(), ending.as_str()) {
        ([b'H', b'A', b'I', b'R', ..], _) => hair::read_hair_groom(path)?,
        ([b'O', b'g', b'a', b'w', b'a', ..], _) => alembic::read_curves(path)?,
        ([b'p', b'l', b'y', b'\n' | b'\r', ..], _) => ply_groom::read(path)?,
        ([0x89, b'H', b'D', b'F', ..], _) => {
            return wrong(
                "is an Alembic archive of the old kind (HDF5)",
                "write it as Ogawa: `abcconvert -toOgawa IN OUT`",
            );
        }
        (magic, _) if magic.starts_with(b"#usda") => usd::read_usda(path)?,
        (magic, _) if magic.starts_with(b"PXR-USDC") => usd::read_usdc(path)?,
        (_, "usdz") => {
            return wrong("is a USD package, which is not read", "unpack it, or `usdcat IN.usdz -o OUT.usdc`");
        }
        ([b'P', b'K', ..], _) => npz_groom::read(path)?,
        (_, "hair") => bare_hair::read(path)?,
        (_, "data") => Groom::of(&usc_data::read_usc_data(path)?, true),
        _ => return wrong("is of no format of strands that is read", HINT),
    };
    if groom.strands.iter().all(Vec::is_empty) {
        return wrong("holds no strand", "check that it is the right file");
    }
    Ok(groom)
}

/// Reads all of a file and what a reader makes of it; facts become errors that name the file.
pub(crate) fn from_bytes(
    path: &Path,
    hint: &str,
    read: impl FnOnce(&[u8]) -> Result<Groom, String>,
) -> Result<Groom, IoError> {
    let data = std::fs::read(path).map_err(IoError::reading(path))?;
    read(&data).and_then(Groom::finite).map_err(|fact| IoError::content(path, At::FILE, fact, hint))
}

/// As [`from_bytes`] for formats of which only parts are read.
pub(crate) fn from_file(
    path: &Path,
    hint: &str,
    read: impl FnOnce(&mut File) -> Result<Groom, String>,
) -> Result<Groom, IoError> {
    let mut file = File::open(path).map_err(IoError::reading(path))?;
    read(&mut file).and_then(Groom::finite).map_err(|fact| IoError::content(path, At::FILE, fact, hint))
}

#[cfg(test)]
#[path = "groom/tests.rs"]
mod tests;
