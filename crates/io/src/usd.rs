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

mod cards;
mod crate_file;
mod layer;
mod read_crate;
mod read_text;
mod text;
mod unpack;
mod usdc;
mod values;

pub(crate) use cards::{CardMesh, CardSample, write_cards};

/// What a layer says of itself.
struct LayerHead {
    /// Time codes of the samples.
    times: Vec<f64>,
    fps: f64,
    metres_per_unit: f64,
    up: Up,
}

impl LayerHead {
    fn of(scene: &Scene) -> Self {
        let SceneOptions { fps, space, .. } = scene.options;
        Self { times: scene.times(), fps, metres_per_unit: scene.metres_per_unit(), up: space.up }
    }

    fn first(&self) -> f64 {
        self.times.first().copied().unwrap_or(0.0)
    }

    fn last(&self) -> f64 {
        self.times.last().copied().unwrap_or(0.0)
    }
}

/// The form of a USD file that its ending asks for.
enum Form {
    Text,
    Crate,
}

impl Form {
    /// # Errors
    /// The ending is none of USD's.
    fn of(path: &Path) -> Result<Self, IoError> {
        match path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase().as_str() {
            "usda" => Ok(Self::Text),
            "usd" | "usdc" => Ok(Self::Crate),
            _ => Err(IoError::content(path, At::FILE, "is no USD file name", "end it in .usd, .usdc or .usda")),
        }
    }
}

/// Writes strands as USD; the ending of the file decides the form. Memory: a few frames.
///
/// # Errors
/// The ending is none of USD's, no strand takes part, a frame cannot be read, or the file cannot be written; the file is
/// then as it was before.
pub fn write_usd(path: &Path, strands: &dyn StrandFrames, options: &SceneOptions) -> Result<(), IoError> {
    let form = Form::of(path)?;
    let scene = Scene::new(path, strands, options)?;
    match form {
        Form::Text => text::write(path, &scene),
        Form::Crate => usdc::write(path, &scene),
    }
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
