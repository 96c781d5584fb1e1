//! Footage that cannot be trusted: the report names view and frame, confidence falls there, nothing is invented.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

mod cameras;

use cameras::camera;
use glam::{DVec3, Vec3};
use strandflow_core::{
    Camera, Grid, Mask, Occupancy, Place, Plane, Report, RgbImage, Rig, RigidTransform, SparseVoxels,
};
use strandflow_geometry::{primitives::icosphere, project::ray};
use strandflow_image::filter::gaussian;
use strandflow_stages::{
    Mode, StageError,
    field::{FieldInput, FieldSettings, FieldVoxel, field, head_distance},
    hull::{HullSettings, hull},
    lift::{LiftInput, LiftSettings, Line, lift},
    masks::{Masks, MasksInput, MasksSettings, masks},
    orient::{OrientSettings, OrientationMap, orient},
};

const HAIR: f64 = 60.0;
const HEAD: f64 = 48.0;

/// What the report says, a line a finding.
fn said(report: &Report) -> Vec<String> {
    report.findings.iter().map(ToString::to_string).collect()
}

/// Whether exactly one finding was made and it holds all of `parts`.
fn assert_says(report: &Report, parts: &[&str]) {
    let said = said(report);
    assert_eq!(said.len(), 1, "{said:?}");
    parts.iter().for_each(|part| assert!(said[0].contains(part), "`{part}` is not in: {}", said[0]));
}

/// White noise of standard deviation 1 of a pixel, the same for the same seed.
fn noise(x: usize, y: usize, seed: u64) -> f32 {
    let mut state = (x as u64) << 40 ^ (y as u64) << 20 ^ seed;
    let mut sum = 0.0;
    for _ in 0..4 {
        state = (state ^ state >> 31).wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(0x1234_5678_9abc_def1);
        sum += (state >> 40) as f32 / (1u64 << 24) as f32 - 0.5;
    }
    sum * 3f32.sqrt()
}

const SIZE: (usize, usize) = (200, 160);

/// Hair that hangs a little aslant before a wall: strands of a pixel and wisps of many, seen through a lens of blur
/// `blur_px` by a sensor with noise.
fn hanging_hair(blur_px: f32) -> (RgbImage, Mask) {
    let hair =
        Plane::from_fn(SIZE.0, SIZE.1, |x, y| if (30..170).contains(&x) && (20..140).contains(&y) { 255u8 } else { 0 });
    let strand = |x: usize, y: usize, width: usize| noise((x + y / 4) / width, 7, width as u64);
    let sharp = Plane::from_fn(SIZE.0, SIZE.1, |x, y| {
        if hair[(x, y)] == 0 {
            return 150.0;
        }
        80.0 + 9.0 * (strand(x, y, 1) + strand(x, y, 2) + strand(x, y, 4) + strand(x, y, 8))
    });
    let seen = gaussian(&gaussian(&sharp, 0.45), blur_px);
    let image = Plane::from_fn(SIZE.0, SIZE.1, |x, y| {
        [0, 1, 2].map(|c| (seen[(x, y)] + 2.0 * noise(x, y, 90 + c)).round().clamp(0.0, 255.0) as u8)
    });
    (image, hair)
}

fn oriented(image: &RgbImage, hair: &Mask, mode: Mode) -> (OrientationMap, Report) {
    let mut report = Report::default();
    let place = Place::view_frame("cam03", 12);
    let map = orient(&place, image, hair, hair, mode, &OrientSettings::default(), &mut report).unwrap();
    (map, report)
}

fn mean_confidence(map: &OrientationMap, pixels: impl Iterator<Item = (usize, usize)> + Clone) -> f32 {
    pixels.clone().map(|at| map.confidence[at]).sum::<f32>() / pixels.count() as f32
}

fn block(x: std::ops::Range<usize>, y: std::ops::Range<usize>) -> impl Iterator<Item = (usize, usize)> + Clone {
    y.flat_map(move |y| x.clone().map(move |x| (x, y)))
}

#[test]
fn a_view_out_of_focus_is_named_and_believed_less() {
    let hair_pixels = || block(40..160, 30..130);
    for mode in [Mode::Robust, Mode::Paper] {
        let (image, hair) = hanging_hair(0.0);
        let (sharp, report) = oriented(&image, &hair, mode);
        assert!(said(&report).is_empty(), "{:?}", said(&report));
        let before = mean_confidence(&sharp, hair_pixels());
        // A lens that is a little soft is no finding.
        let (image, hair) = hanging_hair(0.7);
        assert!(said(&oriented(&image, &hair, mode).1).is_empty());
        for blur in [2.0, 3.5] {
            let (image, hair) = hanging_hair(blur);
            let (map, report) = oriented(&image, &hair, mode);
            assert_says(&report, &["view cam03, frame 12", "blurred", "confidence is lowered"]);
            let after = mean_confidence(&map, hair_pixels());
            assert!(after < 0.6 * before, "{mode:?}, blur {blur}: {after} after {before}");
        }
    }
}

