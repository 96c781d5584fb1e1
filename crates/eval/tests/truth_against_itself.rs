//! A sequence made of the truth scores perfectly; known damage gives known figures.

use std::path::PathBuf;

use glam::{DVec3, Vec3};
use strandflow_core::{Camera, Distortion, Provenance, Rig, RigidTransform, StrandSequence};
use strandflow_eval::{
    DynamicsSampling, StrandSampling, Truth, evaluate_dynamics, evaluate_refinement, evaluate_strands,
};

const POINTS: usize = 30;

/// Strands 30 mm apart that swing about the z axis and hang; 12 frames.
fn truth() -> Truth {
    let strand_count = 25;
    let place = |t: usize, n: usize, p: usize| {
        let root = Vec3::new((n % 5) as f32 * 30.0, (n / 5) as f32 * 30.0, 0.0);
        let swing = 20.0 * (0.5 * t as f32).sin() * (p as f32 / POINTS as f32).powi(2);
        root + Vec3::new(swing, 0.5 * swing, -5.0 * p as f32)
    };
    let frame = |t: usize| (0..strand_count).flat_map(|n| (0..POINTS).map(move |p| place(t, n, p))).collect();
    Truth {
        frames: (0..12).collect(),
        points: (0..12).map(frame).collect(),
        offsets: (0..=strand_count).map(|n| (n * POINTS) as u32).collect(),
        stable: vec![true; strand_count],
        world_from_head: vec![RigidTransform::IDENTITY; 12],
        ..Truth::default()
    }
}

/// The truth as a sequence, every point moved by `f(frame, strand, particle)`.
fn sequence(truth: &Truth, f: impl Fn(usize, usize, usize) -> Vec3) -> StrandSequence {
    let counts = vec![POINTS as u16; truth.strand_count()];
    let mut out = StrandSequence::missing(truth.frames.clone(), counts, POINTS);
    for t in 0..truth.frames.len() {
        for n in 0..truth.strand_count() {
            for (p, i) in out.range(t, n).enumerate() {
                out.points[i] = truth.strand(t, n)[p] + f(t, n, p);
                (out.provenance[i], out.confidence[i]) = (Provenance::Observed, 1.0);
            }
        }
    }
    out
}

fn rig() -> Rig {
    let camera = |i: usize| Camera {
        name: format!("cam{i:02}"),
        width: 640,
        height: 480,
        focal: [1400.0; 2],
        principal: [320.0, 240.0],
        distortion: Distortion::None,
        camera_from_world: RigidTransform {
            rotation: glam::DMat3::from_rotation_y(i as f64 * 0.8) * glam::DMat3::from_rotation_x(1.57),
            translation: DVec3::new(-40.0, -60.0, 1500.0),
        },
    };
    Rig { cameras: (0..3).map(camera).collect() }
}

#[test]
fn the_truth_is_perfect() {
    let truth = truth();
    let same = sequence(&truth, |_, _, _| Vec3::ZERO);
    let scores = evaluate_strands(&same, &truth, &rig(), &StrandSampling::default());
    for threshold in &scores.thresholds {
        assert_eq!((threshold.all.f1, threshold.visible.f1), (1.0, 1.0));
    }
    assert_eq!((scores.consistency, scores.consistency_within, scores.strands), (1.0, 1.0, 25.0));
    assert_eq!((scores.occupancy.f1, scores.surface_mm), (1.0, (0.0, 0.0)));
    let motion = evaluate_dynamics(&same, &truth, &DynamicsSampling::default());
    assert!(motion.position_mm.max < 1e-3 && motion.velocity_mm_s.max < 0.1 && motion.velocity_share < 1e-3);
    assert!((motion.jerk_ratio - 1.0).abs() < 1e-3 && (motion.border_ratio - 1.0).abs() < 1e-3);
    assert!(motion.jitter_excess_mm.abs() < 1e-4 && motion.identity_switches == 0.0);
    assert_eq!(motion.strands, (25, 25));
}

