//! NeRSemble's `camera_params.json`: `world_2_cam`, a 4×4 matrix by serial number, and `intrinsics`, one 3×3 matrix for all or
//! one by serial number. Neither axes nor unit nor image size are said: the rig tells the first two, the footage the last.

use std::path::Path;

use serde_json::Value;

use super::{
    convention::{Axes, Pose, Unit},
    json_tree::numbers,
    parts::{CameraParts, Lens, pose_of, rows_of},
    settle::Described,
};
use crate::{IoError, error::At};

/// What a `camera_params.json` says.
pub(super) fn described(path: &Path, file: &Value) -> Result<Described, IoError> {
    let hint = "give NeRSemble's camera_params.json: world_2_cam (4x4 by serial number) and intrinsics (3x3)";
    let wrong = |at: At, fact: &str| IoError::content(path, at, fact, hint);
    let poses = file.get("world_2_cam").and_then(Value::as_object);
    let poses = poses.ok_or_else(|| wrong(At::FILE, "`world_2_cam` is no map from camera to matrix"))?;
    let intrinsics = file.get("intrinsics");
    let mut cameras = Vec::new();
    for (serial, matrix) in poses {
        let (rotation, translation) = numbers(matrix)
            .and_then(|v| pose_of(&v))
            .ok_or_else(|| wrong(At::view(serial), "`world_2_cam` is no 4x4 matrix"))?;
        let own = intrinsics.and_then(|all| if all.is_object() { all.get(serial) } else { Some(all) });
        let k = own
            .and_then(numbers)
            .and_then(|v| rows_of(&v))
            .ok_or_else(|| wrong(At::view(serial), "`intrinsics` is no 3x3 matrix"))?;
        let lens = Lens::OpenCv(vec![]);
        cameras.push(CameraParts { name: serial.clone(), size: None, k, lens, rotation, translation });
    }
    Ok(Described {
        pose: Some(Pose::WorldToCamera),
        axes: None,
        fallback: Some((Pose::WorldToCamera, Axes::OpenCv)),
        ..Described::opencv("NeRSemble", cameras, Unit::Unsaid, 0.0)
    })
}
