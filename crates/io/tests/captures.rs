//! The readers on whole captures, where they are at hand.
#![expect(clippy::print_stdout, reason = "helpers of tests say what was skipped or measured")]

use std::path::{Path, PathBuf};

use glam::DVec3;
use strandflow_geometry::project::project;
use strandflow_io::{TakeSource, ViewInput, read_calibration, read_marker_labels, read_mask, read_rgb};

fn captures() -> Option<PathBuf> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/captures");
    let folder = std::env::var_os("STRANDFLOW_CAPTURES").map_or_else(|| PathBuf::from(beside), PathBuf::from);
    if !folder.is_dir() {
        println!("skipped: captures not found");
        return None;
    }
    Some(folder)
}

#[test]
fn json_and_colmap_agree_to_the_printed_digits() {
    let Some(folder) = captures() else { return };
    for name in ["dev-straight", "dev-long-wavy"] {
        let json = read_calibration(&folder.join(name).join("calibration.json"), None).unwrap();
        let colmap = read_calibration(&folder.join(name).join("colmap"), Some(1000.0)).unwrap();
        assert_eq!((json.rig.view_count(), json.fps), (7, Some(100.0)));
        assert_eq!(json.gravity, Some(DVec3::new(0.0, 0.0, -9810.0)));
        for (a, b) in json.rig.cameras.iter().zip(&colmap.rig.cameras) {
            let point = DVec3::new(40.0, -30.0, -20.0);
            let apart = project(a, point).unwrap().distance(project(b, point).unwrap());
            assert!(a.name == b.name && apart < 1e-4, "{name} {} {apart} px", a.name);
        }
    }
}

#[test]
fn videos_plates_masks_and_labels_fit_the_rig() {
    let Some(folder) = captures() else { return };
    if !strandflow_io::source::probe::ffmpeg_is_installed() {
        println!("skipped: ffmpeg is not installed");
        return;
    }
    let folder = folder.join("dev-straight");
    let rig = read_calibration(&folder.join("calibration.json"), None).unwrap().rig;
    let video = |name: &str| ViewInput::of(Path::new(&folder.join(format!("video/{name}.mp4"))));
    let views: Vec<_> = rig.cameras.iter().map(|camera| (camera.name.clone(), video(&camera.name))).collect();
    let source = TakeSource::open(&views).unwrap();
    assert!(source.check(&rig).is_empty(), "{:?}", source.check(&rig));
    assert_eq!((source.frame_count(), source.fps()), (30, Some(100.0)));
    let frame = strandflow_core::ImageSource::image(&source, 0, 29).unwrap();
    let plate = read_rgb(&folder.join("clean/cam00.png")).unwrap();
    // The corners show the background in both: colour conversion is right within the noise.
    for (x, y) in [(20, 20), (600, 20)] {
        let mean = |image: &strandflow_core::RgbImage, c: usize| {
            let window = (0..400).map(|i| f64::from(image[(x + i % 20, y + i / 20)][c]));
            window.sum::<f64>() / 400.0
        };
        for channel in 0..3 {
            let apart = mean(&frame, channel) - mean(&plate, channel);
            assert!(apart.abs() < 2.5, "column {x}, channel {channel}: video and plate are {apart:.2} levels apart");
        }
    }
    let mask = read_mask(&folder.join("user/hair_masks/cam03/000000.png")).unwrap();
    assert_eq!((mask.width, mask.height), (640, 480));
    let labels = read_marker_labels(&folder.join("user/marker_labels.json")).unwrap();
    assert!(labels.frame == 0 && labels.markers.len() >= 5);
}

#[test]
fn an_artists_groom_is_read_whole() {
    let Some(file) = captures().map(|folder| folder.join("../grooms/straight.hair")).filter(|file| file.exists())
    else {
        println!("skipped: no groom");
        return;
    };
    let strands = strandflow_io::read_hair(&file, 10.0).unwrap();
    assert_eq!((strands.strand_count(), strands.points.len()), (10_000, 160_000));
}
