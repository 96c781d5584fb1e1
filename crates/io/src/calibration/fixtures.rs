//! Every dialect on a file as the other program writes it: one world point must land on the pixels that OpenCV and numpy
//! computed (`tools/calibration_fixtures.py` made the files and `expected.json`).

use std::{collections::BTreeMap, path::PathBuf};

use glam::{DVec2, DVec3};
use serde::Deserialize;
use strandflow_geometry::project::project;

use super::*;

#[derive(Deserialize)]
struct Expected {
    point_mm: [f64; 3],
    files: Vec<File>,
}

#[derive(Deserialize)]
struct File {
    path: String,
    unit_mm: Option<f64>,
    sized: bool,
    convention: String,
    cameras: BTreeMap<String, [f64; 2]>,
}

fn data(name: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/dialects")).join(name)
}

fn options(file: &File) -> ReadOptions {
    let convention = if file.convention.is_empty() { Convention::default() } else { file.convention.parse().unwrap() };
    let sizes = file.cameras.keys().map(|name| (name.clone(), [640, 480]));
    let sizes = if file.sized { Vec::new() } else { sizes.collect() };
    ReadOptions { unit_mm: file.unit_mm, convention, sizes, guess_unit: false }
}

fn expected() -> Expected {
    serde_json::from_slice(&std::fs::read(data("expected.json")).unwrap()).unwrap()
}

#[test]
fn the_known_point_lands_on_the_known_pixels() {
    let all = expected();
    assert!(all.files.len() >= 20);
    for file in &all.files {
        let read =
            read_calibration_with(&data(&file.path), &options(file)).unwrap_or_else(|e| panic!("{e}\n{}", e.hint()));
        assert_eq!(read.rig.view_count(), file.cameras.len(), "{}", file.path);
        for camera in &read.rig.cameras {
            assert_eq!([camera.width, camera.height], [640, 480]);
            let seen = project(camera, DVec3::from(all.point_mm)).unwrap();
            let off = seen.distance(DVec2::from(file.cameras[&camera.name]));
            assert!(off < 1e-8, "{} {}: {seen}, off by {off:e}", file.path, camera.name);
        }
    }
}

#[test]
fn what_is_missing_is_asked_for_by_name() {
    for file in &expected().files {
        if file.unit_mm.is_some() {
            let unsaid = ReadOptions { unit_mm: None, ..options(file) };
            let hint = read_calibration_with(&data(&file.path), &unsaid).unwrap_err().hint();
            assert!(hint.contains("--unit"), "{}: {hint}", file.path);
        }
        if !file.sized {
            let unsized_ = ReadOptions { sizes: Vec::new(), ..options(file) };
            let error = read_calibration_with(&data(&file.path), &unsized_).unwrap_err();
            assert!(error.to_string().contains("image") || error.to_string().contains("w and h"), "{error}");
        }
    }
}

#[test]
fn metres_are_told_by_the_distance_of_the_cameras_unless_the_scale_is_arbitrary() {
    for file in &expected().files {
        let guess = ReadOptions { unit_mm: None, guess_unit: true, ..options(file) };
        let read = read_calibration_with(&data(&file.path), &guess);
        let scaled_at_will = ["nerf", "cameras_sphere"].iter().any(|name| file.path.contains(name));
        if scaled_at_will {
            assert!(read.unwrap_err().hint().contains("--unit"), "{}", file.path);
            continue;
        }
        let read = read.unwrap();
        let away = read.rig.cameras[0].camera_from_world.translation.length();
        assert!((away - 1100.0).abs() < 20.0, "{}: {away}", file.path);
        if file.unit_mm.is_some() {
            assert!(read.notes.iter().any(|note| note.contains("taken as metres")), "{}: {:?}", file.path, read.notes);
        }
    }
}

#[test]
fn files_are_told_by_content_when_their_names_do_not_tell() {
    let dir = tempfile::tempdir().unwrap();
    for (file, as_name) in [("opencv_k12.json", "rig.txt"), ("metashape.xml", "rig"), ("cameras_sphere.npz", "rig.dat")]
    {
        let path = dir.path().join(as_name);
        std::fs::copy(data(file), &path).unwrap();
        let all = expected();
        let file = all.files.iter().find(|known| known.path == file).unwrap();
        assert_eq!(read_calibration_with(&path, &options(file)).unwrap().rig.view_count(), 3, "{as_name}");
    }
}
