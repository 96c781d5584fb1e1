use glam::DMat3;

use super::*;

/// A head that turns about the vertical, a field that turns with it by `gain`, and a ball for a skull.
struct Turning {
    rad_s: f64,
    frame: usize,
    gain: f64,
    ball_mm: f64,
}

const FRAME_SECS: f64 = 0.01;
const GRAVITY: DVec3 = DVec3::new(0.0, 0.0, -9810.0);

impl Surroundings for Turning {
    fn world_from_head(&self, share: f64) -> RigidTransform {
        let angle = self.rad_s * FRAME_SECS * (self.frame as f64 + share);
        RigidTransform { rotation: DMat3::from_rotation_z(angle), translation: DVec3::new(40.0, -10.0, 1500.0) }
    }

    fn velocity(&self, _: f64, point: DVec3) -> Option<DVec3> {
        let arm = point - DVec3::new(40.0, -10.0, 1500.0);
        Some(DVec3::Z.cross(arm) * self.rad_s * self.gain)
    }

    fn contact(&self, share: f64, point: DVec3) -> Option<Contact> {
        let arm = point - self.world_from_head(share).translation;
        let depth = self.ball_mm - arm.length();
        (depth > 0.0).then(|| Contact { depth, normal: arm.normalize_or(DVec3::Z), on_head: true })
    }
}

/// Curled strands that leave a ball of 80 mm sideways and hang, in head space.
fn groom(count: usize) -> Vec<Vec<DVec3>> {
    (0..count)
        .map(|n| {
            let turn = DMat3::from_rotation_z(n as f64);
            let curl = |i: usize| DVec3::new((0.9 * i as f64).cos(), (0.9 * i as f64).sin(), 0.0) * 4.0;
            (0..24 + n % 5)
                .map(|i| {
                    turn * (DVec3::new(82.0 + 12.0 * (1.0 - (-0.2 * i as f64).exp()), 0.0, -4.0 * i as f64) + curl(i)
                        - curl(0))
                })
                .collect()
        })
        .collect()
}

fn hung(groom: &[Vec<DVec3>]) -> Vec<Hung> {
    groom.iter().map(|s| Hung::new(s.clone(), Params::default(), GRAVITY, 5.0)).collect()
}

fn start(groom: &[Vec<DVec3>], around: &Turning) -> DrivenState {
    let pose = around.world_from_head(0.0);
    let points: Vec<Vec3> = groom.iter().flatten().map(|p| pose.point(*p).as_vec3()).collect();
    DrivenState { velocities: vec![Vec3::ZERO; points.len()], points }
}

fn options(follow_secs: f64) -> DriveOptions {
    DriveOptions { follow_secs, frame_secs: FRAME_SECS, substeps: 5, gravity: GRAVITY, friction: 20.0 }
}

/// The largest distance to the groom carried rigidly by the head, after some frames.
fn deviation(mut around: Turning, follow_secs: f64, frames: usize) -> f64 {
    let groom = groom(20);
    let (strands, mut state) = (hung(&groom), start(&groom, &around));
    for frame in 0..frames {
        around.frame = frame;
        advance_frame(&strands, &mut state, &around, &options(follow_secs));
    }
    let pose = around.world_from_head(1.0);
    let rigid = groom.iter().flatten().map(|p| pose.point(*p));
    rigid.zip(&state.points).map(|(p, q)| p.distance(q.as_dvec3())).fold(0.0, f64::max)
}

#[test]
fn a_groom_that_nothing_drives_hangs_still() {
    let still = Turning { rad_s: 0.0, frame: 0, gain: 1.0, ball_mm: 80.0 };
    let worst = deviation(still, f64::INFINITY, 100);
    assert!(worst < 0.1, "{worst} mm");
}

#[test]
fn a_groom_in_a_rigid_field_moves_rigidly() {
    let worst = deviation(Turning { rad_s: 4.0, frame: 0, gain: 1.0, ball_mm: 80.0 }, 0.0, 50);
    assert!(worst < 0.1, "{worst} mm");
}

#[test]
fn the_longer_it_takes_to_follow_the_more_hair_lags() {
    let lag = |follow_secs| deviation(Turning { rad_s: 6.0, frame: 0, gain: 1.0, ball_mm: 80.0 }, follow_secs, 20);
    let lags = [0.0, 0.01, 0.1, f64::INFINITY].map(lag);
    assert!(lags.windows(2).all(|pair| pair[0] < pair[1]), "{lags:?}");
}

#[test]
fn hair_without_a_field_lags_behind_a_turning_head() {
    let worst = deviation(Turning { rad_s: 6.0, frame: 0, gain: 1.0, ball_mm: 80.0 }, f64::INFINITY, 20);
    assert!(worst > 5.0, "{worst} mm");
}

#[test]
fn no_particle_is_carried_into_the_head_and_none_loses_its_edge() {
    struct Inwards(Turning);
    impl Surroundings for Inwards {
        fn world_from_head(&self, share: f64) -> RigidTransform {
            self.0.world_from_head(share)
        }
        fn velocity(&self, _: f64, point: DVec3) -> Option<DVec3> {
            Some((DVec3::new(40.0, -10.0, 1480.0) - point) * 20.0)
        }
        fn contact(&self, share: f64, point: DVec3) -> Option<Contact> {
            self.0.contact(share, point)
        }
    }
    let around = Inwards(Turning { rad_s: 0.0, frame: 0, gain: 0.0, ball_mm: 81.0 });
    let groom = groom(12);
    let (strands, mut state) = (hung(&groom), start(&groom, &around.0));
    (0..30).for_each(|_| advance_frame(&strands, &mut state, &around, &options(0.005)));
    let head_from_world = around.world_from_head(0.0).inverse();
    let mut starts = 0;
    for strand in &groom {
        for p in &state.points[starts + CLAMPED..starts + strand.len()] {
            let depth = 81.0 - head_from_world.point(p.as_dvec3()).length();
            assert!(depth < 0.02, "{depth} mm");
        }
        let moved = &state.points[starts..starts + strand.len()];
        for (groom, now) in strand.windows(2).zip(moved.windows(2)) {
            let stretch = f64::from(now[0].distance(now[1])) / groom[0].distance(groom[1]) - 1.0;
            assert!(stretch.abs() < 0.015, "an edge changed by {stretch}");
        }
        starts += strand.len();
    }
}

#[test]
fn lanes_and_threads_do_not_matter() {
    let around = Turning { rad_s: 5.0, frame: 0, gain: 0.8, ball_mm: 80.0 };
    let groom = groom(40);
    let strands = hung(&groom);
    let run = |threads: usize| {
        let mut state = start(&groom, &around);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| advance_frame(&strands, &mut state, &around, &options(0.02)));
        state
    };
    assert_eq!(run(1), run(2));
    let mut scalar = start(&groom, &around);
    advance_on::<f64>(&strands, &mut scalar, &around, &options(0.02));
    let wide = run(2);
    let apart = scalar.points.iter().zip(&wide.points).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
    assert!(apart < 0.02, "{apart} mm");
}