#[test]
fn a_shift_of_three_and_a_half_millimetres_passes_only_the_widest_threshold() {
    let truth = truth();
    let shifted = sequence(&truth, |_, _, _| Vec3::new(0.0, 3.5, 0.0));
    let scores = evaluate_strands(&shifted, &truth, &Rig::default(), &StrandSampling::default());
    let f1: Vec<f64> = scores.thresholds.iter().map(|t| t.all.f1).collect();
    assert!(f1[0] < 0.05 && f1[1] < 0.1 && f1[2] > 0.99, "{f1:?}");
    let motion = evaluate_dynamics(&shifted, &truth, &DynamicsSampling::default());
    assert!((motion.position_mm.median - 3.5).abs() < 0.15, "{}", motion.position_mm.median);
    assert!(motion.velocity_mm_s.mean < 0.2 * motion.true_speed_mm_s);
}

#[test]
fn what_a_refinement_fills_in_does_not_count_where_only_the_given_samples_do() {
    let truth = truth();
    let mut input = sequence(&truth, |_, _, _| Vec3::new(0.0, 2.0, 0.0));
    // The input lacks the tips, the refinement has them 9 mm off.
    for t in 0..truth.frames.len() {
        for n in 0..truth.strand_count() {
            input.range(t, n).skip(20).for_each(|e| input.points[e] = Vec3::NAN);
        }
    }
    let filled = sequence(&truth, |_, _, p| Vec3::new(0.0, if p < 20 { 1.0 } else { 9.0 }, 0.0));
    let sampling = DynamicsSampling::default();
    let of_input =
        |sequence| evaluate_refinement(sequence, &input, &truth, &sampling).position_of_input_mm.unwrap().mean;
    assert!(evaluate_refinement(&filled, &input, &truth, &sampling).position_mm.mean > 3.0);
    assert!((of_input(&filled) - 1.0).abs() < 0.1, "{}", of_input(&filled));
    assert!((of_input(&input) - 2.0).abs() < 0.1, "{}", of_input(&input));
}

#[test]
fn half_of_the_strands_gives_full_precision_and_half_recall() {
    let truth = truth();
    let mut half = sequence(&truth, |_, _, _| Vec3::ZERO);
    for n in (1..truth.strand_count()).step_by(2) {
        half.counts[n] = 0;
    }
    let scores = evaluate_strands(&half, &truth, &Rig::default(), &StrandSampling::default());
    let all = scores.thresholds[1].all;
    assert_eq!(all.precision, 1.0);
    assert!((all.recall - 13.0 / 25.0).abs() < 1e-9 && (all.f1 - 2.0 * 0.52 / 1.52).abs() < 1e-9);
}

#[test]
fn strands_behind_the_true_ones_show_as_depth_and_elsewhere_occupy_other_voxels() {
    let truth = truth();
    // Away from the first view, which alone looks: along its optical axis.
    let rig = Rig { cameras: rig().cameras.into_iter().take(1).collect() };
    let away = rig.cameras[0].camera_from_world.rotation.row(2).as_vec3();
    let behind = sequence(&truth, |_, _, _| away * 5.0);
    let (error, median) = evaluate_strands(&behind, &truth, &rig, &StrandSampling::default()).surface_mm;
    assert!((error - 5.0).abs() < 0.2 && (median - 5.0).abs() < 0.2, "{error} {median}");
    let aside = sequence(&truth, |_, _, _| Vec3::splat(1000.0));
    assert_eq!(evaluate_strands(&aside, &truth, &rig, &StrandSampling::default()).occupancy.f1, 0.0);
}

#[test]
fn strands_that_stand_still_err_by_all_of_the_speed() {
    let truth = truth();
    let still = sequence(&truth, |t, n, p| truth.strand(0, n)[p] - truth.strand(t, n)[p]);
    let motion = evaluate_dynamics(&still, &truth, &DynamicsSampling::default());
    assert!((motion.velocity_share - 1.0).abs() < 0.05, "{}", motion.velocity_share);
}

