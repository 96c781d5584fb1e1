//! From what a file describes to a rig: conventions that it leaves open are told apart by the rig itself where they can be,
//! and asked for by name where they cannot.

use std::path::Path;

use glam::DVec3;
use strandflow_core::{Rig, RigidTransform};

use super::{
    Calibration, ReadOptions,
    convention::{Axes, CONVENTION_WORDS, Pose, Unit},
    gaze::{gaze, only_sensible, unit_by_distance},
    naming::match_views,
    parts::{CameraParts, Lens},
};
use crate::{IoError, error::At};

/// More cameras than this are no rig.
const MAX_CAMERAS: usize = 1000;

/// What a file says.
#[derive(Clone, Debug)]
pub(crate) struct Described {
    /// The format, for messages.
    pub dialect: &'static str,
    pub cameras: Vec<CameraParts>,
    pub unit: Unit,
    /// `None` where neither file nor format says.
    pub pose: Option<Pose>,
    /// As `pose`.
    pub axes: Option<Axes>,
    /// What is taken where neither is said and the rig does not tell; without it the user is asked.
    pub fallback: Option<(Pose, Axes)>,
    /// Coordinates of the first pixel's centre; `None` where neither file nor format says.
    pub first_pixel: Option<f64>,
    /// In the file's unit a second squared.
    pub gravity: Option<DVec3>,
    pub fps: Option<f64>,
    pub notes: Vec<String>,
}

impl Described {
    /// World to camera, OpenCV axes.
    pub fn opencv(dialect: &'static str, cameras: Vec<CameraParts>, unit: Unit, first_pixel: f64) -> Self {
        Self {
            dialect,
            cameras,
            unit,
            pose: Some(Pose::WorldToCamera),
            axes: Some(Axes::OpenCv),
            fallback: None,
            first_pixel: Some(first_pixel),
            gravity: None,
            fps: None,
            notes: Vec::new(),
        }
    }
}

/// The rig that a file describes.
pub(crate) fn settle(path: &Path, mut file: Described, options: &ReadOptions) -> Result<Calibration, IoError> {
    if file.cameras.len() > MAX_CAMERAS {
        let fact = format!("holds {} cameras", file.cameras.len());
        let hint = "give the calibration of the rig's cameras, one entry a camera (at most 1000)";
        return Err(IoError::content(path, At::FILE, fact, hint));
    }
    let mut notes = std::mem::take(&mut file.notes);
    let poses = poses_of(path, &file, options, &mut notes)?;
    let unit_mm = unit_of(path, &file, &poses, options, &mut notes)?;
    let first_pixel = options.convention.first_pixel.or(file.first_pixel).unwrap_or_else(|| {
        notes.push("the first pixel's centre is not said: taken as (0, 0), OpenCV's (else `pixel0.5`)".into());
        0.0
    });
    if first_pixel == 0.0 {
        notes.push(format!("{}: first pixel centre (0, 0) moved to (0.5, 0.5)", file.dialect));
    }
    if file.cameras.iter().any(|camera| camera.size.is_none()) && !options.sizes.is_empty() {
        sizes_from_footage(path, &mut file.cameras, options, &mut notes)?;
    }
    let mut cameras = Vec::with_capacity(poses.len());
    for (mut parts, pose) in file.cameras.into_iter().zip(poses) {
        if let (true, Lens::OpenCv(terms)) = (options.convention.fisheye, &parts.lens) {
            parts.lens = Lens::Fisheye(terms.clone());
        }
        let pose = RigidTransform { translation: pose.translation * unit_mm, ..pose };
        cameras.push(parts.build(path, pose, 0.5 - first_pixel)?);
    }
    let gravity = file.gravity.map(|g| g * unit_mm);
    check_numbers(path, gravity, file.fps)?;
    let unit_mm = (!matches!(file.unit, Unit::Stated(_))).then_some(unit_mm);
    Ok(Calibration { rig: Rig { cameras }, gravity, fps: file.fps, unit_mm, notes })
}