#[test]
fn overexposed_hair_is_named_and_has_no_confidence() {
    let (plain, hair) = hanging_hair(0.0);
    let lit = |x: usize, y: usize| (60..100).contains(&x) && (40..90).contains(&y);
    let image = Plane::from_fn(SIZE.0, SIZE.1, |x, y| if lit(x, y) { [255, 254, 240] } else { plain[(x, y)] });
    let (map, report) = oriented(&image, &hair, Mode::Robust);
    assert_says(&report, &["view cam03, frame 12", "12 % of the hair is overexposed", "no confidence"]);
    assert!(block(60..100, 40..90).all(|at| map.confidence[at] == 0.0));
    assert!(mean_confidence(&map, block(120..160, 40..130)) > 0.3);
    // Glints are strands, not patches: they keep their orientation.
    let glint = |x: usize, y: usize| x % 20 == 3 && y % 8 < 4;
    let image = Plane::from_fn(SIZE.0, SIZE.1, |x, y| if glint(x, y) { [251, 230, 200] } else { plain[(x, y)] });
    let (map, report) = oriented(&image, &hair, Mode::Robust);
    assert!(said(&report).is_empty(), "{:?}", said(&report));
    assert!(block(40..160, 30..130).all(|at| map.confidence[at] > 0.0));
}

/// A subject (dark, textured) before a plate: what `masks` makes of it with a key hair mask.
fn masked(subject: impl Fn(usize, usize) -> bool, hair: impl Fn(usize, usize) -> bool) -> (Masks, Report) {
    let wall = |x, y, seed: u64| [0, 1, 2].map(|c| (150.0 + 2.0 * noise(x, y, seed + c)).round() as u8);
    let plate = Plane::from_fn(SIZE.0, SIZE.1, |x, y| wall(x, y, 1));
    let dark = |x: usize, _: usize| [0, 1, 2].map(|c| (60.0 + 9.0 * noise(x, 0, c)).round() as u8);
    let image = Plane::from_fn(SIZE.0, SIZE.1, |x, y| if subject(x, y) { dark(x, y) } else { wall(x, y, 50) });
    let key = Plane::from_fn(SIZE.0, SIZE.1, |x, y| if hair(x, y) { 255u8 } else { 0 });
    let input = MasksInput {
        place: Place::view_frame("cam03", 12),
        image: &image,
        plate: &plate,
        given_subject: None,
        given_hair: None,
        neighbour: None,
        key: Some(&key),
        look: None,
        edge: None,
    };
    let mut report = Report::default();
    let found = masks(&input, Mode::Robust, &MasksSettings::default(), &mut report).unwrap();
    (found, report)
}

#[test]
fn hair_that_the_image_cuts_off_is_named_with_its_side() {
    let inside = |x: usize, y: usize| (40..120).contains(&x) && y >= 30;
    let (_, report) = masked(inside, |x, y| inside(x, y) && y < 100);
    assert!(said(&report).is_empty(), "{:?}", said(&report));
    let (found, report) = masked(inside, inside);
    assert!(found.hair[(80, SIZE.1 - 1)] >= 128);
    assert_says(&report, &["view cam03, frame 12", "hair covers 40.0 % of the image's lower border", "carves nothing"]);
}

#[test]
fn another_person_is_named_and_left_out_of_the_masks() {
    let first = |x: usize, y: usize| (20..90).contains(&x) && (20..140).contains(&y);
    let second = |x: usize, y: usize| (120..180).contains(&x) && (30..120).contains(&y);
    let hair = |x: usize, y: usize| first(x, y) && y < 80;
    let (alone, report) = masked(first, hair);
    assert!(said(&report).is_empty(), "{:?}", said(&report));
    let (found, report) = masked(|x, y| first(x, y) || second(x, y), hair);
    assert_says(&report, &["view cam03, frame 12", "parts of 8400 and 5400 pixels", "another person"]);
    assert!(block(110..SIZE.0, 0..SIZE.1).all(|at| found.subject[at] == 0 && found.hair[at] == 0));
    let differ = found.subject.data.iter().zip(&alone.subject.data).filter(|(a, b)| (**a >= 128) != (**b >= 128));
    assert!(differ.count() < 20);
    // A lock that hangs clear of the rest is none.
    let (found, report) = masked(|x, y| first(x, y) || block(100..106, 30..90).any(|at| at == (x, y)), hair);
    assert!(said(&report).is_empty() && found.subject[(103, 60)] >= 128, "{:?}", said(&report));
}

