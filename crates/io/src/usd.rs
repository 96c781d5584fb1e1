//! Animated USD: one `BasisCurves` of constant topology with time samples, written frame by frame.
//!
//! Unit and axis are those of the options' [`Space`](crate::Space) (millimetres and Z up unless told otherwise) and stand in
//! `metersPerUnit` and `upAxis`; gravity points down. Time codes are frame numbers. `.usda` is text; `.usd` and `.usdc` are
//! the binary crate format.

use std::path::Path;

use crate::{
    Groom, IoError, Up,
    error::At,
    groom::{from_bytes, from_file},
    scene::{Scene, SceneOptions},
    strands::StrandFrames,
};

mod layer;
mod read_crate;
mod read_text;
mod text;
mod unpack;
mod usdc;
mod values;

/// Writes strands as USD; the ending of the file decides the form. Memory: a few frames.
///
/// # Errors
/// The ending is none of USD's, no strand takes part, a frame cannot be read, or the file cannot be written; the file is
/// then as it was before.
pub fn write_usd(path: &Path, strands: &dyn StrandFrames, options: &SceneOptions) -> Result<(), IoError> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    let write = match extension.as_str() {
        "usda" => text::write,
        "usd" | "usdc" => usdc::write,
        _ => return Err(IoError::content(path, At::FILE, "is no USD file name", "end it in .usd, .usdc or .usda")),
    };
    write(path, &Scene::new(path, strands, options)?)
}

const READ_HINT: &str =
    "curves behind references or variants are not followed: write one layer with `usdcat --flatten IN -o OUT.usda`";

/// Reads the basis curves of a text layer: defaults, or else the first time samples; \[mm\] where it states its unit.
pub(crate) fn read_usda(path: &Path) -> Result<Groom, IoError> {
    from_bytes(path, READ_HINT, |data| read_text::read(data)?.groom())
}

/// As [`read_usda`], of a binary layer.
pub(crate) fn read_usdc(path: &Path) -> Result<Groom, IoError> {
    from_file(path, READ_HINT, |file| read_crate::read(file)?.groom())
}

fn up_axis(up: Up) -> &'static str {
    match up {
        Up::Y => "Y",
        Up::Z => "Z",
    }
}

#[cfg(test)]
#[path = "usd/tests.rs"]
mod tests;

#[cfg(test)]
#[path = "usd/read_tests.rs"]
mod read_tests;
