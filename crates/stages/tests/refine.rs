//! Stages 12 and 13 on strands whose motion is known: what the refinement keeps, what it removes, what it completes.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

use glam::{DMat3, DVec3, Vec3};
use strandflow_core::{Grid, Occupancy, Provenance, Report, RigidTransform, SparseVoxels, StrandSequence};
use strandflow_stages::Mode;
use strandflow_stages::blend::{BlendInput, BlendSettings, blend};
use strandflow_stages::flow::{FlowInput, FlowSettings, flow};

const SECS: f64 = 0.01;
const STRANDS: usize = 60;
const POINTS: usize = 24;

/// A head that shakes at 1.6 Hz and ±46°, hair that swings with it as a whole (edges exactly 5 mm).
fn pose(frame: f64) -> RigidTransform {
    let angle = 0.8 * (std::f64::consts::TAU * 1.6 * SECS * frame).sin();
    RigidTransform { rotation: DMat3::from_rotation_z(angle), translation: DVec3::ZERO }
}

fn root(n: usize) -> DVec3 {
    DVec3::new(60.0 + (n % 10) as f64 * 4.0, (n / 10) as f64 * 4.0 - 10.0, 60.0)
}

fn truth(frame: f64, n: usize, p: usize) -> DVec3 {
    pose(frame).point(root(n) + DVec3::new(0.6, 0.0, -0.8) * (5.0 * p as f64))
}

