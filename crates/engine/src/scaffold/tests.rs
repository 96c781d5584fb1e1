use super::*;
use strandflow_core::RgbImage;
use strandflow_io::{calibration::named_unit, write_rgb_png};

/// The fixtures of calibrations, which another crate keeps.
fn dialect(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../io/tests/data/dialects").join(name)
}

fn image(path: &Path, size: [usize; 2]) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    write_rgb_png(path, &RgbImage::filled(size[0], size[1], [90; 3])).unwrap();
}

/// A capture of three views; `frame` and `plate` give the paths by view and frame.
fn capture(
    root: &Path,
    size: [usize; 2],
    frame: impl Fn(usize, usize) -> String,
    plate: impl Fn(usize) -> String,
) -> PathBuf {
    let folder = root.join("capture");
    for view in 0..3 {
        for t in 0..2 {
            image(&folder.join(frame(view, t)), size);
        }
        image(&folder.join(plate(view)), size);
    }
    folder
}

fn usual(root: &Path, size: [usize; 2]) -> PathBuf {
    capture(root, size, |v, t| format!("images/cam{v:02}/{t:06}.png"), |v| format!("clean/cam{v:02}.png"))
}

fn asked(root: &Path, capture: PathBuf, calibration: &str) -> NewTake {
    let calibration = Some(dialect(calibration));
    NewTake { take: root.join("take"), capture, calibration, fps: Some(50.0), ..NewTake::default() }
}

fn rig(asked: &NewTake) -> strandflow_core::Rig {
    crate::sources::read_rig(&asked.take, &crate::Manifest::read(&asked.take).unwrap()).unwrap()
}

const SIZE: [usize; 2] = [640, 480];

#[test]
fn every_dialect_makes_a_take_whose_rig_reads_as_the_calibration() {
    for (file, unit) in [
        ("nerfstudio/transforms.json", Some("m")),
        ("easymocap", None),
        ("camera_params.json", None),
        ("cameras_sphere.npz", Some("m")),
        ("middlebury_par.txt", None),
        ("mvsnet", None),
        ("metashape.xml", None),
        ("opencv_k14.json", None),
        ("colmap_rig", None),
        ("opencv_fisheye", None),
    ] {
        let root = tempfile::tempdir().unwrap();
        let new = NewTake { unit_mm: unit.and_then(named_unit), ..asked(root.path(), usual(root.path(), SIZE), file) };
        let made = new_take(&new).unwrap_or_else(|error| panic!("{file}: {error}\n{}", error.hint()));
        let rig = rig(&new);
        assert_eq!(
            rig.cameras.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(),
            ["cam00", "cam01", "cam02"],
            "{file}"
        );
        for (i, camera) in rig.cameras.iter().enumerate() {
            let there = camera.camera_from_world.translation;
            let expected = DVec3::new(20.0 * i as f64 - 10.0, 15.0, 1100.0 + 100.0 * i as f64);
            assert!((there - expected).length() < 1e-6, "{file}: {there}\n{}", made.said.join("\n"));
        }
        assert!(
            made.said.iter().any(|line| line.contains("1100") || line.contains("mm from the place")),
            "{:?}",
            made.said
        );
        assert_eq!(made.missing.len(), 2, "labels and masks are nowhere");
    }
}

#[test]
fn views_are_found_in_many_layouts() {
    type Layout = (fn(usize, usize) -> String, fn(usize) -> String);
    let layouts: [Layout; 4] = [
        (|v, t| format!("footage/Cam_{v}/shot{t:04}.png"), |v| format!("background/cam{v}.png")),
        (|v, t| format!("cam{v:02}/images/{t:04}.png"), |v| format!("empty/cam{v:02}/0001.png")),
        (|v, t| format!("all/cam{v:02}_{t:04}.png"), |v| format!("cleanplates/cam{v:02}.png")),
        (|v, t| format!("take7_cam{v:02}/{t:04}.png"), |v| format!("cam{v:02}_clean.png")),
    ];
    for (i, (frame, plate)) in layouts.into_iter().enumerate() {
        let root = tempfile::tempdir().unwrap();
        let new = asked(root.path(), capture(root.path(), SIZE, frame, plate), "opencv_k12.yml");
        let made = new_take(&new).unwrap_or_else(|error| panic!("{i}: {error}\n{}", error.hint()));
        let manifest = crate::Manifest::read(&new.take).unwrap();
        assert_eq!((manifest.views.len(), manifest.fps), (3, 50.0), "{i}");
        let rig = rig(&new);
        let depths = rig.cameras.iter().map(|camera| camera.camera_from_world.translation.z.round());
        assert_eq!(depths.collect::<Vec<_>>(), [1100.0, 1200.0, 1300.0], "{i}: {:?}", made.said);
        for (view, plate) in manifest.views.iter().zip(0..) {
            let digit = char::from_digit(plate, 10).unwrap();
            let own = [&view.name, &view.plate].map(|text| text.trim_end_matches("/0001.png").contains(digit));
            assert_eq!(own, [true, true], "{i}: {view:?}");
            let files =
                crate::footage::ViewFiles::open(&view.name, &strandflow_io::ViewInput::of(Path::new(&view.source)));
            assert!(files.unwrap().file(1).is_ok(), "{i}: {view:?}");
        }
    }
}

#[test]
fn footage_of_another_size_is_refused_with_the_factor() {
    let root = tempfile::tempdir().unwrap();
    let new = asked(root.path(), usual(root.path(), [320, 240]), "opencv_k12.yml");
    let error = new_take(&new).unwrap_err();
    assert!(error.to_string().contains("320×240") && error.hint().contains("0.5000"), "{error} {}", error.hint());
    assert!(!new.take.exists());
}

#[test]
fn what_cannot_be_guessed_is_asked_for_by_name() {
    let root = tempfile::tempdir().unwrap();
    let footage = usual(root.path(), SIZE);
    let new = asked(root.path(), footage.clone(), "nerfstudio/transforms.json");
    assert!(new_take(&new).unwrap_err().hint().contains("--unit"));
    let new = NewTake { fps: None, ..asked(root.path(), footage.clone(), "metashape.xml") };
    assert!(new_take(&new).unwrap_err().hint().contains("--fps"));
    let new = NewTake { calibration: None, ..new };
    assert!(new_take(&new).unwrap_err().hint().contains("--calibration"));
    std::fs::remove_file(footage.join("clean/cam01.png")).unwrap();
    let error = new_take(&asked(root.path(), footage, "metashape.xml")).unwrap_err();
    assert!(error.to_string().contains("cam01") && error.to_string().contains("clean plate"), "{error}");
}

#[test]
fn clips_of_unequal_length_are_cut_and_gravity_follows_the_cameras() {
    let root = tempfile::tempdir().unwrap();
    let footage = usual(root.path(), SIZE);
    image(&footage.join("images/cam02/000002.png"), SIZE);
    let new = asked(root.path(), footage, "metashape.xml");
    let made = new_take(&new).unwrap();
    let manifest = crate::Manifest::read(&new.take).unwrap();
    assert_eq!(manifest.frames.as_deref(), Some("0..2"), "{:?}", made.said);
    // The fixture's cameras have y down.
    assert_eq!(manifest.gravity, [0.0, 9806.65, 0.0], "{:?}", made.said);
    let new = NewTake { take: root.path().join("other"), up: Some(DVec3::Z), ..new };
    new_take(&new).unwrap();
    assert_eq!(crate::Manifest::read(&new.take).unwrap().gravity, [-0.0, -0.0, -9806.65]);
}