#[test]
fn strands_that_change_place_in_time_are_identity_switches() {
    let truth = truth();
    // From frame 6 on every strand stands where another one was.
    let swapped =
        sequence(
            &truth,
            |t, n, _| {
                if t < 6 { Vec3::ZERO } else { truth.strand(0, (n + 1) % 25)[0] - truth.strand(0, n)[0] }
            },
        );
    let motion = evaluate_dynamics(&swapped, &truth, &DynamicsSampling::default());
    assert!((motion.identity_switches - 100.0 / 11.0).abs() < 1e-9, "{}", motion.identity_switches);
    // Shape alone is still perfect.
    let scores = evaluate_strands(&swapped, &truth, &Rig::default(), &StrandSampling::default());
    assert!(scores.thresholds[0].all.f1 > 0.999);
}

#[test]
fn noise_gives_the_jitter_of_its_second_difference() {
    let truth = truth();
    // Alternating by ±0.5 mm in x: the second difference is 2 mm.
    let shaken = sequence(&truth, |t, _, _| Vec3::X * if t % 2 == 0 { 0.5 } else { -0.5 });
    let motion = evaluate_dynamics(&shaken, &truth, &DynamicsSampling::default());
    let expected = (motion.true_jitter_mm.powi(2) + 4.0).sqrt();
    assert!((motion.jitter_mm - expected).abs() < 0.15, "{} {expected}", motion.jitter_mm);
    assert!(motion.jerk_ratio > 2.0);
}

#[test]
fn a_strand_that_breathes_has_the_known_length_variation() {
    let truth = truth();
    let breathing = sequence(&truth, |t, _, p| Vec3::Z * (if t % 2 == 0 { 0.05 } else { -0.05 } * -5.0 * p as f32));
    let motion = evaluate_dynamics(&breathing, &truth, &DynamicsSampling::default());
    assert!((motion.length_variation.median - 0.05).abs() < 0.003, "{:?}", motion.length_variation);
    assert_eq!(motion.length_within_two_percent, 0.0);
}

#[test]
fn captures_score_perfectly_against_themselves() {
    let folder = std::env::var_os("STRANDFLOW_CAPTURES")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/captures")), PathBuf::from);
    let gt = folder.join("dev-straight/gt");
    if !gt.is_dir() {
        println!("skipped: captures not found");
        return;
    }
    let truth = strandflow_eval::truth::read(&gt).unwrap();
    assert_eq!((truth.frames.len(), truth.strand_count(), truth.markers.len()), (30, 4500, 10));
    // Roots lie on the head, in the first frame as in the last.
    for t in [0usize, 29] {
        let head = strandflow_geometry::mesh_distance::MeshDistance::new(&truth.head_at(t as u32));
        let off: Vec<f64> = (0..4500)
            .step_by(50)
            .map(|n| head.nearest(truth.strand(t, n)[0].as_dvec3()).unwrap().signed_distance.abs())
            .collect();
        let mut sorted = off.clone();
        sorted.sort_by(f64::total_cmp);
        assert!(sorted[sorted.len() / 2] < 1.0, "median root off the head by {}", sorted[sorted.len() / 2]);
    }
    let points = truth.strand(0, 0).len();
    // Strands that jump are not among those that motion is compared with.
    let counts = truth.stable.iter().map(|stable| if *stable { points as u16 } else { 0 }).collect();
    let mut same = StrandSequence::missing(truth.frames.clone(), counts, points);
    for t in 0..30 {
        let len = truth.points[t].len();
        same.points[t * len..(t + 1) * len].copy_from_slice(&truth.points[t]);
    }
    same.provenance.fill(Provenance::Observed);
    let sampling = StrandSampling { frames: 1, ..StrandSampling::default() };
    let scores = evaluate_strands(&same, &truth, &Rig::default(), &sampling);
    assert!(scores.thresholds[0].all.precision > 0.9999 && scores.thresholds[0].all.f1 > 0.97);
    let motion = evaluate_dynamics(&same, &truth, &DynamicsSampling { strands: 150, ..DynamicsSampling::default() });
    assert!(motion.position_mm.p95 < 0.01 && motion.identity_switches < 1.0, "{motion:?}");
}
