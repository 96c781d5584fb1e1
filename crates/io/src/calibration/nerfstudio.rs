//! Nerfstudio's `transforms.json` (and NeRF's, which has `camera_angle_x` only): poses camera to world, OpenGL axes, first
//! pixel centre (0.5, 0.5). Intrinsics stand beside the frames for all, or in a frame for itself.
//!
//! `applied_transform` and `applied_scale`, which the file's poses hold already, are undone: the world is that of the
//! calibration behind the file. The scale of the scene is arbitrary.

use std::{collections::BTreeSet, path::Path};

use glam::{DMat3, DVec3};
use serde_json::Value;
use strandflow_core::{Distortion, PolynomialLens, RigidTransform};

use super::{
    ReadOptions,
    convention::{Axes, Pose, Unit},
    json_tree::{number, numbers},
    naming::names_of_images,
    parts::{CameraParts, Lens, camera_matrix, pose_of, rotation_from_rows},
    settle::Described,
};
use crate::{IoError, error::At};

/// What a `transforms.json` says.
pub(super) fn described(path: &Path, file: &Value, options: &ReadOptions) -> Result<Described, IoError> {
    let wrong = |fact: String, hint: &str| IoError::content(path, At::FILE, fact, hint);
    let frames = file.get("frames").and_then(Value::as_array).filter(|frames| !frames.is_empty());
    let frames = frames.ok_or_else(|| wrong("has no `frames`".into(), "export transforms.json again"))?;
    let paths: Vec<&str> =
        frames.iter().map(|frame| frame.get("file_path").and_then(Value::as_str).unwrap_or_default()).collect();
    let applied = applied(path, file)?;
    let mut notes = Vec::new();
    if applied.is_some() {
        notes.push(
            "applied_transform and applied_scale are undone: the world is that of the original calibration".to_owned(),
        );
    }
    let (mut seen, mut cameras) = (BTreeSet::new(), Vec::new());
    for (frame, name) in frames.iter().zip(names_of_images(&paths)) {
        if name.is_empty() {
            return Err(wrong("a frame has no `file_path`".into(), "give every frame the path of its image"));
        }
        if seen.insert(name.clone()) {
            cameras.push(camera(path, &name, frame, file, applied.as_ref(), options)?);
        }
    }
    if cameras.len() < frames.len() {
        let left_out = frames.len() - cameras.len();
        notes.push(format!(
            "{left_out} further frames of views are left out: of each view the first frame's pose counts"
        ));
    }
    Ok(Described {
        pose: Some(Pose::CameraToWorld),
        axes: Some(Axes::OpenGl),
        notes,
        ..Described::opencv("Nerfstudio", cameras, Unit::Arbitrary, 0.5)
    })
}

/// saved = scale (rotation · original + translation).
struct Applied {
    transform: RigidTransform,
    scale: f64,
}

fn applied(path: &Path, file: &Value) -> Result<Option<Applied>, IoError> {
    let wrong = |fact: &str| {
        let hint = "give a rotation and a translation (3x4) and a positive scale, or leave both out";
        IoError::content(path, At::FILE, fact, hint)
    };
    let transform = match file.get("applied_transform") {
        None => RigidTransform::IDENTITY,
        Some(value) => {
            let (rows, translation) = numbers(value)
                .and_then(|v| pose_of(&v))
                .ok_or_else(|| wrong("`applied_transform` is no 3x4 matrix"))?;
            let rotation = rotation_from_rows(&rows).ok_or_else(|| wrong("`applied_transform` is no rotation"))?;
            RigidTransform { rotation, translation: DVec3::from(translation) }
        }
    };
    let scale = number(file, "applied_scale").unwrap_or(1.0);
    if !(scale.is_finite() && scale > 0.0) {
        return Err(wrong("`applied_scale` is not positive"));
    }
    let is_none = transform == RigidTransform::IDENTITY && scale == 1.0;
    Ok((!is_none).then_some(Applied { transform, scale }))
}