/// Five cameras around the origin, z up; `wide` sees 580 mm across, narrow 170 mm.
fn rig(wide: bool) -> Rig {
    rig_of(5, wide)
}

fn rig_of(views: usize, wide: bool) -> Rig {
    let focal = if wide { 370.0 } else { 1300.0 };
    let camera = |i: usize| camera(format!("cam{i:02}"), i as f64 * 45.0, 0.2 + 0.1 * (i % 2) as f64, focal);
    Rig { cameras: (0..views).map(camera).collect() }
}

/// Silhouettes of balls (centre, radius).
fn silhouettes(rig: &Rig, balls: &[(DVec3, f64)]) -> Vec<Mask> {
    let meets = |camera: &Camera, x: usize, y: usize| {
        let ray = ray(camera, glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
        balls.iter().any(|&(centre, radius)| (centre - ray.origin).cross(ray.direction).length() < radius)
    };
    let mask = |camera: &Camera| Plane::from_fn(240, 240, |x, y| if meets(camera, x, y) { 255u8 } else { 0 });
    rig.cameras.iter().map(mask).collect()
}

fn grid(half: DVec3) -> Grid {
    Grid { origin: -half, voxel_mm: 3.0, dims: (half * 2.0 / 3.0).to_array().map(|n| n.ceil() as usize) }
}

fn hull_of(rig: &Rig, subjects: &[Mask], grid: &Grid) -> (Result<Occupancy, StageError>, Report) {
    let mut report = Report::default();
    let refs: Vec<&Mask> = subjects.iter().collect();
    (hull(rig, &refs, grid, 12, &HullSettings::default(), &mut report), report)
}

type Field = Result<SparseVoxels<FieldVoxel>, StageError>;

fn field_of(rig: &Rig, hull: &Occupancy, hairs: &[Mask], head: f64) -> (Field, Report) {
    let mut report = Report::default();
    // A line on the hair, so that the field has a direction.
    let seen = hull.grid.voxel_at(DVec3::X * 0.9 * HAIR).map(|voxel| hull.grid.index(voxel) as u32).unwrap();
    let line = Line { direction: Vec3::Z, confidence: 0.9, residual: 0.0, views: 3 };
    let input = FieldInput {
        rig,
        frame: 12,
        hull,
        lines: &SparseVoxels { grid: hull.grid, indices: vec![seen], values: vec![line] },
        hairs: &hairs.iter().collect::<Vec<_>>(),
        head: &head_distance(&icosphere(DVec3::ZERO, head, 4), hull.grid.voxel_mm),
        world_from_head: RigidTransform::IDENTITY,
    };
    (field(&input, Mode::Robust, &FieldSettings::default(), &mut report), report)
}

#[test]
fn the_hull_is_not_cut_where_a_view_ends() {
    let (mut rig, balls) = (rig(false), [(DVec3::ZERO, HAIR)]);
    let grid = grid(DVec3::splat(72.0));
    // The ball hangs out of the lower border of this view, and beside another altogether.
    rig.cameras[1].principal = [120.0, 200.0];
    rig.cameras[4].principal = [900.0, 120.0];
    let subjects = silhouettes(&rig, &balls);
    let (found, report) = hull_of(&rig, &subjects, &grid);
    let found = found.unwrap();
    assert!(said(&report).is_empty());
    let ball = (0..grid.len()).filter(|&index| grid.centre_of_index(index).length() < HAIR - 2.0);
    assert!(ball.clone().count() > 20_000);
    assert_eq!(ball.filter(|&index| !found.get(index)).count(), 0);
}

#[test]
fn a_view_that_sees_no_hair_does_not_empty_the_volume() {
    let rig = rig(false);
    let hairs = silhouettes(&rig, &[(DVec3::ZERO, HAIR)]);
    let (hull, _) = hull_of(&rig, &hairs, &grid(DVec3::splat(72.0)));
    let hull = hull.unwrap();
    let (all, report) = field_of(&rig, &hull, &hairs, HEAD);
    assert!(said(&report).is_empty(), "{:?}", said(&report));
    let mut blind = hairs;
    blind[2].data.fill(0);
    let (found, report) = field_of(&rig, &hull, &blind, HEAD);
    assert_says(&report, &["view cam02, frame 12", "the hair mask is empty", "does not bound"]);
    assert_eq!(found.unwrap().indices, all.unwrap().indices);
    let (map, report) = oriented(&hanging_hair(0.0).0, &Plane::filled(SIZE.0, SIZE.1, 0), Mode::Robust);
    assert_says(&report, &["view cam03, frame 12", "the hair mask is empty", "no orientations"]);
    assert!(map.confidence.data.iter().all(|&c| c == 0.0));
}

#[test]
fn another_body_of_the_hull_is_named_and_has_no_field() {
    let (rig, other) = (rig(true), DVec3::new(0.0, 0.0, 190.0));
    let subjects = silhouettes(&rig, &[(DVec3::ZERO, HAIR), (other, 75.0)]);
    let (hull, report) = hull_of(&rig, &subjects, &grid(DVec3::new(120.0, 120.0, 280.0)));
    let hull = hull.unwrap();
    assert_says(&report, &["frame 12", "the hull falls into bodies of", "litres", "holds the head"]);
    assert!(hull.contains(other));
    let (found, _) = field_of(&rig, &hull, &subjects, HEAD);
    let found = found.unwrap();
    let heights = found.indices.iter().map(|&index| hull.grid.centre_of_index(index as usize).z);
    assert!(found.len() > 1000 && heights.fold(f64::NEG_INFINITY, f64::max) < 100.0);
}

#[test]
fn the_inside_of_a_body_below_the_head_holds_no_hair() {
    let chest = (DVec3::new(0.0, 0.0, -150.0), 105.0);
    // Of five views each is believed alone; of seven none is, so that a hair over the chest in one of them says nothing.
    for (views, strip) in [(5, false), (7, true)] {
        let rig = rig_of(views, true);
        let subjects = silhouettes(&rig, &[(DVec3::ZERO, HAIR), chest]);
        let mut hairs = silhouettes(&rig, &[(DVec3::ZERO, HAIR)]);
        if strip {
            (120..200).for_each(|y| (110..130).for_each(|x| hairs[1][(x, y)] = 255));
        }
        let hull = hull_of(&rig, &subjects, &grid(DVec3::new(120.0, 120.0, 270.0))).0.unwrap();
        let inside = |index: &usize| {
            let point = hull.grid.centre_of_index(*index);
            point.z < -HAIR - 10.0 && point.distance(chest.0) < chest.1
        };
        let of_chest = hull.indices().filter(inside).count();
        let found = field_of(&rig, &hull, &hairs, HEAD).0.unwrap();
        let left = found.indices.iter().filter(|index| inside(&(**index as usize))).count();
        assert!(of_chest > 50_000 && left * 50 < of_chest, "{views} views: {left} of {of_chest}");
        assert!(found.len() > 1000, "the hair keeps its volume");
    }
}

#[test]
fn thick_hair_reaches_from_where_it_is_seen_to_the_head() {
    let (rig, thick) = (rig_of(7, true), 135.0);
    let hairs = silhouettes(&rig, &[(DVec3::ZERO, thick)]);
    let hull = hull_of(&rig, &hairs, &grid(DVec3::splat(150.0))).0.unwrap();
    let found = field_of(&rig, &hull, &hairs, HEAD).0.unwrap();
    // On the side of the cameras, which stand from 0 to 270 degrees around.
    let at_head = |index: &usize| {
        let point = hull.grid.centre_of_index(*index);
        (HEAD + 4.0..HEAD + 10.0).contains(&point.length()) && point.z.abs() < 25.0 && point.y - point.x > 0.0
    };
    let all = hull.indices().filter(at_head).count();
    let kept = found.indices.iter().filter(|index| at_head(&(**index as usize))).count();
    assert!(all > 1_000 && kept * 10 > all * 9, "{kept} of {all} voxels, 77 mm and more behind the hull");
}

#[test]
fn an_empty_volume_is_named_with_its_frame() {
    let rig = rig(false);
    let hairs = silhouettes(&rig, &[(DVec3::ZERO, HAIR)]);
    let grid = grid(DVec3::splat(72.0));
    let error = |found: StageError, part: &str| {
        assert!(found.to_string().contains("frame 12") && found.to_string().contains(part), "{found}");
        assert!(!found.hint().is_empty());
    };
    let empty = vec![Plane::filled(240, 240, 0u8); 5];
    error(hull_of(&rig, &empty, &grid).0.unwrap_err(), "the subject mask is empty");
    let hull = hull_of(&rig, &hairs, &grid).0.unwrap();
    // A head larger than the hull leaves no room for hair.
    error(field_of(&rig, &hull, &hairs, 75.0).0.unwrap_err(), "no hair volume");
    // Views that are sure of nothing: no line is made up.
    let unsure = OrientationMap { angle: Plane::filled(240, 240, 1.0), confidence: Plane::filled(240, 240, 0.0) };
    let maps = vec![&unsure; 5];
    let input = LiftInput { rig: &rig, frame: 12, hull: &hull, maps: &maps, hairs: &hairs.iter().collect::<Vec<_>>() };
    let mut report = Report::default();
    let lines = lift(&input, Mode::Robust, &LiftSettings::default(), &mut report).unwrap();
    assert!(lines.is_empty());
    assert_says(&report, &["frame 12", "no voxel has a line"]);
}
