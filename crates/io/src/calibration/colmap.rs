//! COLMAP models: cameras and images of either form to a rig. COLMAP's first pixel centre is (0.5, 0.5), as ours.
//!
//! Reference: Schönberger & Frahm 2016; the format of COLMAP's documentation, models of its `sensor/models.h`.

use std::{collections::BTreeMap, path::Path};

use strandflow_core::Rig;

use super::{Calibration, CameraParts, colmap_binary, colmap_text, required_unit, rows_from_quaternion};
use crate::{IoError, error::At};

/// The camera models that are read: COLMAP's number, name, and count of parameters.
pub(super) const MODELS: [(i32, &str, usize); 11] = [
    (0, "SIMPLE_PINHOLE", 3),
    (1, "PINHOLE", 4),
    (2, "SIMPLE_RADIAL", 4),
    (3, "RADIAL", 5),
    (4, "OPENCV", 8),
    (5, "OPENCV_FISHEYE", 8),
    (6, "FULL_OPENCV", 12),
    (7, "FOV", 5),
    (8, "SIMPLE_RADIAL_FISHEYE", 4),
    (9, "RADIAL_FISHEYE", 5),
    (10, "THIN_PRISM_FISHEYE", 12),
];

/// An entry of `cameras`.
#[derive(Clone, Debug)]
pub(super) struct ModelCamera {
    pub model: String,
    pub size: [usize; 2],
    pub parameters: Vec<f64>,
}

/// An entry of `images`.
#[derive(Clone, Debug)]
pub(super) struct ModelImage {
    pub quaternion: [f64; 4],
    pub translation: [f64; 3],
    pub camera: u32,
    pub name: String,
}

/// Reads a COLMAP folder, binary if both forms are there. A view is named by its image's folder (`cam00/000000.png`) or,
/// without one, by the image's name without ending; of several images of one view the first counts.
///
/// # Errors
/// Files are missing or broken (with the line of a text file), a camera model is not supported, an image's camera is
/// missing, the unit is not given, or a camera is not sound.
pub fn read_colmap(folder: &Path, unit_mm: Option<f64>) -> Result<Calibration, IoError> {
    let binary = folder.join("images.bin").exists();
    let ending = if binary { "bin" } else { "txt" };
    let (cameras_file, images_file) =
        (folder.join(format!("cameras.{ending}")), folder.join(format!("images.{ending}")));
    let (cameras, images) = if binary {
        (colmap_binary::cameras(&cameras_file)?, colmap_binary::images(&images_file)?)
    } else {
        (colmap_text::cameras(&cameras_file)?, colmap_text::images(&images_file)?)
    };
    rig_of_model(&cameras_file, &images_file, &cameras, images, required_unit(folder, unit_mm)?)
}

fn rig_of_model(
    cameras_file: &Path,
    images_file: &Path,
    cameras: &BTreeMap<u32, ModelCamera>,
    images: Vec<ModelImage>,
    unit_mm: f64,
) -> Result<Calibration, IoError> {
    let mut views = BTreeMap::new();
    let mut notes = Vec::new();
    for image in images {
        let view = view_name(&image.name);
        if views.contains_key(&view) {
            notes.push(format!("view {view}: image {} is left out, the first one's pose counts", image.name));
            continue;
        }
        let Some(camera) = cameras.get(&image.camera) else {
            return Err(IoError::content(
                images_file,
                At::view(&view),
                format!(
                    "image {} names camera {}, which {} does not have",
                    image.name,
                    image.camera,
                    cameras_file.display()
                ),
                "export the COLMAP model again",
            ));
        };
        let (k, distortion) = intrinsics(cameras_file, &view, camera)?;
        let parts = CameraParts {
            name: view.clone(),
            size: camera.size,
            k,
            distortion,
            rotation: rows_from_quaternion(image.quaternion),
            translation: image.translation,
            unit_mm,
            pixel_shift: 0.0,
        };
        views.insert(view, parts.build(images_file)?);
    }
    Ok(Calibration { rig: Rig { cameras: views.into_values().collect() }, gravity: None, fps: None, notes })
}