fn poses_of(
    path: &Path,
    file: &Described,
    options: &ReadOptions,
    notes: &mut Vec<String>,
) -> Result<Vec<RigidTransform>, IoError> {
    let (pose, axes) = (options.convention.pose.or(file.pose), options.convention.axes.or(file.axes));
    let read = |(pose, axes): (Pose, Axes)| {
        file.cameras.iter().map(|camera| camera.pose(path, pose, axes)).collect::<Result<Vec<_>, _>>()
    };
    let directions = pose.map_or(vec![Pose::WorldToCamera, Pose::CameraToWorld], |pose| vec![pose]);
    let kinds = axes.map_or(vec![Axes::OpenCv, Axes::OpenGl], |axes| vec![axes]);
    let readings: Vec<(Pose, Axes)> =
        directions.iter().flat_map(|&pose| kinds.iter().map(move |&axes| (pose, axes))).collect();
    let mut all = readings.iter().map(|&reading| read(reading)).collect::<Result<Vec<_>, _>>()?;
    if let [_] = readings.as_slice() {
        if gaze(&all[0]).is_some_and(|gaze| gaze.nearest <= 0.0) {
            let said = in_words(readings[0]);
            notes.push(format!("read as {said}, some cameras look away from the place that all look at: is that so?"));
        }
        return Ok(all.swap_remove(0));
    }
    if let Some(best) = only_sensible(&all) {
        let said = in_words(readings[best]);
        notes.push(format!("poses are read as {said}: so all cameras look at one place in front of them"));
        return Ok(all.swap_remove(best));
    }
    if let Some((usual_pose, usual_axes)) = file.fallback {
        // What was said stays said.
        let taken = (pose.unwrap_or(usual_pose), axes.unwrap_or(usual_axes));
        notes.push(format!("no convention: R and t are taken as {}", in_words(taken)));
        return read(taken);
    }
    let fact = "does not say which way its poses lead, and the cameras do not tell";
    Err(IoError::content(
        path,
        At::FILE,
        fact,
        format!("give the convention by name: `new --convention` with {CONVENTION_WORDS}"),
    ))
}

fn in_words((pose, axes): (Pose, Axes)) -> &'static str {
    match (pose, axes) {
        (Pose::WorldToCamera, Axes::OpenCv) => "world to camera with OpenCV axes (w2c,opencv)",
        (Pose::WorldToCamera, Axes::OpenGl) => "world to camera with OpenGL axes (w2c,opengl)",
        (Pose::CameraToWorld, Axes::OpenCv) => "camera to world with OpenCV axes (c2w,opencv)",
        (Pose::CameraToWorld, Axes::OpenGl) => "camera to world with OpenGL axes (c2w,opengl)",
    }
}

/// Millimetres a unit.
fn unit_of(
    path: &Path,
    file: &Described,
    poses: &[RigidTransform],
    options: &ReadOptions,
    notes: &mut Vec<String>,
) -> Result<f64, IoError> {
    match (file.unit, options.unit_mm) {
        (Unit::Stated(unit), _) => Ok(unit),
        (_, Some(unit)) if unit.is_finite() && unit > 0.0 => Ok(unit),
        (_, Some(unit)) => Err(IoError::content(
            path,
            At::FILE,
            format!("{unit} mm is not a length of a unit"),
            "give the length of one unit of the calibration in millimetres (1000 for metres)",
        )),
        (Unit::Customary(unit), None) => {
            notes.push(format!("{}: lengths are {} mm a unit, as its documentation says", file.dialect, unit));
            Ok(unit)
        }
        (Unit::Unsaid, None) if options.guess_unit => {
            let seen = gaze(poses);
            let found = seen.and_then(|gaze| Some((unit_by_distance(&gaze)?, gaze)));
            let Some(((name, unit), gaze)) = found else {
                let distance = seen.map_or(String::new(), |gaze| {
                    format!(
                        " (the cameras stand {:.3} to {:.3} units from what they look at)",
                        gaze.nearest, gaze.farthest
                    )
                });
                return Err(unit_unknown(path, &distance));
            };
            notes.push(format!(
                "the unit is not said: taken as {name}, so that the cameras stand {:.0} to {:.0} mm from what they look at \
                 (else --unit)",
                gaze.nearest * unit,
                gaze.farthest * unit
            ));
            Ok(unit)
        }
        (Unit::Unsaid, None) => Err(unit_unknown(path, "")),
        (Unit::Arbitrary, None) => Err(unit_unknown(path, "; it scales the scene as it likes")),
    }
}

