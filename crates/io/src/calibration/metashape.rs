//! Agisoft Metashape's cameras as XML: sensors with their calibration, cameras with a transform into the chunk (camera to
//! chunk, OpenCV axes, row major), the chunk's (or its component's) similarity into the world, in metres. The first pixel's
//! centre is (0.5, 0.5), the principal point counts from the image's middle.
//!
//! u = w/2 + cx + x′ f + x′ b1 + y′ b2, v = h/2 + cy + y′ f, with radial terms to r⁸ and p1, p2 the other way round than
//! OpenCV's (Metashape's manual, "Camera models").

use std::{collections::BTreeMap, path::Path};

use glam::{DMat3, DVec3};
use strandflow_core::{Distortion, PolynomialLens};

use super::{
    convention::{Pose, Unit},
    naming::names_of_images,
    parts::{CameraParts, Lens, camera_matrix, pose_of, rotation_from_rows, rows_of},
    settle::Described,
    xml_tree::Element,
};
use crate::{IoError, error::At};

const EXPORT: &str = "export the aligned cameras again: File > Export > Export Cameras, as Agisoft XML";

/// What Metashape's XML says.
pub(super) fn described(path: &Path, document: &Element) -> Result<Described, IoError> {
    let wrong = |line: usize, fact: String| IoError::content(path, At::line(line), fact, EXPORT);
    let root = document.find("document").ok_or_else(|| wrong(1, "is neither OpenCV's nor Metashape's XML".into()))?;
    let mut chunks = root.all("chunk").filter(|chunk| chunk.attribute("enabled") != Some("false"));
    let chunk = chunks.next().ok_or_else(|| wrong(root.line, "holds no chunk".into()))?;
    if let Some(second) = chunks.next() {
        return Err(wrong(second.line, "holds several chunks; export one".into()));
    }
    let mut sensors = BTreeMap::new();
    for sensor in chunk.find("sensors").into_iter().flat_map(|all| all.all("sensor")) {
        sensors.insert(sensor.attribute("id").unwrap_or_default(), sensor);
    }
    let placed = placements(chunk).map_err(|(line, fact)| wrong(line, fact))?;
    let mut found = Vec::new();
    if let Some(all) = chunk.find("cameras") {
        found.extend(all.all("camera"));
        found.extend(all.all("group").flat_map(|group| group.all("camera")));
    }
    let labels: Vec<&str> = found.iter().map(|camera| camera.attribute("label").unwrap_or_default()).collect();
    let (mut cameras, mut notes) = (Vec::new(), Vec::new());
    let mut unplaced = 0;
    for (element, name) in found.iter().zip(names_of_images(&labels)) {
        let Some(transform) = element.find("transform") else {
            if element.attribute("master_id").is_some() {
                let fact = format!("camera {name} is a slave of a multi-camera system, whose offsets are not read");
                return Err(wrong(element.line, fact));
            }
            unplaced += 1;
            continue;
        };
        let numbers = transform.numbers().and_then(|v| pose_of(&v));
        let (rotation, translation) = numbers.ok_or_else(|| wrong(transform.line, "is no 4x4 transform".into()))?;
        let sensor = sensors.get(element.attribute("sensor_id").unwrap_or_default());
        let sensor = sensor.ok_or_else(|| wrong(element.line, format!("camera {name} has no sensor")))?;
        let placement = placed.of(element.attribute("component_id"));
        let (rotation, translation) = placement.moved(rotation, translation);
        let (size, k, lens) = intrinsics(path, sensor)?;
        cameras.push(CameraParts { name, size: Some(size), k, lens, rotation, translation });
    }
    if unplaced > 0 {
        notes.push(format!("{unplaced} cameras that Metashape did not align are left out"));
    }
    let unit = if placed.has_scale { Unit::Customary(1000.0) } else { Unit::Arbitrary };
    Ok(Described { pose: Some(Pose::CameraToWorld), notes, ..Described::opencv("Metashape", cameras, unit, 0.5) })
}

/// A similarity: scale · rotation · x + translation.
#[derive(Clone, Copy)]
struct Placement {
    rotation: DMat3,
    translation: DVec3,
    scale: f64,
}

impl Placement {
    const NONE: Self = Self { rotation: DMat3::IDENTITY, translation: DVec3::ZERO, scale: 1.0 };

    /// A camera's pose in the world; scale moves the camera, not its axes.
    fn moved(&self, rotation: [[f64; 3]; 3], translation: [f64; 3]) -> ([[f64; 3]; 3], [f64; 3]) {
        let axes = self.rotation * DMat3::from_cols_array_2d(&rotation).transpose();
        let place = self.rotation * DVec3::from(translation) * self.scale + self.translation;
        (axes.transpose().to_cols_array_2d(), place.to_array())
    }
}

