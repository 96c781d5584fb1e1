use super::*;
use crate::write_rgb_png;

fn picture(frame: usize) -> RgbImage {
    RgbImage::from_fn(16, 8, |x, y| [(frame * 20) as u8, x as u8 * 10, y as u8 * 10])
}

fn folder(at: &Path, numbers: &[usize]) -> ViewInput {
    std::fs::create_dir_all(at).unwrap();
    for &number in numbers {
        write_rgb_png(&at.join(format!("{number:06}.png")), &picture(number)).unwrap();
    }
    ViewInput::of(at)
}

fn rig(names: &[&str], width: usize) -> Rig {
    let camera = |name: &&str| strandflow_core::Camera {
        name: (*name).to_owned(),
        width,
        height: 8,
        focal: [10.0; 2],
        principal: [8.0, 4.0],
        distortion: Default::default(),
        camera_from_world: Default::default(),
    };
    Rig { cameras: names.iter().map(camera).collect() }
}

#[test]
fn folders_give_frames_and_tell_gaps_lengths_and_sizes() {
    let dir = tempfile::tempdir().unwrap();
    let views = [
        ("a".to_owned(), folder(&dir.path().join("a"), &[1, 2, 3, 4])),
        ("b".to_owned(), folder(&dir.path().join("b"), &[1, 2, 4])),
        ("c".to_owned(), folder(&dir.path().join("c"), &[2, 3])),
    ];
    let source = TakeSource::open(&views).unwrap();
    assert_eq!(*source.image(0, 2).unwrap(), picture(3));
    let gap = source.image(1, 2).unwrap_err();
    assert_eq!((gap.view.as_str(), gap.frame), ("b", 2));
    let findings = source.check(&rig(&["a", "b", "x"], 17));
    let facts: Vec<String> = findings.iter().map(ToString::to_string).collect();
    for fact in [
        "view a, frame 0: is 16x8, its calibration 17x8",
        "view b, frame 2: there is a gap",
        "view c, frame 0: the first images are 1 missing",
        "view c, frame 0: the view has no calibration",
        "view c, frame 2: has 2 frames, view a has 4",
    ] {
        assert!(facts.iter().any(|text| text.starts_with(fact)), "{fact} not in {facts:#?}");
    }
    assert!(findings.iter().all(|finding| !finding.hint.is_empty()));
}

#[test]
fn a_damaged_image_names_file_view_and_frame() {
    let dir = tempfile::tempdir().unwrap();
    let views = [("a".to_owned(), folder(&dir.path().join("a"), &[0, 1, 2]))];
    std::fs::write(dir.path().join("a/000001.png"), b"\x89PNG\r\n\x1a\nnothing").unwrap();
    write_rgb_png(&dir.path().join("a/000002.png"), &RgbImage::filled(4, 4, [0; 3])).unwrap();
    let source = TakeSource::open(&views).unwrap();
    let error = source.image(0, 1).unwrap_err();
    assert!(error.file.ends_with("000001.png") && error.view == "a" && error.frame == 1 && !error.hint.is_empty());
    assert!(source.image(0, 2).unwrap_err().fact.contains("4x4"));
    assert!(source.image(0, 9).unwrap_err().fact.contains("missing"));
}

#[test]
fn videos_give_the_right_frames_in_any_order_from_several_threads() {
    if !probe::ffmpeg_is_installed() {
        println!("skipped: ffmpeg is not installed");
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let images = folder(&dir.path().join("a"), &(0..12).collect::<Vec<_>>());
    let video = dir.path().join("a.mkv");
    // Lossless, so that frames can be told apart exactly.
    let made = std::process::Command::new("ffmpeg")
        .args(["-v", "error", "-framerate", "50", "-i"])
        .arg(images.path().join("%06d.png"))
        .args(["-c:v", "ffv1", "-pix_fmt", "bgr0"])
        .arg(&video)
        .status()
        .unwrap();
    assert!(made.success());
    assert_eq!(
        probe(&ViewInput::of(&video)).unwrap(),
        SourceInfo { width: 16, height: 8, frame_count: 12, fps: Some(50.0) }
    );
    let source = TakeSource::open(&[("a".to_owned(), ViewInput::of(&video))]).unwrap();
    assert_eq!(source.fps(), Some(50.0));
    for frame in [0, 1, 2, 2, 5, 4, 11, 3, 0] {
        assert_eq!(*source.image(0, frame).unwrap(), picture(frame), "frame {frame}");
    }
    std::thread::scope(|scope| {
        for thread in 0..3 {
            let source = &source;
            scope.spawn(move || {
                for frame in (thread..12).step_by(3) {
                    assert_eq!(*source.image(0, frame).unwrap(), picture(frame));
                }
            });
        }
    });
    let error = source.image(0, 12).unwrap_err();
    assert!(error.fact.contains("12 frames") && error.frame == 12);
    // A file that is no video, and one that is cut.
    let broken = dir.path().join("b.mkv");
    std::fs::write(&broken, b"no video").unwrap();
    let error = TakeSource::open(&[("b".to_owned(), ViewInput::of(&broken))]).err().unwrap();
    assert!(error.to_string().contains("b.mkv") && !error.hint().is_empty());
}

#[test]
fn a_missing_program_says_how_to_install_it() {
    let error = probe::program_error(Path::new("a.mp4"), "ffmpeg", std::io::ErrorKind::NotFound.into());
    assert!(error.hint().contains("apt install ffmpeg") && error.to_string().contains("a.mp4"));
}
