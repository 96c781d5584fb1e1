use super::*;

fn parts() -> CameraParts {
    CameraParts {
        name: "camA".into(),
        size: Some([640, 480]),
        k: [[1400.0, 0.0, 320.0], [0.0, 1410.0, 240.0], [0.0, 0.0, 1.0]],
        lens: Lens::OpenCv(vec![]),
        rotation: rows_from_rotation_vector(DVec3::new(0.1, 0.2, 0.3)),
        translation: [0.1, 0.2, 1.5],
    }
}

fn built(parts: CameraParts) -> Result<Camera, IoError> {
    let file = Path::new("rig.json");
    let pose = parts.pose(file, Pose::WorldToCamera, Axes::OpenCv)?;
    parts.build(file, pose, 0.5)
}

#[test]
fn pixels_and_directions_are_converted() {
    let camera = built(parts()).unwrap();
    assert_eq!((camera.principal, camera.distortion), ([320.5, 240.5], Distortion::None));
    let w2c = camera.camera_from_world;
    let inverted = CameraParts {
        rotation: w2c.inverse().rotation.transpose().to_cols_array_2d(),
        translation: w2c.inverse().translation.to_array(),
        ..parts()
    };
    let back = inverted.pose(Path::new("c"), Pose::CameraToWorld, Axes::OpenCv).unwrap();
    let p = DVec3::new(3.0, 4.0, 5.0);
    assert!((back.point(p) - w2c.point(p)).length() < 1e-12);
    let gl = parts().pose(Path::new("c"), Pose::WorldToCamera, Axes::OpenGl).unwrap().point(p);
    assert!((gl - w2c.point(p) * DVec3::new(1.0, -1.0, -1.0)).length() < 1e-12);
}

#[test]
fn unsound_cameras_are_named() {
    type Damage = fn(&mut CameraParts);
    let broken: [(&str, Damage); 9] = [
        ("non-finite", |p| p.translation[1] = f64::NAN),
        ("non-finite", |p| p.lens = Lens::Fisheye(vec![f64::INFINITY])),
        ("image size", |p| p.size = Some([0, 480])),
        ("image size", |p| p.size = None),
        ("focal", |p| p.k[1][1] = -3.0),
        ("skew", |p| p.k[0][1] = 3.0),
        ("not a rotation", |p| p.rotation[0][0] += 0.05),
        ("not a rotation", |p| p.rotation[0] = p.rotation[0].map(|x| -x)),
        ("distortion", |p| p.lens = Lens::OpenCv(vec![0.1; 15])),
    ];
    for (fact, damage) in broken {
        let mut p = parts();
        damage(&mut p);
        let error = built(p).unwrap_err();
        let text = error.to_string();
        assert!(text.contains(fact) && text.contains("rig.json") && text.contains("camA"), "{text}");
        assert!(!error.hint().is_empty());
    }
}

#[test]
fn rounded_rotations_become_exact() {
    let mut p = parts();
    p.rotation.iter_mut().flatten().for_each(|x| *x = (*x * 1e5).round() / 1e5);
    let r = built(p).unwrap().camera_from_world.rotation;
    assert!((r * r.transpose() - DMat3::IDENTITY).to_cols_array().iter().all(|x| x.abs() < 1e-14));
}

#[test]
fn the_smallest_model_is_chosen() {
    let model = |terms: &[f64]| opencv_distortion(terms);
    assert_eq!(model(&[0.0; 5]), Distortion::None);
    assert!(matches!(model(&[0.1]), Distortion::BrownConrady([0.1, ..])));
    assert!(matches!(model(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-3]), Distortion::Tilted(_)));
}