/// A noise of standard deviation `sigma` that depends on nothing but its arguments.
fn noise(frame: usize, n: usize, p: usize, sigma: f64) -> DVec3 {
    let mut state = (frame as u64 * 1_000_003 + n as u64) * 1_000_033 + p as u64 + 1;
    let mut uniform = || {
        state = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9).wrapping_add(0x9E37_79B9_7F4A_7C15);
        ((state ^ (state >> 29)) >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    let mut normal = || (0..12).map(|_| uniform()).sum::<f64>();
    DVec3::new(normal(), normal(), normal()) * if p < 3 { 0.0 } else { sigma }
}

fn sequence(start: usize, sigma: f64, counts: &[u16]) -> StrandSequence {
    let frames: Vec<u32> = (start as u32..start as u32 + 5).collect();
    let mut out = StrandSequence::missing(frames.clone(), counts.to_vec(), POINTS);
    for (t, frame) in frames.iter().enumerate() {
        for n in 0..counts.len() {
            for (p, i) in out.range(t, n).enumerate() {
                out.points[i] = (truth(*frame as f64, n, p) + noise(*frame as usize, n, p, sigma)).as_vec3();
                (out.provenance[i], out.confidence[i]) = (Provenance::Observed, 1.0);
            }
        }
    }
    out
}

/// The middle frame of five, blended with fields of the strands themselves.
fn blended(sequence: &StrandSequence, mode: Mode) -> StrandSequence {
    let grid = Grid { origin: DVec3::splat(-190.0), voxel_mm: 2.0, dims: [190, 190, 140] };
    let hull = Occupancy::empty(grid);
    let frame_points =
        |t: usize| &sequence.points[t * sequence.strand_count * POINTS..][..sequence.strand_count * POINTS];
    let fields: Vec<SparseVoxels<Vec3>> = (1..4)
        .map(|t| {
            let points = [frame_points(t - 1), frame_points(t), frame_points(t + 1)];
            let input = FlowInput { frame: t, grid, hull: &hull, points, point_count: POINTS, span_secs: 2.0 * SECS };
            flow(&input, mode, &FlowSettings::default(), &mut Report::default()).unwrap()
        })
        .collect();
    let mut three = StrandSequence::missing(sequence.frames[1..4].to_vec(), sequence.counts.clone(), POINTS);
    let size = sequence.strand_count * POINTS;
    three.points.copy_from_slice(&sequence.points[size..4 * size]);
    three.provenance.copy_from_slice(&sequence.provenance[size..4 * size]);
    three.confidence.copy_from_slice(&sequence.confidence[size..4 * size]);
    let input = BlendInput {
        at: 1,
        sequence: &three,
        fields: &fields.iter().collect::<Vec<_>>(),
        world_from_head: &three.frames.iter().map(|f| pose(*f as f64)).collect::<Vec<_>>(),
        roots: &(0..sequence.strand_count).map(root).collect::<Vec<_>>(),
        frame_secs: SECS,
        edge_mm: 5.0,
    };
    blend(&input, mode, &BlendSettings::default(), &mut Report::default()).unwrap()
}

fn mean_error(result: &StrandSequence, frame: f64) -> f64 {
    let errors: Vec<f64> = (0..result.strand_count)
        .flat_map(|n| result.range(0, n).enumerate().map(move |(p, i)| (n, p, i)))
        .map(|(n, p, i)| result.points[i].as_dvec3().distance(truth(frame, n, p)))
        .collect();
    errors.iter().sum::<f64>() / errors.len() as f64
}

#[test]
fn clean_motion_is_hardly_damaged_even_where_it_accelerates_most() {
    // Frame 15–16 is a turning point of the shake: 90 rad/s² on a lever of 60–160 mm.
    let clean = sequence(14, 0.0, &[POINTS as u16; STRANDS]);
    let damage = mean_error(&blended(&clean, Mode::Robust), 16.0);
    println!("clean damage {damage:.3} mm");
    assert!(damage < 0.1, "{damage} mm");
}

#[test]
fn noise_falls_and_lengths_return() {
    let noisy = sequence(7, 1.0, &[POINTS as u16; STRANDS]);
    let before: f64 = {
        let middle = StrandSequence {
            frames: vec![9],
            points: noisy.points[2 * STRANDS * POINTS..3 * STRANDS * POINTS].to_vec(),
            ..noisy.clone()
        };
        mean_error(&middle, 9.0)
    };
    let result = blended(&noisy, Mode::Robust);
    let after = mean_error(&result, 9.0);
    println!("noise error {before:.3} -> {after:.3} mm");
    assert!(after < 0.75 * before, "{before} -> {after}");
    for n in 0..STRANDS {
        let edges: Vec<f32> = result.strand(0, n).windows(2).map(|e| e[0].distance(e[1])).collect();
        assert!(edges.iter().all(|edge| (edge - 5.0).abs() < 0.25), "{edges:?}");
        for p in 0..3 {
            assert!(result.strand(0, n)[p].as_dvec3().distance(truth(9.0, n, p)) < 1e-3);
        }
    }
}

#[test]
fn absent_strands_are_completed_alike_in_every_frame() {
    let mut counts = [POINTS as u16; STRANDS];
    (counts[23], counts[24], counts[41]) = (0, 0, 0);
    (counts[22], counts[33], counts[13]) = (18, 18, 18);
    let results: Vec<StrandSequence> =
        [7, 8].iter().map(|&s| blended(&sequence(s, 0.0, &counts), Mode::Robust)).collect();
    assert_eq!(results[0].counts, results[1].counts);
    assert!(results[0].counts.iter().all(|&count| count >= 18));
    for n in [23, 24, 41] {
        assert!(results[0].range(0, n).all(|i| results[0].provenance[i] == Provenance::Completed));
        let last = results[0].counts[n] as usize - 1;
        let off = results[0].strand(0, n)[last].as_dvec3().distance(truth(9.0, n, last));
        assert!(off < 0.5, "strand {n} tip {off} mm off");
        assert!(results[0].strand(0, n).windows(2).all(|e| (e[0].distance(e[1]) - 5.0).abs() < 1e-3));
    }
    assert!(results[0].range(0, 0).all(|i| results[0].provenance[i] == Provenance::Observed));
}

#[test]
fn paper_mode_runs_the_letter() {
    let clean = sequence(7, 0.0, &[POINTS as u16; STRANDS]);
    let result = blended(&clean, Mode::Paper);
    assert!(result.points.iter().all(|p| p.is_finite()));
    // The damped field leaves the neighbours behind, on both sides alike: small where the motion is even.
    assert!(mean_error(&result, 9.0) < 5.0);
}
