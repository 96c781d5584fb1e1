//! The scalp on captures with truth: near the true head under the hair, roots where hair grows.
#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "helpers of tests: they fail by unwrap and say what was skipped or measured"
)]

mod captures;

use std::time::Instant;

use captures::{Capture, capture};
use glam::DVec3;
use strandflow_core::{Mask, Occupancy, Report, RigidTransform};
use strandflow_geometry::mesh_distance::MeshDistance;
use strandflow_stages::{
    hull::{HullSettings, grid_of_take, hull},
    scalp::{Scalp, ScalpFrame, ScalpInput, ScalpSettings, scalp},
};

const FRAMES: [usize; 3] = [0, 3, 6];

struct Frame {
    pose: RigidTransform,
    hull: Occupancy,
    subjects: Vec<Mask>,
    hairs: Vec<Mask>,
}

fn frames(capture: &Capture) -> Vec<Frame> {
    let settings = HullSettings { voxel_mm: 3.0, ..HullSettings::default() };
    let mut report = Report::default();
    let grid = grid_of_take(&capture.rig, &capture.masks("subject", 0), &settings, &mut report).unwrap();
    let one = |&frame: &usize| {
        let subjects = capture.masks("subject", frame);
        let refs: Vec<&Mask> = subjects.iter().collect();
        let hull = hull(&capture.rig, &refs, &grid, frame, &settings, &mut Report::default()).unwrap();
        Frame { pose: capture.world_from_head(frame), hull, subjects, hairs: capture.masks("hair", frame) }
    };
    FRAMES.iter().map(one).collect()
}

fn scalp_of(capture: &Capture, frames: &[Frame]) -> Scalp {
    let frames: Vec<ScalpFrame> = frames
        .iter()
        .map(|f| ScalpFrame {
            world_from_head: f.pose,
            hull: &f.hull,
            subjects: f.subjects.iter().collect(),
            hairs: f.hairs.iter().collect(),
        })
        .collect();
    let markers = capture.markers();
    let input = ScalpInput { rig: &capture.rig, frames: &frames, markers: &markers, gravity: capture.gravity, seed: 7 };
    scalp(&input, &ScalpSettings { root_count: 4000, ..ScalpSettings::default() }, &mut Report::default()).unwrap()
}

/// Share of `a` within `reach` of a point of `b`.
fn near(a: &[DVec3], b: &[DVec3], reach: f64) -> f64 {
    a.iter().filter(|p| b.iter().any(|q| p.distance(*q) < reach)).count() as f64 / a.len() as f64
}

#[test]
fn the_scalp_is_near_the_head_and_roots_grow_where_hair_grows() {
    for name in ["dev-straight", "dev-long-wavy"] {
        let Some(capture) = capture(name) else { return };
        let frames = frames(&capture);
        let start = Instant::now();
        let found = scalp_of(&capture, &frames);
        let seconds = start.elapsed().as_secs_f64();
        let (points, offsets) = capture.strands(0);
        let true_roots: Vec<DVec3> = offsets[..offsets.len() - 1].iter().map(|&o| points[o]).collect();
        let ours = MeshDistance::new(&found.mesh);
        let truth = MeshDistance::new(&capture.head());
        let signed: Vec<f64> = true_roots.iter().map(|r| ours.nearest(*r).unwrap().signed_distance).collect();
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
        let absolute: Vec<f64> = signed.iter().map(|d| d.abs()).collect();
        let off_head: Vec<f64> = found.roots.iter().map(|r| truth.nearest(*r).unwrap().signed_distance.abs()).collect();
        let (precision, recall) = (near(&found.roots, &true_roots, 10.0), near(&true_roots, &found.roots, 10.0));
        println!(
            "{name}: true roots to scalp {:.2} mm (signed {:.2}, worst {:.1}), our roots to head {:.2} mm, \
             precision {precision:.3}, recall {recall:.3}, {seconds:.2} s",
            mean(&absolute),
            mean(&signed),
            absolute.iter().copied().fold(0.0, f64::max),
            mean(&off_head)
        );
        detail(&capture, &true_roots, &signed);
        assert_eq!((found.roots.len(), found.normals.len()), (4000, 4000));
        assert!(found.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-9));
        assert!(mean(&absolute) < 1.5 && precision > 0.9 && recall > 0.9);
    }
}

/// Prints the signed error by region of the head.
fn detail(capture: &Capture, roots: &[DVec3], signed: &[f64]) {
    let head = capture.head();
    let low = head.vertices.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = head.vertices.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let middle = (low + high) * 0.5;
    for (region, inside) in [
        ("top", Box::new(|p: &DVec3| p.z > high.z - 30.0) as Box<dyn Fn(&DVec3) -> bool>),
        ("left", Box::new(|p: &DVec3| p.z < high.z - 30.0 && p.x < middle.x - 45.0)),
        ("right", Box::new(|p: &DVec3| p.z < high.z - 30.0 && p.x > middle.x + 45.0)),
        ("front", Box::new(|p: &DVec3| p.z < high.z - 30.0 && p.y < middle.y - 35.0)),
        ("back", Box::new(|p: &DVec3| (high.z - 100.0..high.z - 30.0).contains(&p.z) && p.y > middle.y + 45.0)),
        ("nape", Box::new(|p: &DVec3| p.z < high.z - 140.0)),
    ] {
        let d: Vec<f64> = roots.iter().zip(signed).filter(|(p, _)| inside(p)).map(|(_, d)| *d).collect();
        println!("  {region}: {} roots, signed {:.1}", d.len(), d.iter().sum::<f64>() / d.len().max(1) as f64);
    }
}
