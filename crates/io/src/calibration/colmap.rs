//! COLMAP models: cameras and images of either form to a rig. COLMAP's first pixel centre is (0.5, 0.5), as ours.
//!
//! Reference: Schönberger & Frahm 2016; the format of COLMAP's documentation, models of its `sensor/models.h`.

use std::{collections::BTreeMap, path::Path};

use strandflow_core::{Distortion, PolynomialLens};

use super::{
    colmap_binary, colmap_rigs, colmap_text,
    convention::Unit,
    naming::names_of_images,
    parts::{CameraParts, Lens, camera_matrix, rows_from_quaternion},
    settle::Described,
};
use crate::{IoError, error::At};

/// COLMAP's camera models: number, name, and count of parameters.
pub(super) const MODELS: [(i32, &str, usize); 12] = [
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
    (11, "RAD_TAN_THIN_PRISM_FISHEYE", 16),
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
    pub id: u32,
    pub quaternion: [f64; 4],
    pub translation: [f64; 3],
    pub camera: u32,
    pub name: String,
}

/// What a COLMAP folder says, binary if both forms are there. A view is named by its image's folder (`cam00/000000.png`)
/// or, where all images lie in one folder, by the image's name without ending; of several images of one view the first
/// counts. Where the model has rigs and frames, poses are those of the rig.
pub(super) fn described(folder: &Path) -> Result<Described, IoError> {
    let binary = folder.join("images.bin").exists();
    let ending = if binary { "bin" } else { "txt" };
    let file = |part: &str| folder.join(format!("{part}.{ending}"));
    let (cameras_file, images_file) = (file("cameras"), file("images"));
    let (cameras, mut images) = if binary {
        (colmap_binary::cameras(&cameras_file)?, colmap_binary::images(&images_file)?)
    } else {
        (colmap_text::cameras(&cameras_file)?, colmap_text::images(&images_file)?)
    };
    let mut notes = Vec::new();
    if file("rigs").is_file() && file("frames").is_file() {
        let poses = colmap_rigs::poses(&file("rigs"), &file("frames"), binary)?;
        let mut moved = 0;
        for image in &mut images {
            if let Some(pose) = poses.get(&image.id) {
                (image.quaternion, image.translation) = *pose;
                moved += 1;
            }
        }
        if moved > 0 {
            notes.push(format!(
                "the poses of {moved} of {} images are those of the model's rigs and frames",
                images.len()
            ));
        }
    }
    let parts = cameras_of_model(&cameras_file, &images_file, &cameras, images, &mut notes)?;
    Ok(Described { notes, ..Described::opencv("COLMAP", parts, Unit::Unsaid, 0.5) })
}

fn cameras_of_model(
    cameras_file: &Path,
    images_file: &Path,
    cameras: &BTreeMap<u32, ModelCamera>,
    images: Vec<ModelImage>,
    notes: &mut Vec<String>,
) -> Result<Vec<CameraParts>, IoError> {
    let names = names_of_images(&images.iter().map(|image| image.name.as_str()).collect::<Vec<_>>());
    let mut views = BTreeMap::new();
    let mut left_out = 0;
    for (image, view) in images.into_iter().zip(names) {
        if views.contains_key(&view) {
            left_out += 1;
            continue;
        }
        let Some(camera) = cameras.get(&image.camera) else {
            let fact = format!(
                "image {} names camera {}, which {} does not have",
                image.name,
                image.camera,
                cameras_file.display()
            );
            return Err(IoError::content(images_file, At::view(&view), fact, "export the COLMAP model again"));
        };
        let (k, lens) = intrinsics(cameras_file, &view, camera)?;
        let parts = CameraParts {
            name: view.clone(),
            size: Some(camera.size),
            k,
            lens,
            rotation: rows_from_quaternion(image.quaternion),
            translation: image.translation,
        };
        views.insert(view, parts);
    }
    if left_out > 0 {
        notes.push(format!(
            "{left_out} further images of views are left out: of each view the first image's pose counts"
        ));
    }
    Ok(views.into_values().collect())
}

type Intrinsics = ([[f64; 3]; 3], Lens);

fn intrinsics(file: &Path, view: &str, camera: &ModelCamera) -> Result<Intrinsics, IoError> {
    let p = &camera.parameters;
    let refused = |fact: String, hint: &str| Err(IoError::content(file, At::view(view), fact, hint));
    match MODELS.iter().find(|(_, name, _)| *name == camera.model) {
        Some((_, _, count)) if *count != p.len() => {
            let fact = format!("{} has {} parameters instead of {count}", camera.model, p.len());
            return refused(fact, "export the COLMAP model again");
        }
        Some(_) => {}
        None => return refused(format!("the camera model {} is not known", camera.model), SUPPORTED),
    }
    let single = camera_matrix(p[0], p[0], p[1], p[2]);
    let double = || camera_matrix(p[0], p[1], p[2], p[3]);
    let fisheye = |radial, tangential, prism| {
        Lens::Known(Distortion::Polynomial(PolynomialLens { fisheye: true, radial, tangential, prism, skew: 0.0 }))
    };
    Ok(match camera.model.as_str() {
        "SIMPLE_PINHOLE" => (single, Lens::OpenCv(vec![])),
        "PINHOLE" => (double(), Lens::OpenCv(vec![])),
        "SIMPLE_RADIAL" => (single, Lens::OpenCv(vec![p[3]])),
        "RADIAL" => (single, Lens::OpenCv(vec![p[3], p[4]])),
        "OPENCV" | "FULL_OPENCV" => (double(), Lens::OpenCv(p[4..].to_vec())),
        "SIMPLE_RADIAL_FISHEYE" => (single, Lens::Fisheye(vec![p[3]])),
        "RADIAL_FISHEYE" => (single, Lens::Fisheye(vec![p[3], p[4]])),
        "OPENCV_FISHEYE" => (double(), Lens::Fisheye(p[4..].to_vec())),
        "FOV" => (double(), Lens::Known(Distortion::Fov(p[4]))),
        "THIN_PRISM_FISHEYE" => (double(), fisheye([p[4], p[5], p[8], p[9]], [p[6], p[7]], [p[10], p[11]])),
        other => return refused(format!("the camera model {other} is not supported"), SUPPORTED),
    })
}

const SUPPORTED: &str = "calibrate with PINHOLE, RADIAL, OPENCV, FULL_OPENCV, FOV, OPENCV_FISHEYE, RADIAL_FISHEYE, \
                         THIN_PRISM_FISHEYE or a simple form of these, or undistort the images (`colmap image_undistorter`)";

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
    fn the_unit_must_be_given_and_unknown_models_are_refused() {
        assert!(crate::read_calibration(&data("colmap"), None).unwrap_err().hint().contains("1000"));
        let model = |model: &str| ModelCamera { model: model.into(), size: [4, 3], parameters: vec![1.0; 16] };
        for name in ["RAD_TAN_THIN_PRISM_FISHEYE", "DIVISION"] {
            let error = intrinsics(Path::new("cameras.txt"), "cam7", &model(name)).unwrap_err();
            assert!(error.to_string().contains(name) && error.to_string().contains("cam7"));
            assert!(error.hint().contains("image_undistorter"));
        }
    }
}