fn view_name(image: &str) -> String {
    let path = Path::new(image);
    let folder = path.parent().and_then(|parent| parent.file_name());
    let stem = path.file_stem().unwrap_or_default();
    folder.unwrap_or(stem).to_string_lossy().into_owned()
}

type Intrinsics = ([[f64; 3]; 3], Vec<f64>);

fn intrinsics(file: &Path, view: &str, camera: &ModelCamera) -> Result<Intrinsics, IoError> {
    let p = &camera.parameters;
    let expected = MODELS.iter().find(|(_, name, _)| *name == camera.model).map(|(_, _, count)| *count);
    if expected.is_some_and(|count| count != p.len()) {
        let fact = format!("{} has {} parameters instead of {}", camera.model, p.len(), expected.unwrap_or(0));
        return Err(IoError::content(file, At::view(view), fact, "export the COLMAP model again"));
    }
    let k = |fx: f64, fy: f64, cx: f64, cy: f64| [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]];
    Ok(match camera.model.as_str() {
        "SIMPLE_PINHOLE" => (k(p[0], p[0], p[1], p[2]), vec![]),
        "PINHOLE" => (k(p[0], p[1], p[2], p[3]), vec![]),
        "SIMPLE_RADIAL" => (k(p[0], p[0], p[1], p[2]), vec![p[3]]),
        "RADIAL" => (k(p[0], p[0], p[1], p[2]), vec![p[3], p[4]]),
        "OPENCV" | "FULL_OPENCV" => (k(p[0], p[1], p[2], p[3]), p[4..].to_vec()),
        other => {
            return Err(IoError::content(
                file,
                At::view(view),
                format!("the camera model {other} is not supported"),
                "calibrate with SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV or FULL_OPENCV, or undistort the \
                 images (`colmap image_undistorter`)",
            ));
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec2, DVec3};
    use strandflow_geometry::project::project;

    fn data(name: &str) -> std::path::PathBuf {
        Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data")).join(name)
    }

    #[test]
    fn text_binary_and_json_see_the_same_point_in_the_same_place() {
        let json = crate::read_calibration(&data("rig.json"), None).unwrap();
        let text = crate::read_calibration(&data("colmap"), Some(1000.0)).unwrap();
        let binary = crate::read_calibration(&data("colmap_binary"), Some(1000.0)).unwrap();
        // Expected by numpy: K (R x + t), x in metres.
        let expected =
            [[343.717_277_560_661_8, 202.791_436_519_036_8], [326.106_052_683_516_6, 203.025_592_777_205_87]];
        for rig in [json.rig, text.rig, binary.rig] {
            assert_eq!(rig.view_count(), 2);
            for (camera, uv) in rig.cameras.iter().zip(expected) {
                let seen = project(camera, DVec3::new(30.0, -20.0, 50.0)).unwrap();
                assert!((seen - DVec2::from(uv)).length() < 1e-9, "{} {seen}", camera.name);
            }
        }
    }

    #[test]
    fn the_unit_must_be_given_and_fisheyes_are_refused() {
        assert!(read_colmap(&data("colmap"), None).unwrap_err().hint().contains("1000"));
        let camera = ModelCamera { model: "OPENCV_FISHEYE".into(), size: [4, 3], parameters: vec![1.0; 8] };
        let error = intrinsics(Path::new("cameras.txt"), "cam7", &camera).unwrap_err();
        assert!(error.to_string().contains("OPENCV_FISHEYE") && error.to_string().contains("cam7"));
    }

    #[test]
    fn views_are_named_by_folder_or_stem() {
        assert_eq!((view_name("cam00/000000.png"), view_name("left.jpg")), ("cam00".into(), "left".into()));
    }
}
