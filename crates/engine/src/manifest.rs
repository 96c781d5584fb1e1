//! The manifest `strandflow.toml`: what the user states about a take.

use std::{collections::BTreeSet, path::Path};

use serde::{Deserialize, Serialize};
use strandflow_core::FrameRange;
use strandflow_stages::Mode;

use crate::{EngineError, Settings, disk};

/// Name of the manifest within a take.
pub const MANIFEST: &str = "strandflow.toml";

/// What the user states about a take. Paths are absolute or relative to the take. Lengths are millimetres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Frames per second.
    pub fps: f64,
    /// Gravity in world coordinates \[mm/s²\].
    pub gravity: [f64; 3],
    /// First frame and one past the last, `A..B`; all frames of the sources where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frames: Option<String>,
    /// Which reading of the method.
    #[serde(default)]
    pub mode: Mode,
    /// Seed of everything that is drawn by chance.
    #[serde(default)]
    pub seed: u64,
    /// Names of views that take no part in the reconstruction: `evaluate` judges the strands by their images.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub held_out: Vec<String>,
    /// The calibration.
    pub calibration: CalibrationFile,
    /// The views, in the order in which per-view arrays are stored.
    pub views: Vec<View>,
    /// What a person labelled.
    #[serde(default)]
    pub labels: Labels,
    /// Settings that differ from the defaults, one table a stage.
    #[serde(default)]
    pub settings: Settings,
}

/// Where the calibration is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationFile {
    /// A calibration of any format that is read.
    pub file: String,
    /// Millimetres a unit, for formats that do not say (COLMAP, OpenCV).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit_mm: Option<f64>,
}

/// One view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct View {
    /// Its name in the calibration, the labels and the masks.
    pub name: String,
    /// A video, or a folder of images in the order of their names.
    pub source: String,
    /// The view without the subject.
    pub plate: String,
}

/// What a person labelled and corrected.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Labels {
    /// Marker labels (JSON).
    pub markers: String,
    /// Folder of hair masks, `VIEW/FRAME.png` with six digits; the first frame's must be there, others correct.
    pub hair_masks: String,
    /// Folder of subject masks that replace computed ones, `VIEW/FRAME.png`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub subject_masks: Option<String>,
}

impl Manifest {
    /// Reads the manifest of a take.
    ///
    /// # Errors
    /// `Input` where it does not exist, is not TOML of this shape (with line and column), or `check` objects.
    pub fn read(take: &Path) -> Result<Self, EngineError> {
        let path = take.join(MANIFEST);
        if !path.is_file() {
            return Err(EngineError::input(
                path.display().to_string(),
                "there is no manifest",
                "make the take with `strandflow new TAKE --capture DIR`",
            ));
        }
        let manifest = Self::parse(&disk::read_text(&path)?, &path.display().to_string())?;
        let found = manifest.check();
        if found.is_empty() {
            return Ok(manifest);
        }
        Err(EngineError::input(path.display().to_string(), found.join("\n  "), "correct the manifest"))
    }

    /// From text; `name` is for messages.
    ///
    /// # Errors
    /// `Input` with line and column.
    pub fn parse(text: &str, name: &str) -> Result<Self, EngineError> {
        toml::from_str(text).map_err(|error| {
            EngineError::input(
                name,
                error.to_string().trim_end(),
                "see the comments that `strandflow new` writes into a manifest",
            )
        })
    }

    /// All violations.
    pub fn check(&self) -> Vec<String> {
        let mut found: Vec<String> = self.settings.check().iter().map(|v| format!("settings.{v}")).collect();
        let mut unless = |ok: bool, text: String| {
            if !ok {
                found.push(text);
            }
        };
        unless(
            self.fps.is_finite() && (1.0..=100_000.0).contains(&self.fps),
            format!("fps = {}: frames per second must lie in 1..=100000", self.fps),
        );
        let gravity = self.gravity.iter().map(|g| g * g).sum::<f64>().sqrt();
        unless(
            gravity.is_finite() && gravity <= 100_000.0,
            format!("gravity = {:?}: finite numbers in mm/s² are needed (9810 on earth)", self.gravity),
        );
        if let Some(frames) = &self.frames {
            let range = frames.parse::<FrameRange>();
            unless(range.is_ok(), format!("frames = {frames:?}: write A..B (A first, B one past the last)"));
        }
        let unit = self.calibration.unit_mm;
        unless(
            unit.is_none_or(|mm| mm.is_finite() && mm > 0.0),
            format!("calibration.unit_mm = {unit:?}: must be a positive number of millimetres"),
        );
        unless(self.views.len() >= 2, format!("views: {} given, at least two are needed", self.views.len()));
        let mut names = BTreeSet::new();
        for view in &self.views {
            unless(names.insert(&view.name), format!("views: `{}` is there twice", view.name));
            unless(
                !view.name.is_empty() && !view.name.contains(['/', '\\', '.']),
                format!("views: `{}` is no name (no slashes, no dots, not empty)", view.name),
            );
        }
        unless(!self.labels.markers.is_empty(), "labels.markers: the file of marker labels is missing".into());
        unless(!self.labels.hair_masks.is_empty(), "labels.hair_masks: the folder of hair masks is missing".into());
        found
    }
}
