use super::*;
use crate::calibration::{
    Convention,
    parts::{camera_matrix, rows_from_rotation_vector},
};

/// Cameras around a head, as `pose` and `axes` have them, 1.2 units away.
fn ring(count: usize, pose: Pose, axes: Axes) -> Described {
    let camera = |i: usize| {
        let rotation = rows_from_rotation_vector(DVec3::new(0.1, 0.8 * i as f64, 0.05));
        let parts = CameraParts {
            name: format!("cam{i}"),
            size: None,
            k: camera_matrix(900.0, 900.0, 320.0, 240.0),
            lens: Lens::OpenCv(vec![]),
            rotation,
            translation: [0.01, -0.02, 1.2],
        };
        // `pose` reads world to camera; turned twice it is what it was.
        let there = parts.pose(Path::new("r"), pose, Axes::OpenCv).unwrap();
        let there = match (pose, axes) {
            (_, Axes::OpenCv) => there,
            (Pose::WorldToCamera, Axes::OpenGl) => parts.pose(Path::new("r"), pose, axes).unwrap(),
            (Pose::CameraToWorld, Axes::OpenGl) => {
                parts.pose(Path::new("r"), Pose::WorldToCamera, axes).unwrap().inverse()
            }
        };
        CameraParts {
            rotation: there.rotation.transpose().to_cols_array_2d(),
            translation: there.translation.to_array(),
            ..parts
        }
    };
    let cameras = (0..count).map(camera).collect();
    Described { pose: None, axes: None, ..Described::opencv("test", cameras, Unit::Unsaid, 0.5) }
}

fn sized(size: [usize; 2]) -> ReadOptions {
    ReadOptions { guess_unit: true, sizes: vec![("cam0".into(), size)], ..ReadOptions::default() }
}

#[test]
fn the_rig_tells_directions_axes_and_unit() {
    for pose in [Pose::WorldToCamera, Pose::CameraToWorld] {
        for axes in [Axes::OpenCv, Axes::OpenGl] {
            let read = settle(Path::new("r"), ring(4, pose, axes), &sized([640, 480])).unwrap();
            let told = in_words((pose, axes));
            assert!(read.notes.iter().any(|note| note.contains(told)), "{told}: {:?}", read.notes);
            for camera in &read.rig.cameras {
                let there = camera.camera_from_world.translation;
                assert!((there - DVec3::new(10.0, -20.0, 1200.0)).length() < 1e-9, "{told}: {there}");
            }
        }
    }
}

#[test]
fn two_parallel_cameras_are_asked_about_and_the_answer_is_taken() {
    let mut file = ring(2, Pose::WorldToCamera, Axes::OpenCv);
    file.cameras[1].rotation = file.cameras[0].rotation;
    file.cameras[1].translation[0] = 0.3;
    let error = settle(Path::new("r"), file.clone(), &sized([640, 480])).unwrap_err();
    assert!(error.hint().contains("--convention") && error.hint().contains("c2w"), "{}", error.hint());
    let convention = "w2c,opencv".parse::<Convention>().unwrap();
    let told = ReadOptions { convention, unit_mm: Some(10.0), ..sized([640, 480]) };
    let read = settle(Path::new("r"), file, &told).unwrap();
    assert!((read.rig.cameras[1].camera_from_world.translation.x - 3.0).abs() < 1e-12);
}

#[test]
fn footage_of_another_size_than_the_principal_point_says_is_refused_with_the_factor() {
    let error = settle(Path::new("r"), ring(4, Pose::WorldToCamera, Axes::OpenCv), &sized([1920, 1440])).unwrap_err();
    assert!(error.to_string().contains("not of this size"), "{error}");
    assert!(error.hint().contains("3.0000") && error.hint().contains("640×480"), "{}", error.hint());
}

#[test]
fn a_thousand_and_one_cameras_are_no_rig() {
    let file = ring(1001, Pose::WorldToCamera, Axes::OpenCv);
    assert!(settle(Path::new("r"), file, &sized([640, 480])).unwrap_err().to_string().contains("1001 cameras"));
}

#[test]
fn what_was_said_overrules_what_a_format_usually_means() {
    // One camera tells nothing of its convention.
    let file =
        Described { fallback: Some((Pose::WorldToCamera, Axes::OpenCv)), ..ring(1, Pose::WorldToCamera, Axes::OpenCv) };
    let read = |pose: Option<Pose>| {
        let convention = Convention { pose, ..Convention::default() };
        let options = ReadOptions { convention, ..ReadOptions::default() };
        poses_of(Path::new("r"), &file, &options, &mut Vec::new()).unwrap().swap_remove(0)
    };
    let (usual, told) = (read(None), read(Some(Pose::CameraToWorld)));
    let off = told.after(&usual).point(DVec3::new(1.0, 2.0, 3.0)) - DVec3::new(1.0, 2.0, 3.0);
    assert!(off.length() < 1e-9, "{off}");
}
