//! Calibrated rigs from the formats people have; always millimetres, OpenCV axes, first pixel centre at (0.5, 0.5).
//!
//! | file | format |
//! |---|---|
//! | `*.toml` | our own (`own_toml`) |
//! | `*.json` | plain K/R/t (`plain_json`), OpenCV (`opencv_json`), Nerfstudio (`nerfstudio`), NeRSemble (`nersemble`) |
//! | `*.yml`, `*.yaml`, `*.xml`, or a folder of them | OpenCV file storage (`opencv`) |
//! | `intri.yml` and `extri.yml` | EasyMocap (`easymocap`) |
//! | `*.xml` | Metashape (`metashape`) |
//! | `*.npz` | NeuS (`neus`) |
//! | `*.txt`, or a folder of them | plain K/R/t (`krt_text`) |
//! | a folder with `cameras.txt`/`.bin` and `images.txt`/`.bin` | COLMAP (`colmap_text`, `colmap_binary`, `colmap_rigs`) |
//!
//! Each reader says what a file says (`Described`); `settle` makes a rig of it.

use std::{collections::BTreeSet, path::Path};

use glam::DVec3;
use strandflow_core::Rig;

use crate::{IoError, error::At};

pub mod colmap;
pub mod colmap_binary;
mod colmap_rigs;
pub mod colmap_text;
pub mod convention;
pub mod dispatch;
pub mod easymocap;
pub mod gaze;
mod json_tree;
pub mod krt_text;
pub mod metashape;
pub mod naming;
pub mod nerfstudio;
pub mod nersemble;
pub mod neus;
pub mod opencv;
pub mod opencv_json;
mod opencv_xml;
mod opencv_yaml;
pub mod own_toml;
pub(crate) mod parts;
pub mod plain_json;
mod projection;
pub(crate) mod settle;
mod xml_tree;

pub use self::{
    convention::{Axes, CONVENTION_WORDS, Convention, Pose, named_unit},
    dispatch::{KNOWN_NAMES, looks_like_calibration},
    gaze::{Gaze, gaze_of_rig},
    naming::{Matched, MatchedBy, match_views},
};
pub(crate) use convention::pixel_shift;

/// A calibration, in millimetres and seconds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Calibration {
    /// The cameras, in the order of the file.
    pub rig: Rig,
    /// Gravity in the world \[mm/s²\], where the file has it.
    pub gravity: Option<DVec3>,
    /// Frames per second, where the file has it.
    pub fps: Option<f64>,
    /// Millimetres a unit of the file, where it was told or guessed because the file does not say.
    pub unit_mm: Option<f64>,
    /// What was converted, told apart or had to be assumed.
    pub notes: Vec<String>,
}

/// What the reader is told beside the file.
#[derive(Clone, Debug, Default)]
pub struct ReadOptions {
    /// Millimetres a unit, for formats that do not say.
    pub unit_mm: Option<f64>,
    /// Whether an unsaid unit may be told by how far the cameras stand from what they look at.
    pub guess_unit: bool,
    /// What the user says of conventions.
    pub convention: Convention,
    /// Image size \[px\] by view, for formats that have none.
    pub sizes: Vec<(String, [usize; 2])>,
}

/// Reads a calibration of any known format. `unit_mm` is the length of one unit of the file in millimetres for formats
/// that do not say (COLMAP, OpenCV); `None` there is an error with a hint.
///
/// # Errors
/// As [`read_calibration_with`].
pub fn read_calibration(path: &Path, unit_mm: Option<f64>) -> Result<Calibration, IoError> {
    read_calibration_with(path, &ReadOptions { unit_mm, ..ReadOptions::default() })
}

/// Reads a calibration of any known format, told by its content before its name.
///
/// # Errors
/// The file cannot be read, its format is not known, a camera is not sound, or a convention or unit is neither stated nor
/// to be told by the rig; the hint then names what to give.
pub fn read_calibration_with(path: &Path, options: &ReadOptions) -> Result<Calibration, IoError> {
    if let Err(cause) = std::fs::metadata(path) {
        return Err(IoError::reading(path)(cause));
    }
    let described = dispatch::described(path, options)?;
    let calibration = settle::settle(path, described, options)?;
    check_names(path, &calibration.rig)?;
    Ok(calibration)
}

fn check_names(path: &Path, rig: &Rig) -> Result<(), IoError> {
    if rig.cameras.is_empty() {
        return Err(IoError::content(path, At::FILE, "holds no camera", "check that it is the right file"));
    }
    let mut names = BTreeSet::new();
    match rig.cameras.iter().find(|camera| !names.insert(&camera.name)) {
        None => Ok(()),
        Some(camera) => {
            let fact = "the camera is listed twice";
            Err(IoError::content(path, At::view(&camera.name), fact, "give every camera a name of its own"))
        }
    }
}

/// The cameras of the named views, in their order.
///
/// # Errors
/// A view has no camera.
pub fn rig_for_views(path: &Path, rig: &Rig, views: &[String]) -> Result<Rig, IoError> {
    let camera = |view: &String| {
        rig.view_named(view).map(|at| rig.cameras[at].clone()).ok_or_else(|| {
            let known: Vec<&str> = rig.cameras.iter().map(|camera| camera.name.as_str()).collect();
            IoError::content(
                path,
                At::view(view),
                "the view has no calibration",
                format!("add a camera named `{view}` or leave the view out; the calibration has {}", known.join(", ")),
            )
        })
    };
    Ok(Rig { cameras: views.iter().map(camera).collect::<Result<_, _>>()? })
}

#[cfg(test)]
mod fixtures;
