//! The hull on captures with truth: it holds the hair, is tight, and fails with the view to blame.
#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "helpers of tests: they fail by unwrap and say what was skipped or measured"
)]

mod captures;

use std::time::Instant;

use captures::{Capture, capture};
use strandflow_core::{Grid, Mask, Report};
use strandflow_stages::{
    StageError,
    hull::{HullSettings, grid_of_take, hull},
};

const FRAMES: [usize; 4] = [0, 10, 20, 29];

fn grid(capture: &Capture) -> Grid {
    let mut unions = capture.masks("subject", 0);
    for frame in FRAMES {
        for (union, mask) in unions.iter_mut().zip(capture.masks("subject", frame)) {
            union.data.iter_mut().zip(mask.data).for_each(|(u, m)| *u = (*u).max(m));
        }
    }
    let start = Instant::now();
    let grid = grid_of_take(&capture.rig, &unions, &HullSettings::default(), &mut Report::default()).unwrap();
    println!("grid {:?} ({:.0} ms)", grid, start.elapsed().as_secs_f64() * 1e3);
    grid
}

#[test]
fn the_hull_holds_the_true_hair_and_is_tight() {
    for name in ["dev-straight", "dev-long-wavy"] {
        let Some(capture) = capture(name) else { return };
        let grid = grid(&capture);
        for frame in FRAMES {
            let masks = capture.masks("subject", frame);
            let refs: Vec<&Mask> = masks.iter().collect();
            let start = Instant::now();
            let found =
                hull(&capture.rig, &refs, &grid, frame, &HullSettings::default(), &mut Report::default()).unwrap();
            let ms = start.elapsed().as_secs_f64() * 1e3;
            let (points, _) = capture.strands(frame);
            let held = points.iter().filter(|p| found.contains(**p)).count() as f64 / points.len() as f64;
            let litres = found.count() as f64 * grid.voxel_mm.powi(3) / 1e6;
            println!("{name} {frame}: holds {:.3} %, {litres:.3} l, {ms:.0} ms", held * 100.0);
            assert!(held >= 0.99);
        }
    }
}

#[test]
fn the_view_that_empties_the_hull_is_named() {
    let Some(capture) = capture("dev-straight") else { return };
    let grid = grid(&capture);
    let mut masks = capture.masks("subject", 0);
    let blame = |masks: &[Mask]| {
        let refs: Vec<&Mask> = masks.iter().collect();
        hull(&capture.rig, &refs, &grid, 7, &HullSettings::default(), &mut Report::default()).unwrap_err()
    };
    masks[3].data.fill(0);
    let StageError::Input { place, fact, .. } = blame(&masks) else { panic!("another error") };
    assert_eq!((place.view.as_deref(), place.frame), (Some("cam03"), Some(7)), "{fact}");
    // A silhouette somewhere else entirely: a corner of the image.
    for y in 0..40 {
        masks[3].data[y * 640..y * 640 + 40].fill(255);
    }
    let StageError::Input { place, fact, .. } = blame(&masks) else { panic!("another error") };
    assert_eq!((place.view.as_deref(), place.frame), (Some("cam03"), Some(7)), "{fact}");
}
