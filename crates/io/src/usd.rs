//! Animated USD: one `BasisCurves` of constant topology with time samples, written frame by frame.
//!
//! Unit and axis are those of the options' [`Space`](crate::Space) (millimetres and Z up unless told otherwise) and stand in
//! `metersPerUnit` and `upAxis`; gravity points down. Time codes are frame numbers. `.usda` is text; `.usd` and `.usdc` are
//! the binary crate format.

use std::path::Path;

use crate::{
    IoError, Up,
    error::At,
    scene::{Scene, SceneOptions},
    strands::StrandFrames,
};

mod text;
mod usdc;

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

fn up_axis(up: Up) -> &'static str {
    match up {
        Up::Y => "Y",
        Up::Z => "Z",
    }
}

#[cfg(test)]
#[path = "usd/tests.rs"]
mod tests;

pub(crate) fn read_text(path: &Path) -> Result<crate::Groom, IoError> {
    Err(IoError::content(path, At::FILE, "not read yet", ""))
}
pub(crate) fn read_crate(path: &Path) -> Result<crate::Groom, IoError> {
    Err(IoError::content(path, At::FILE, "not read yet", ""))
}