fn camera(
    path: &Path,
    name: &str,
    frame: &Value,
    file: &Value,
    applied: Option<&Applied>,
    options: &ReadOptions,
) -> Result<CameraParts, IoError> {
    let wrong = |fact: String, hint: &str| IoError::content(path, At::view(name), fact, hint);
    let get = |key: &str| number(frame, key).or_else(|| number(file, key));
    let (mut rotation, mut translation) = frame
        .get("transform_matrix")
        .and_then(numbers)
        .and_then(|v| pose_of(&v))
        .ok_or_else(|| wrong("has no 4x4 `transform_matrix`".into(), "export transforms.json again"))?;
    if let Some(Applied { transform, scale }) = applied {
        let back = transform.rotation.transpose();
        let pose = DMat3::from_cols_array_2d(&rotation).transpose();
        rotation = (back * pose).transpose().to_cols_array_2d();
        translation = (back * (DVec3::from(translation) / *scale - transform.translation)).to_array();
    }
    let size = get("w").zip(get("h")).map(|(w, h)| [w as usize, h as usize]).or_else(|| size_of_footage(name, options));
    let middle = |axis: usize| size.map(|size| size[axis] as f64 * 0.5);
    let from_angle = |key: &str, axis: usize| Some(middle(axis)? / (get(key)? * 0.5).tan());
    let no_focal = || {
        let hint = "give fl_x (and fl_y), or camera_angle_x with w and h";
        wrong("has no focal length, or an angle without image size".into(), hint)
    };
    let fx = get("fl_x").or_else(|| from_angle("camera_angle_x", 0)).ok_or_else(no_focal)?;
    let fy = get("fl_y").or_else(|| from_angle("camera_angle_y", 1)).unwrap_or(fx);
    let centre = |key: &str, axis| {
        get(key).or_else(|| middle(axis)).ok_or_else(|| wrong(format!("has neither {key} nor w and h"), "add them"))
    };
    let lens = lens(path, name, frame, file)?;
    let k = camera_matrix(fx, fy, centre("cx", 0)?, centre("cy", 1)?);
    Ok(CameraParts { name: name.to_owned(), size, k, lens, rotation, translation })
}

fn size_of_footage(name: &str, options: &ReadOptions) -> Option<[usize; 2]> {
    let sizes = &options.sizes;
    let own = sizes.iter().find(|(view, _)| view == name).map(|(_, size)| *size);
    own.or_else(|| sizes.first().map(|(_, size)| *size).filter(|first| sizes.iter().all(|(_, size)| size == first)))
}

fn lens(path: &Path, name: &str, frame: &Value, file: &Value) -> Result<Lens, IoError> {
    let get = |key: &str| number(frame, key).or_else(|| number(file, key)).unwrap_or(0.0);
    let text = |key: &str| frame.get(key).or_else(|| file.get(key));
    let is_fisheye = text("is_fisheye").and_then(Value::as_bool).unwrap_or(false);
    let model =
        text("camera_model").and_then(Value::as_str).unwrap_or(if is_fisheye { "OPENCV_FISHEYE" } else { "OPENCV" });
    let radial = ["k1", "k2", "k3", "k4"].map(get);
    let [p1, p2] = ["p1", "p2"].map(get);
    Ok(match model {
        "SIMPLE_PINHOLE" | "PINHOLE" => Lens::OpenCv(vec![]),
        // The fourth radial term, which OpenCV has not, multiplies r⁸.
        "SIMPLE_RADIAL" | "RADIAL" | "OPENCV" if radial[3] != 0.0 => {
            let lens = PolynomialLens { radial, tangential: [p1, p2], ..PolynomialLens::default() };
            Lens::Known(Distortion::Polynomial(lens))
        }
        "SIMPLE_RADIAL" | "RADIAL" | "OPENCV" => Lens::OpenCv(vec![radial[0], radial[1], p1, p2, radial[2]]),
        "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE" | "OPENCV_FISHEYE" => Lens::Fisheye(radial.to_vec()),
        other => {
            return Err(IoError::content(
                path,
                At::view(name),
                format!("the camera model {other} is not supported"),
                "undistort the images to PINHOLE, or calibrate with OPENCV or OPENCV_FISHEYE",
            ));
        }
    })
}