fn unit_unknown(path: &Path, more: &str) -> IoError {
    IoError::content(
        path,
        At::FILE,
        format!("the format does not say its unit of length{more}"),
        "give the length of one unit of the calibration: `new --unit m`, cm, mm or a number of millimetres; in the \
         manifest `unit_mm`, 1000 for metres. Measure one distance between cameras if you do not know it",
    )
}

/// Sizes by the names of views; checked against the principal points, which lie near the middle of an image.
fn sizes_from_footage(
    path: &Path,
    cameras: &mut [CameraParts],
    options: &ReadOptions,
    notes: &mut Vec<String>,
) -> Result<(), IoError> {
    let sizes = &options.sizes;
    let same = sizes.iter().all(|(_, size)| *size == sizes[0].1);
    let views: Vec<&str> = sizes.iter().map(|(name, _)| name.as_str()).collect();
    let names: Vec<&str> = cameras.iter().map(|camera| camera.name.as_str()).collect();
    let matched = match_views(&views, &names);
    for (index, camera) in cameras.iter_mut().enumerate().filter(|(_, camera)| camera.size.is_none()) {
        let of_view = matched.as_ref().and_then(|found| found.cameras.iter().position(|&at| at == index));
        let size = match of_view {
            Some(view) => sizes[view].1,
            None if same => sizes[0].1,
            // A camera of no view: its size does not matter, for it is left out.
            None if matched.is_some() => sizes[0].1,
            None => continue,
        };
        let middle = [camera.k[0][2], camera.k[1][2]].map(|c| c / camera.k[2][2]);
        let place = [middle[0] / size[0] as f64, middle[1] / size[1] as f64];
        if of_view.is_some() && !place.iter().all(|share| (0.25..=0.75).contains(share)) {
            let fact = format!(
                "the principal point is ({:.0}, {:.0}), the footage {}×{}: it is not of this size",
                middle[0], middle[1], size[0], size[1]
            );
            let factor = size[0] as f64 / (2.0 * middle[0]);
            let hint = format!(
                "the calibration seems to be of about {:.0}×{:.0}: multiply the first two rows of K by {factor:.4}, or give \
                 the footage in that size",
                2.0 * middle[0],
                2.0 * middle[1]
            );
            return Err(IoError::content(path, At::view(&camera.name), fact, hint));
        }
        camera.size = Some(size);
    }
    notes.push("the file has no image sizes: those of the footage are taken".into());
    Ok(())
}

/// Gravity must be a direction, the frame rate positive.
pub(super) fn check_numbers(path: &Path, gravity: Option<DVec3>, fps: Option<f64>) -> Result<(), IoError> {
    if let Some(g) = gravity.filter(|g| !g.is_finite() || g.length() < 1e-9) {
        let fact = format!("gravity {g} mm/s² is no direction");
        let hint = "give gravity in the world, for example [0, 0, -9.81] m/s²";
        return Err(IoError::content(path, At::FILE, fact, hint));
    }
    if let Some(fps) = fps.filter(|fps| !fps.is_finite() || *fps <= 0.0) {
        let fact = format!("{fps} frames per second is no frame rate");
        return Err(IoError::content(path, At::FILE, fact, "give the frame rate of the videos"));
    }
    Ok(())
}

#[cfg(test)]
#[path = "settle_tests.rs"]
mod tests;
