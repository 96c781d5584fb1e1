use std::path::PathBuf;

use super::*;
use glam::DVec2;
use strandflow_geometry::project::project;

fn data(name: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data")).join(name)
}

#[test]
fn projections_agree_with_opencv() {
    // Expected: cv2.projectPoints of (0.2, 0.15, 0.1) m with eight and five distortion terms, plus half a pixel.
    let eight = DVec2::new(434.782_908_978_018_16, 95.685_466_665_975_64) + 0.5;
    let five = DVec2::new(434.837_863_843_150_1, 95.615_665_352_087_6) + 0.5;
    for (file, count, expected) in
        [("left.yml", 1, eight), ("left.xml", 1, eight), ("rig.yml", 2, five), ("rig.xml", 2, five)]
    {
        let rig = crate::read_calibration(&data(file), Some(1000.0)).unwrap().rig;
        assert_eq!(rig.view_count(), count, "{file}");
        for camera in &rig.cameras {
            let seen = project(camera, DVec3::new(200.0, 150.0, 100.0)).unwrap();
            assert!((seen - expected).length() < 1e-9, "{file} {} {seen}", camera.name);
        }
        assert_eq!(rig.cameras[0].name, if count == 1 { "left" } else { "camA" });
    }
}

#[test]
fn cameras_told_apart_by_suffix_and_lists_of_cameras() {
    let suffixed = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\nK_a: [900, 0, 320, 0, 900, 240, 0, 0, 1]\n\
                    R_a: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nT_a: [0., 0., 2.]\n";
    let cameras = cameras_of(Path::new("c.yml"), &opencv_yaml::parse(suffixed).unwrap()).unwrap();
    assert_eq!((cameras[0].name.as_str(), cameras[0].size), ("a", Some([640, 480])));
    let listed = "cameras:\n  - name: a\n    image_size: [640, 480]\n    K: [900, 0, 320, 0, 900, 240, 0, 0, 1]\n    \
                  rvec: [0, 0, 0]\n    T: [0, 0, 2]\n";
    let cameras = cameras_of(Path::new("c.yml"), &opencv_yaml::parse(listed).unwrap()).unwrap();
    assert_eq!((cameras.len(), cameras[0].name.as_str()), (1, "a"));
}

#[test]
fn missing_parts_are_named() {
    let text = std::fs::read_to_string(data("left.yml")).unwrap();
    for (part, fact) in [("\nT:", "no translation"), ("\nR:", "no rotation"), ("camera_matrix", "no camera matrix")] {
        let named_otherwise = part.replace(['T', 'R'], "Q").replace("camera_matrix", "matrix");
        let root = opencv_yaml::parse(&text.replace(part, &named_otherwise)).unwrap();
        let error = cameras_of(Path::new("left.yml"), &root).unwrap_err().to_string();
        assert!(error.contains(fact), "{part}: {error}");
    }
    let error = crate::read_calibration(&data("left.yml"), None).unwrap_err();
    assert!(error.hint().contains("millimetres"));
}