/// Where the chunk and its components lie in the world.
struct Placements<'a> {
    chunk: Placement,
    components: BTreeMap<&'a str, Placement>,
    has_scale: bool,
}

impl Placements<'_> {
    fn of(&self, component: Option<&str>) -> Placement {
        component.and_then(|id| self.components.get(id)).copied().unwrap_or(self.chunk)
    }
}

type Fault = (usize, String);

fn placements(chunk: &Element) -> Result<Placements<'_>, Fault> {
    let own = chunk.find("transform").map(placement).transpose()?.flatten();
    let mut components = BTreeMap::new();
    for component in chunk.find("components").into_iter().flat_map(|all| all.all("component")) {
        let placement = component.find("transform").map(placement).transpose()?.flatten();
        if let (Some(placement), Some(id)) = (placement, component.attribute("id")) {
            components.insert(id, placement);
        }
    }
    let has_scale = own.is_some() || !components.is_empty();
    Ok(Placements { chunk: own.unwrap_or(Placement::NONE), components, has_scale })
}

/// The similarity of a `<transform>`; `None` where it has none (a chunk that was not scaled).
fn placement(element: &Element) -> Result<Option<Placement>, Fault> {
    let Some(rotation) = element.find("rotation") else { return Ok(None) };
    let rows = rotation.numbers().and_then(|v| rows_of(&v)).and_then(|rows| rotation_from_rows(&rows));
    let rotation = rows.ok_or((rotation.line, "is no rotation".to_owned()))?;
    let translation = element.find("translation").and_then(Element::numbers).unwrap_or_default();
    let translation = <[f64; 3]>::try_from(translation).map_err(|_| (element.line, "has no translation".to_owned()))?;
    let scale = element.number_in("scale").unwrap_or(1.0);
    if !(scale.is_finite() && scale > 0.0) {
        return Err((element.line, format!("has the scale {scale}")));
    }
    Ok(Some(Placement { rotation, translation: DVec3::from(translation), scale }))
}

type Intrinsics = ([usize; 2], [[f64; 3]; 3], Lens);

fn intrinsics(path: &Path, sensor: &Element) -> Result<Intrinsics, IoError> {
    let wrong = |fact: String| IoError::content(path, At::line(sensor.line), fact, EXPORT);
    let adjusted = sensor.all("calibration").find(|all| all.attribute("class") != Some("initial"));
    let calibration = adjusted.or_else(|| sensor.find("calibration"));
    let calibration = calibration.ok_or_else(|| wrong("the sensor is not calibrated".into()))?;
    let kind = calibration.attribute("type").or(sensor.attribute("type")).unwrap_or("frame");
    let fisheye = match kind {
        "frame" => false,
        "fisheye" | "equidistant_fisheye" => true,
        other => {
            let hint = "set the sensor to Frame or Fisheye (equidistant) in Metashape and align again, or undistort the images";
            let fact = format!("sensors of type {other} are not supported");
            return Err(IoError::content(path, At::line(sensor.line), fact, hint));
        }
    };
    let resolution = calibration.find("resolution").or_else(|| sensor.find("resolution"));
    let side = |name| resolution.and_then(|r| r.attribute(name)).and_then(|side| side.trim().parse::<usize>().ok());
    let size =
        [side("width"), side("height")].map(|side| side.ok_or_else(|| wrong("the sensor has no resolution".into())));
    let [width, height] = size;
    let size = [width?, height?];
    let term = |name: &str| calibration.number_in(name).unwrap_or(0.0);
    if term("p3") != 0.0 || term("p4") != 0.0 {
        return Err(wrong("p3 and p4 are not zero, which no other model has".into()));
    }
    let f = calibration.number_in("f").ok_or_else(|| wrong("the calibration has no f".into()))?;
    let middle = [0, 1].map(|axis: usize| size[axis] as f64 * 0.5);
    let k = camera_matrix(f + term("b1"), f, middle[0] + term("cx"), middle[1] + term("cy"));
    let lens = PolynomialLens {
        fisheye,
        radial: ["k1", "k2", "k3", "k4"].map(term),
        tangential: [term("p2"), term("p1")],
        prism: [0.0; 2],
        skew: term("b2") / (f + term("b1")),
    };
    let is_straight = lens == PolynomialLens::default();
    let lens = if is_straight { Lens::OpenCv(vec![]) } else { Lens::Known(Distortion::Polynomial(lens)) };
    Ok((size, k, lens))
}
