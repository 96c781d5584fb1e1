//! The calibration of a capture: found, read, its cameras matched to the views.

use std::path::{Path, PathBuf};

use strandflow_core::{Camera, Rig};
use strandflow_io::{
    Calibration, ReadOptions,
    calibration::{
        KNOWN_NAMES, MatchedBy, gaze_of_rig, looks_like_calibration, match_views, own_toml::toml_text,
        read_calibration, read_calibration_with,
    },
    rig_for_views,
};

use super::{NewTake, footage::View};
use crate::EngineError;

/// Where a converted calibration lies in a take.
pub(super) const CONVERTED: &str = "calibration.toml";

/// A calibration whose cameras are those of the views, in their order.
pub(super) struct Calibrated {
    /// As the manifest names it.
    pub file: PathBuf,
    /// Millimetres a unit, where the manifest has to say it.
    pub unit_mm: Option<f64>,
    pub calibration: Calibration,
    /// The text of `file` where the original does not serve as it is.
    pub converted: Option<String>,
}

/// The calibration of a capture by its usual names.
pub(super) fn find(capture: &Path, said: &mut Vec<String>) -> Result<PathBuf, EngineError> {
    let usual = KNOWN_NAMES.iter().map(|name| capture.join(name)).filter(|path| path.exists());
    let mut found: Vec<PathBuf> = usual.filter(|path| looks_like_calibration(path)).collect();
    if found.is_empty() && looks_like_calibration(capture) {
        found.push(capture.to_owned());
    }
    if found.is_empty() {
        let hint = "give it by --calibration FILE, or put calibration.json, .toml, .yml, .xml or a colmap/ folder into the \
                    capture; docs/capture.md lists all formats";
        return Err(EngineError::input(capture.display().to_string(), "there is no calibration", hint));
    }
    let first = found.remove(0);
    said.push(format!("calibration: {}", first.display()));
    for other in &found {
        said.push(format!("{} seems to be a calibration too; take it by --calibration", other.display()));
    }
    Ok(first)
}

/// Reads the calibration and matches its cameras to the views.
pub(super) fn read(
    file: &Path,
    views: &[View],
    asked: &NewTake,
    said: &mut Vec<String>,
) -> Result<Calibrated, EngineError> {
    let sizes = views.iter().map(|view| (view.name.clone(), [view.info.width, view.info.height])).collect();
    let options = ReadOptions { unit_mm: asked.unit_mm, guess_unit: true, convention: asked.convention, sizes };
    let mut calibration = read_calibration_with(file, &options)?;
    said.extend(calibration.notes.iter().map(|note| format!("calibration: {note}")));
    calibration.rig = matched(file, &calibration.rig, views, said)?;
    for (camera, view) in calibration.rig.cameras.iter().zip(views) {
        must_fit(file, camera, view)?;
    }
    if let Some(gaze) = gaze_of_rig(&calibration.rig) {
        said.push(format!(
            "the cameras stand {:.0} to {:.0} mm from the place they look at ({:.0}, {:.0}, {:.0})",
            gaze.nearest, gaze.farthest, gaze.point.x, gaze.point.y, gaze.point.z
        ));
    }
    // The original serves where it says the same without all that was told or guessed here, but for the unit.
    let names: Vec<String> = views.iter().map(|view| view.name.clone()).collect();
    let serves = |unit_mm: Option<f64>| {
        let plain = read_calibration(file, unit_mm).ok()?;
        (rig_for_views(file, &plain.rig, &names).ok()? == calibration.rig).then_some(unit_mm)
    };
    if let Some(unit_mm) = serves(None).or_else(|| serves(calibration.unit_mm)) {
        return Ok(Calibrated { file: file.to_owned(), unit_mm, calibration, converted: None });
    }
    said.push(format!("the calibration is converted into {CONVERTED} of the take (millimetres, OpenCV axes)"));
    let origin = format!("# Made by `strandflow new` of {}.\n", file.display());
    let text = toml_text(&Calibration { notes: Vec::new(), ..calibration.clone() });
    let converted = Some(origin + &text);
    Ok(Calibrated { file: CONVERTED.into(), unit_mm: None, calibration, converted })
}

/// The camera of each view, by the view's name.
fn matched(file: &Path, rig: &Rig, views: &[View], said: &mut Vec<String>) -> Result<Rig, EngineError> {
    let names: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
    let cameras: Vec<&str> = rig.cameras.iter().map(|camera| camera.name.as_str()).collect();
    let Some(found) = match_views(&names, &cameras) else {
        let fact = format!("its cameras ({}) are not those of the views ({})", cameras.join(", "), names.join(", "));
        let hint = "name the videos or folders of images like the cameras";
        return Err(EngineError::input(file.display().to_string(), fact, hint));
    };
    if found.by != MatchedBy::Name {
        let pairs = names.iter().zip(&found.cameras).map(|(view, &at)| format!("{view} = {}", cameras[at]));
        let pairs = pairs.collect::<Vec<_>>().join(", ");
        said.push(format!("views and cameras are matched by {}: {pairs}", in_words(found.by)));
    }
    let unused: Vec<&str> = (0..cameras.len()).filter(|at| !found.cameras.contains(at)).map(|at| cameras[at]).collect();
    if !unused.is_empty() {
        said.push(format!("cameras without footage are left out: {}", unused.join(", ")));
    }
    let camera = |(view, &at): (&View, &usize)| Camera { name: view.name.clone(), ..rig.cameras[at].clone() };
    Ok(Rig { cameras: views.iter().zip(&found.cameras).map(camera).collect() })
}

pub(super) fn in_words(by: MatchedBy) -> &'static str {
    match by {
        MatchedBy::Name => "name",
        MatchedBy::LooseName => "name, but for case and zeros",
        MatchedBy::PartOfName => "a part of the name",
        MatchedBy::Order => "their order only, so check this",
    }
}

fn must_fit(file: &Path, camera: &Camera, view: &View) -> Result<(), EngineError> {
    let (w, h) = (view.info.width, view.info.height);
    if (w, h) == (camera.width, camera.height) {
        return Ok(());
    }
    let factors = [w as f64 / camera.width as f64, h as f64 / camera.height as f64];
    let fact = format!("the footage is {w}×{h}, the calibration {}×{}", camera.width, camera.height);
    let hint = if (factors[0] / factors[1] - 1.0).abs() < 0.01 {
        format!(
            "the footage is scaled by {:.4}: multiply the first two rows of K by it and correct the size in the \
             calibration, or give the footage as it was calibrated",
            factors[0]
        )
    } else if (h, w) == (camera.width, camera.height) {
        "the footage is turned by 90°: turn it back, or calibrate with turned images".into()
    } else {
        "the footage is cropped, or of another camera: give it as it was calibrated".into()
    };
    Err(EngineError::input(format!("{}, view {}", file.display(), view.name), fact, hint))
}
