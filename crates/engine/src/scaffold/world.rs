//! Time and gravity of a take: from the calibration, the videos, or the cameras.

use std::path::Path;

use glam::DVec3;
use strandflow_io::agreed_fps;

use super::{NewTake, calibrated::Calibrated, footage::View};
use crate::EngineError;

/// Gravity on earth \[mm/s²\].
const GRAVITY: f64 = 9806.65;

/// What the manifest says beside files.
pub(super) struct World {
    pub fps: f64,
    pub gravity: DVec3,
    /// The frames that all views have, where they differ in length.
    pub frames: Option<String>,
}

pub(super) fn settle(
    calibration: &Path,
    calibrated: &Calibrated,
    views: &[View],
    asked: &NewTake,
    said: &mut Vec<String>,
) -> Result<World, EngineError> {
    let fps = fps(calibration, calibrated.calibration.fps, views, asked, said)?;
    let gravity = gravity(calibrated, asked, said);
    Ok(World { fps, gravity, frames: frames(views, said) })
}

fn fps(
    calibration: &Path,
    stated: Option<f64>,
    views: &[View],
    asked: &NewTake,
    said: &mut Vec<String>,
) -> Result<f64, EngineError> {
    let agreed = agreed_fps(views.iter().filter_map(|view| view.info.fps));
    let (fps, by) = if let Some(fps) = asked.fps {
        (fps, "--fps")
    } else if let Some(fps) = stated {
        (fps, "the calibration")
    } else if let Some(fps) = agreed {
        (fps, "the videos; slow motion that plays slowly needs --fps with the rate of the recording")
    } else {
        let fact = "neither calibration nor footage says how many frames there are a second";
        return Err(EngineError::input(
            calibration.display().to_string(),
            fact,
            "give the rate of the recording: --fps 100",
        ));
    };
    said.push(format!("{fps} frames a second, by {by}"));
    if let Some(videos) = agreed.filter(|videos| (videos - fps).abs() > 1e-3 * fps) {
        said.push(format!("the videos themselves say {videos} frames a second"));
    }
    Ok(fps)
}

fn gravity(calibrated: &Calibrated, asked: &NewTake, said: &mut Vec<String>) -> DVec3 {
    if let Some(up) = asked.up {
        return -up.normalize() * GRAVITY;
    }
    if let Some(gravity) = calibrated.calibration.gravity {
        return gravity;
    }
    let cameras = &calibrated.calibration.rig.cameras;
    let down =
        cameras.iter().map(|camera| camera.camera_from_world.rotation.row(1)).sum::<DVec3>() / cameras.len() as f64;
    let axes = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
    let nearest = axes.into_iter().max_by(|a, b| a.dot(down).total_cmp(&b.dot(down))).unwrap_or(DVec3::NEG_Z);
    if down.length() < 0.5 {
        said.push("gravity is taken as -z: the cameras do not agree on what is down (else --up)".into());
        return DVec3::NEG_Z * GRAVITY;
    }
    // Cameras that stand upright look down or up a little, evenly around a ring; their mean is within some degrees of the axis.
    if nearest.dot(down.normalize()) > 0.9 {
        said.push(format!("gravity is taken along {nearest}, the axis nearest to the cameras' own down (else --up)"));
        return nearest * GRAVITY;
    }
    let gravity = (down.normalize() * GRAVITY).round();
    said.push(format!("gravity is taken as {gravity} mm/s², the cameras' own down: no axis is near (else --up)"));
    gravity
}

fn frames(views: &[View], said: &mut Vec<String>) -> Option<String> {
    let counts = || views.iter().map(|view| view.info.frame_count);
    let (least, most) = (counts().min()?, counts().max()?);
    if least == most {
        said.push(format!("frames: {least} a view"));
        return None;
    }
    let short: Vec<&str> =
        views.iter().filter(|view| view.info.frame_count == least).map(|view| view.name.as_str()).collect();
    said.push(format!(
        "frames: the views have {least} to {most}; the first {least} are taken, as {} has no more. All must begin together",
        short.join(", ")
    ));
    Some(format!("0..{least}"))
}
