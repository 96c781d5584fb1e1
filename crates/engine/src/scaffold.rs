//! A take for footage in any folder and a calibration of any dialect; nothing of the footage is copied.
//!
//! What is found is guessed from names, sizes and the rig itself; every guess is said in a line.

use std::path::{Path, PathBuf};

use glam::DVec3;
use strandflow_io::calibration::Convention;

use crate::{EngineError, disk, manifest::MANIFEST};

mod calibrated;
mod extras;
mod footage;
mod world;
mod written;

/// What the user says beside the footage.
#[derive(Clone, Debug, Default)]
pub struct NewTake {
    /// The folder to make.
    pub take: PathBuf,
    /// The folder of the footage.
    pub capture: PathBuf,
    /// The calibration; looked for in the capture where absent.
    pub calibration: Option<PathBuf>,
    /// Millimetres a unit of the calibration.
    pub unit_mm: Option<f64>,
    /// Conventions of the calibration.
    pub convention: Convention,
    /// Frames per second.
    pub fps: Option<f64>,
    /// The direction up in the world.
    pub up: Option<DVec3>,
    /// Views that take no part in the reconstruction.
    pub held_out: Vec<String>,
}

/// A take that was made.
#[derive(Clone, Debug)]
pub struct Scaffolded {
    /// The manifest.
    pub manifest: PathBuf,
    /// What was found and guessed, one fact a line.
    pub said: Vec<String>,
    /// What the user still has to make before the take runs.
    pub missing: Vec<String>,
}

/// Makes a take.
///
/// # Errors
/// `Input` where the take exists already, the capture lacks something, or a guess cannot be made; the hint names the option
/// to give. Nothing is written then.
pub fn new_take(asked: &NewTake) -> Result<Scaffolded, EngineError> {
    let manifest = asked.take.join(MANIFEST);
    if manifest.exists() {
        let hint = "give another folder, or correct the manifest that is there";
        return Err(EngineError::input(manifest.display().to_string(), "the take exists already", hint));
    }
    let whole = |path: &Path, what: &str| {
        let cannot = |error: std::io::Error| EngineError::input(path.display().to_string(), error.to_string(), what);
        path.canonicalize().map_err(cannot)
    };
    let capture = whole(&asked.capture, "give the folder of the capture")?;
    let given = asked.calibration.as_deref().map(|file| whole(file, "give the file or folder of the calibration"));
    let mut said = Vec::new();
    let calibration = match given {
        Some(file) => file?,
        None => calibrated::find(&capture, &mut said)?,
    };
    let views = footage::find(&capture, &calibration, &mut said)?;
    check_held_out(&capture, &views, &asked.held_out)?;
    let plates = extras::plates(&capture, &views, &mut said)?;
    let calibrated = calibrated::read(&calibration, &views, asked, &mut said)?;
    let labels = extras::labels(&capture, &views, &mut said);
    let world = world::settle(&calibration, &calibrated, &views, asked, &mut said)?;
    let found = written::Found { capture: &capture, views: &views, plates: &plates, labels: &labels, world: &world };
    if let Some(text) = &calibrated.converted {
        disk::write_atomic(&asked.take.join(calibrated::CONVERTED), text.as_bytes())?;
    }
    disk::write_atomic(&manifest, written::text(&found, &calibrated, &asked.held_out, &said).as_bytes())?;
    Ok(Scaffolded { manifest, said, missing: labels.missing })
}

fn check_held_out(capture: &Path, views: &[footage::View], held_out: &[String]) -> Result<(), EngineError> {
    let Some(name) = held_out.iter().find(|name| !views.iter().any(|view| view.name == **name)) else { return Ok(()) };
    let names: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
    let fact = format!("--hold-out {name}: there is no such view");
    Err(EngineError::input(capture.display().to_string(), fact, format!("views: {}", names.join(", "))))
}

#[cfg(test)]
#[path = "scaffold/tests.rs"]
mod tests;
