use std::sync::LazyLock;

use glam::DMat3;
use strandflow_core::{Grid, Report};
use strandflow_geometry::{
    icp::Similarity,
    primitives::{cuboid, icosphere},
};

use super::*;
use crate::StageError;

const GRAVITY: DVec3 = DVec3::new(0.0, 0.0, -9810.0);
const MIDDLE: DVec3 = DVec3::new(60.0, -30.0, 1250.0);

/// A skull, its distance, and captured roots on all of it but a face towards −y.
struct Head {
    mesh: strandflow_core::TriMesh,
    skin: SignedDistance,
    roots: Vec<DVec3>,
}

static HEAD: LazyLock<Head> = LazyLock::new(head);

fn head() -> Head {
    let mut mesh = icosphere(DVec3::ZERO, 1.0, 4);
    mesh.vertices.iter_mut().for_each(|v| *v = MIDDLE + *v * DVec3::new(75.0, 95.0, 88.0));
    let skin = SignedDistance::from_mesh(&mesh, 4.0, 20.0);
    let hairy = |p: &&DVec3| p.z > MIDDLE.z - 20.0 && p.y > MIDDLE.y - 0.8 * (p.z - MIDDLE.z + 20.0);
    let roots = mesh.vertices.iter().filter(hairy).step_by(2).copied().collect();
    Head { mesh, skin, roots }
}

/// Strands that leave the roots and fall, in head space.
fn groom(head: &Head) -> Vec<Vec<DVec3>> {
    let strand = |root: &DVec3| {
        let (mut p, mut d) = (*root, (*root - MIDDLE).normalize());
        let mut points = vec![p];
        for _ in 0..25 {
            d = (d + DVec3::NEG_Z * 0.35).normalize();
            p = place::lifted(p + d * 5.0, &head.skin, 1.0);
            points.push(p);
        }
        points
    };
    head.roots.iter().step_by(3).map(strand).collect()
}

fn place_it(head: &Head, groom: &[Vec<DVec3>], how: Alignment) -> Result<PlacedGroom, StageError> {
    place(groom, (&head.mesh, &head.skin, &head.roots), GRAVITY, how, 0.5, &mut Report::default())
}

#[test]
fn a_groom_that_lies_on_its_side_and_is_larger_finds_its_place() {
    let head = &*HEAD;
    let groom = groom(head);
    // y up, facing +z, 15 % larger, elsewhere.
    let away = Similarity {
        scale: 1.15,
        rigid: RigidTransform {
            rotation: DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y) * DMat3::from_rotation_z(0.1),
            translation: DVec3::new(-200.0, 40.0, 9.0),
        },
    };
    let moved: Vec<Vec<DVec3>> = groom.iter().map(|s| s.iter().map(|p| away.point(*p - MIDDLE)).collect()).collect();
    let placed = place_it(head, &moved, Alignment::Find).unwrap();
    assert!(placed.rms_mm < 2.0, "{}", placed.rms_mm);
    // A skull is nearly a body of revolution: roots may slide a little along it.
    let apart = placed.strands.iter().zip(&groom).map(|(a, b)| a[0].distance(b[0]));
    let mean = apart.sum::<f64>() / groom.len() as f64;
    assert!(mean < 12.0, "{mean} mm");
    assert!(placed.strands.iter().all(|s| head.skin.distance(s[0]).abs() < 0.6));
    assert!(placed.strands.iter().flat_map(|s| &s[1..]).all(|p| head.skin.distance(*p) > 0.4));
}

#[test]
fn what_cannot_be_a_groom_of_this_head_is_refused_with_a_hint() {
    let head = &*HEAD;
    let groom = groom(head);
    let scaled = |scale: f64| -> Vec<Vec<DVec3>> {
        groom.iter().map(|s| s.iter().map(|p| (*p - MIDDLE) * scale).collect()).collect()
    };
    let hint = |groom: &[Vec<DVec3>], how| place_it(head, groom, how).unwrap_err().hint();
    assert!(hint(&scaled(0.001), Alignment::Find).contains("metres: give --scale 1000"));
    assert!(hint(&scaled(1.0 / 25.4), Alignment::Find).contains("inches"));
    assert!(hint(&scaled(40.0), Alignment::Find).contains("--transform"));
    assert!(hint(&scaled(1.0), Alignment::AsGiven).contains("unit and axes"));
    let text = |groom: &[Vec<DVec3>]| place_it(head, groom, Alignment::Find).unwrap_err().to_string();
    assert!(text(&[]).contains("no strands"));
    assert!(text(&[vec![DVec3::ZERO], vec![]]).contains("one point"));
    let mut broken = groom.clone();
    broken[7][3].x = f64::NAN;
    assert!(text(&broken).contains("strand 7"));
    assert!(text(&vec![vec![DVec3::ZERO, DVec3::NEG_Z * 100.0]; 9]).contains("spread"));
}

