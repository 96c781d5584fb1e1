//! COLMAP's rigs and frames, text or binary: the pose of an image is that of its sensor in the rig after that of the rig in
//! the world.
//!
//! `rigs`: RIG_ID NUM_SENSORS REF_TYPE REF_ID, then per sensor TYPE ID HAS_POSE and, with a pose, QW QX QY QZ TX TY TZ;
//! `frames`: FRAME_ID RIG_ID QW QX QY QZ TX TY TZ COUNT, then per datum TYPE SENSOR_ID DATA_ID (an image's number).

use std::{collections::BTreeMap, path::Path};

use glam::{DQuat, DVec3};
use strandflow_core::RigidTransform;

use super::{
    colmap_text::{parse, wrong},
    dispatch::{read_model, text_of},
    parts::{rotation_from_rows, rows_from_quaternion},
};
use crate::{IoError, bytes::Bytes, error::At};

/// Quaternion (w, x, y, z) and translation.
pub(super) type FilePose = ([f64; 4], [f64; 3]);

/// Poses of sensors by rig and camera; none for a camera whose pose in the rig is not known.
type Sensors = BTreeMap<(u32, u32), Option<FilePose>>;

/// A frame: its rig, the rig's pose, and camera and image of each picture.
struct Frame {
    rig: u32,
    pose: FilePose,
    images: Vec<(u32, u32)>,
}

/// World to camera by image number, for images whose sensor has a pose in its rig.
pub(super) fn poses(rigs: &Path, frames: &Path, binary: bool) -> Result<BTreeMap<u32, FilePose>, IoError> {
    let (sensors, frames) = if binary {
        (
            sensors_from_bytes(&read_model(rigs)?).ok_or_else(|| cut(rigs))?,
            frames_from_bytes(&read_model(frames)?).ok_or_else(|| cut(frames))?,
        )
    } else {
        (
            sensors_from_text(rigs, &text_of(rigs, read_model(rigs)?)?)?,
            frames_from_text(frames, &text_of(frames, read_model(frames)?)?)?,
        )
    };
    let mut poses = BTreeMap::new();
    for frame in frames {
        for (camera, image) in &frame.images {
            let sensor = sensors.get(&(frame.rig, *camera)).copied().flatten();
            if let Some(pose) = sensor.and_then(|sensor| combined(sensor, frame.pose)) {
                poses.insert(*image, pose);
            }
        }
    }
    Ok(poses)
}

fn cut(file: &Path) -> IoError {
    IoError::content(file, At::FILE, "ends too early or is no COLMAP model", "export or copy the COLMAP model again")
}

/// `sensor` after `rig`; `None` where one is no pose.
fn combined(sensor: FilePose, rig: FilePose) -> Option<FilePose> {
    let pose = |(q, t): FilePose| {
        Some(RigidTransform { rotation: rotation_from_rows(&rows_from_quaternion(q))?, translation: DVec3::from(t) })
    };
    let both = pose(sensor)?.after(&pose(rig)?);
    let q = DQuat::from_mat3(&both.rotation);
    Some(([q.w, q.x, q.y, q.z], both.translation.to_array()))
}

const IDENTITY: FilePose = ([1.0, 0.0, 0.0, 0.0], [0.0; 3]);

/// COLMAP's number of a camera among kinds of sensors.
const CAMERA: i32 = 0;

fn sensors_from_bytes(data: &[u8]) -> Option<Sensors> {
    let mut bytes = Bytes::new(data);
    let mut sensors = Sensors::new();
    for _ in 0..bytes.u64()? {
        let (rig, count) = (bytes.u32()?, bytes.u32()?);
        for index in 0..count {
            let (kind, id) = (bytes.i32()?, bytes.u32()?);
            let pose = match index {
                0 => Some(IDENTITY),
                _ if bytes.take(1)? == [0] => None,
                _ => Some(pose_from_bytes(&mut bytes)?),
            };
            if kind == CAMERA {
                sensors.insert((rig, id), pose);
            }
        }
    }
    Some(sensors)
}

fn frames_from_bytes(data: &[u8]) -> Option<Vec<Frame>> {
    let mut bytes = Bytes::new(data);
    let mut frames = Vec::new();
    for _ in 0..bytes.u64()? {
        let (_frame, rig) = (bytes.u32()?, bytes.u32()?);
        let pose = pose_from_bytes(&mut bytes)?;
        let mut images = Vec::new();
        for _ in 0..bytes.u32()? {
            let (kind, camera, image) = (bytes.i32()?, bytes.u32()?, bytes.u64()?);
            if let (CAMERA, Ok(image)) = (kind, u32::try_from(image)) {
                images.push((camera, image));
            }
        }
        frames.push(Frame { rig, pose, images });
    }
    Some(frames)
}

fn pose_from_bytes(bytes: &mut Bytes<'_>) -> Option<FilePose> {
    let q = [bytes.f64()?, bytes.f64()?, bytes.f64()?, bytes.f64()?];
    Some((q, [bytes.f64()?, bytes.f64()?, bytes.f64()?]))
}

fn sensors_from_text(file: &Path, text: &str) -> Result<Sensors, IoError> {
    let mut sensors = Sensors::new();
    for (line, text) in content(text) {
        let mut words = text.split_whitespace();
        let rig = parse(file, line, words.next(), "rig number")?;
        let count: u32 = parse(file, line, words.next(), "number of sensors")?;
        for index in 0..count {
            let kind = words.next().ok_or_else(|| wrong(file, line, "a sensor is missing"))?;
            let id = parse(file, line, words.next(), "sensor number")?;
            let pose = match index {
                0 => Some(IDENTITY),
                _ if parse::<u8>(file, line, words.next(), "flag of a pose")? == 0 => None,
                _ => Some(pose_from_words(file, line, &mut words)?),
            };
            if kind == "CAMERA" {
                sensors.insert((rig, id), pose);
            }
        }
    }
    Ok(sensors)
}

fn frames_from_text(file: &Path, text: &str) -> Result<Vec<Frame>, IoError> {
    let mut frames = Vec::new();
    for (line, text) in content(text) {
        let mut words = text.split_whitespace();
        let _frame: u32 = parse(file, line, words.next(), "frame number")?;
        let rig = parse(file, line, words.next(), "rig number")?;
        let pose = pose_from_words(file, line, &mut words)?;
        let mut images = Vec::new();
        for _ in 0..parse::<u32>(file, line, words.next(), "number of images")? {
            let kind = words.next().ok_or_else(|| wrong(file, line, "an image is missing"))?;
            let camera = parse(file, line, words.next(), "sensor number")?;
            let image: u64 = parse(file, line, words.next(), "image number")?;
            if let ("CAMERA", Ok(image)) = (kind, u32::try_from(image)) {
                images.push((camera, image));
            }
        }
        frames.push(Frame { rig, pose, images });
    }
    Ok(frames)
}

fn pose_from_words<'a>(
    file: &Path,
    line: usize,
    words: &mut impl Iterator<Item = &'a str>,
) -> Result<FilePose, IoError> {
    let mut numbers = [0.0; 7];
    for number in &mut numbers {
        *number = parse(file, line, words.next(), "pose")?;
    }
    let [w, x, y, z, tx, ty, tz] = numbers;
    Ok(([w, x, y, z], [tx, ty, tz]))
}

/// Lines (from 1) that are neither empty nor comments.
fn content(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let lines = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}