/// A head that turns by `turn` a frame, and a field that turns by `gain` as much.
fn captured(turn: f64, gain: f64) -> (Vec<RigidTransform>, Vec<SparseVoxels<Vec3>>) {
    let about = |angle: f64| {
        let rotation = DMat3::from_rotation_z(angle);
        RigidTransform { rotation, translation: MIDDLE - rotation * MIDDLE }
    };
    let poses = (0..12).map(|t| about(turn * f64::from(t))).collect();
    let grid = Grid { origin: MIDDLE - DVec3::new(160.0, 160.0, 260.0), voxel_mm: 10.0, dims: [32, 32, 40] };
    let velocity =
        |i: u32| DVec3::Z.cross(grid.centre_of_index(i as usize) - MIDDLE).as_vec3() * (turn * gain / 0.01) as f32;
    let indices: Vec<u32> = (0..grid.len() as u32).collect();
    let field = SparseVoxels { grid, values: indices.iter().map(|i| velocity(*i)).collect(), indices };
    (poses, vec![field; 12])
}

/// The farthest any particle of an animation gets from the groom carried by the head.
fn farthest(settings: &AnimateSettings, (turn, gain): (f64, f64), timeline: Timeline) -> f64 {
    let head = &*HEAD;
    let placed = place_it(head, &groom(head), Alignment::AsGiven).unwrap();
    let (poses, fields) = captured(turn, gain);
    let fields: Vec<&SparseVoxels<Vec3>> = fields.iter().collect();
    let obstacles = Obstacles { skin: &head.skin, still: None };
    let captured = Captured { first: 0, poses: &poses, fields: &fields, obstacles };
    let animation = Animation::new(&placed, |_| Params::default(), settings, (GRAVITY, poses[0]), 0.01);
    let mut state = animation.start(&poses[0], &obstacles);
    let mut worst: f64 = 0.0;
    for k in 0..timeline.frames - 1 {
        animation.advance(&mut state, k, &timeline, &captured);
        let time = timeline.source(k as f64 + 1.0);
        let pose = pose_at(&poses, (time as usize, (time as usize + 1).min(11), time.fract()));
        let check = animation.check(&state, &pose, &obstacles);
        assert_eq!(check.in_head, 0);
        let rigid = placed.strands.iter().flatten().map(|p| pose.point(*p).as_vec3());
        worst = rigid.zip(&state.points).map(|(p, q)| f64::from(p.distance(*q))).fold(worst, f64::max);
    }
    worst
}

#[test]
fn a_rigid_field_carries_the_groom_rigidly_at_any_speed() {
    let settings = AnimateSettings::default();
    for timeline in
        [Timeline::once(0, 11, 1.0), Timeline::once(0, 11, 0.5), Timeline { frames: 30, ..Timeline::once(0, 11, 1.0) }]
    {
        let worst = farthest(&settings, (0.03, 1.0), timeline);
        assert!(worst < 0.1, "{worst} mm with {timeline:?}");
    }
}

#[test]
fn the_amplitude_scales_what_the_hair_does_beside_the_head() {
    let once = Timeline::once(0, 11, 1.0);
    let with = |amplitude: f64| farthest(&AnimateSettings { amplitude, ..Default::default() }, (0.02, 0.5), once);
    let (none, captured) = (with(0.0), with(1.0));
    assert!(none < 0.1 && captured > 3.0, "{none} {captured} mm");
}

#[test]
fn hair_lies_on_shoulders_that_stand_still() {
    let head = &*HEAD;
    let placed = place_it(head, &groom(head), Alignment::AsGiven).unwrap();
    let (poses, fields) = captured(0.03, 1.0);
    let fields: Vec<&SparseVoxels<Vec3>> = fields.iter().collect();
    // As wide as shoulders, its top where the groom still reaches.
    let low = MIDDLE + DVec3::new(-200.0, -70.0, -300.0);
    let shoulders = SignedDistance::from_mesh(&cuboid(low, low + DVec3::new(400.0, 140.0, 180.0)), 4.0, 12.0);
    let alone = Obstacles { skin: &head.skin, still: None };
    let obstacles = Obstacles { skin: &head.skin, still: Some(&shoulders) };
    let timeline = Timeline::once(0, 11, 1.0);
    let animation =
        Animation::new(&placed, |_| Params::default(), &AnimateSettings::default(), (GRAVITY, poses[0]), 0.01);
    let mut state = animation.start(&poses[0], &alone);
    assert!(animation.check(&state, &poses[0], &obstacles).in_head > 10, "the groom does not reach the shoulders");
    state = animation.start(&poses[0], &obstacles);
    let captured = Captured { first: 0, poses: &poses, fields: &fields, obstacles };
    for k in 0..timeline.frames - 1 {
        animation.advance(&mut state, k, &timeline, &captured);
        let check = animation.check(&state, &poses[k + 1], &obstacles);
        assert_eq!(check.in_head, 0, "frame {k}");
        assert!(check.length_change_most < 0.02, "{}", check.length_change_most);
    }
}

#[test]
fn settings_outside_their_ranges_are_named() {
    let found = AnimateSettings { follow_secs: -1.0, amplitude: f64::NAN, ..Default::default() }.check();
    let fields: Vec<&str> = found.iter().map(|v| v.field.as_str()).collect();
    assert_eq!(fields, ["follow_secs", "amplitude"]);
}

#[test]
fn the_frames_that_a_step_needs_are_few() {
    assert_eq!(needed(&Timeline::once(2, 9, 1.0), 3), 5..=6);
    assert_eq!(needed(&Timeline::once(2, 9, 2.0), 3), 8..=9);
}
