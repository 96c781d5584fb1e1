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

const GRID: Grid = Grid { origin: DVec3::splat(-190.0), voxel_mm: 2.0, dims: [190, 190, 140] };

/// The middle frame of five, blended with fields of the strands themselves; the hull is everywhere.
fn blended(sequence: &StrandSequence, mode: Mode) -> StrandSequence {
    blended_in(sequence, &everywhere(), mode)
}

fn everywhere() -> Occupancy {
    let mut hull = Occupancy::empty(GRID);
    (0..GRID.len()).for_each(|voxel| hull.set(voxel, true));
    hull
}

/// The same where the simulations are off by this much.
fn blended_by(sequence: &StrandSequence, residual_mm: &[f32]) -> StrandSequence {
    blended_of(sequence, &everywhere(), residual_mm, Mode::Robust)
}

/// The same in a hull.
fn blended_in(sequence: &StrandSequence, hull: &Occupancy, mode: Mode) -> StrandSequence {
    blended_of(sequence, hull, &vec![0.5; sequence.strand_count], mode)
}

fn blended_of(sequence: &StrandSequence, hull: &Occupancy, residual_mm: &[f32], mode: Mode) -> StrandSequence {
    let grid = GRID;
    let frame_points =
        |t: usize| &sequence.points[t * sequence.strand_count * POINTS..][..sequence.strand_count * POINTS];
    let fields: Vec<SparseVoxels<Vec3>> = (1..4)
        .map(|t| {
            let points = [frame_points(t - 1), frame_points(t), frame_points(t + 1)];
            let input = FlowInput {
                frame: t,
                grid,
                hull: &Occupancy::empty(grid),
                points,
                point_count: POINTS,
                span_secs: 2.0 * SECS,
            };
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
        residual_mm,
        hull,
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
fn strands_that_left_the_hull_come_back_with_their_lengths() {
    let mut counts = [POINTS as u16; STRANDS];
    // One strand is absent and completed.
    counts[2] = 0;
    let clean = sequence(7, 0.0, &counts);
    let free = blended(&clean, Mode::Robust);
    // A hull that ends above the lowest tenth of the points.
    let mut heights: Vec<f32> = free.points.iter().map(|p| p.z).filter(|z| z.is_finite()).collect();
    heights.sort_by(f32::total_cmp);
    let floor = f64::from(heights[heights.len() / 10]);
    let mut hull = Occupancy::empty(GRID);
    (0..GRID.len()).filter(|&v| GRID.centre_of_index(v).z > floor).for_each(|voxel| hull.set(voxel, true));
    let lowest = |strands: &StrandSequence| strands.points.iter().map(|p| p.z).fold(f32::INFINITY, f32::min);
    let kept = blended_in(&clean, &hull, Mode::Robust);
    let floor = floor as f32;
    assert!(lowest(&free) < floor - 8.0, "nothing leaves this hull: {} {floor}", lowest(&free));
    // A voxel of twice the size, and the slack.
    assert!(lowest(&kept) > floor - 4.5, "{} {floor}", lowest(&kept));
    assert!(lowest(&blended_in(&clean, &hull, Mode::Paper)) < floor - 8.0, "the paper knows no hull");
    for n in 0..STRANDS {
        let edges = |s: &StrandSequence| s.strand(0, n).windows(2).map(|e| e[0].distance(e[1])).collect::<Vec<f32>>();
        edges(&kept).iter().zip(edges(&free)).for_each(|(a, b)| assert!((a - b).abs() < 0.05, "{n}: {a} {b}"));
        let inside = |p: &&Vec3| p.z > floor + 20.0;
        let (same, all) = kept
            .strand(0, n)
            .iter()
            .zip(free.strand(0, n))
            .filter(|(_, b)| inside(b))
            .fold((0, 0), |(s, a), (x, y)| (s + usize::from(x == y), a + 1));
        assert_eq!(same, all, "{n}: what is far inside stays");
    }
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

fn distance_to_edge(point: DVec3, [a, b]: [DVec3; 2]) -> f64 {
    let along = ((point - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
    point.distance(a + (b - a) * along)
}

#[test]
fn strands_that_no_simulation_explains_lend_nothing() {
    let mut counts = [POINTS as u16; STRANDS];
    counts[23] = 0;
    let clean = sequence(7, 0.0, &counts);
    let nearest = (0..STRANDS)
        .filter(|n| *n != 23)
        .min_by(|a, b| root(*a).distance(root(23)).total_cmp(&root(*b).distance(root(23))));
    let nearest = nearest.unwrap();
    let mut residual_mm = vec![0.5; STRANDS];
    let good = blended_by(&clean, &residual_mm);
    residual_mm[nearest] = 5.0;
    let bad = blended_by(&clean, &residual_mm);
    let tip = |s: &StrandSequence, n: usize| s.strand(0, n)[POINTS - 1].as_dvec3();
    assert!(tip(&good, 23).distance(tip(&good, nearest)) < 2.0);
    assert!(tip(&bad, 23).distance(tip(&bad, nearest)) > 4.0, "it still follows the strand beside it");
    assert_eq!(tip(&good, nearest), tip(&bad, nearest));
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
        // From its own root to the way of the strand beside it.
        assert!(results[0].strand(0, n)[0].as_dvec3().distance(pose(9.0).point(root(n))) < 1e-3);
        let tip = results[0].strand(0, n)[results[0].counts[n] as usize - 1].as_dvec3();
        let beside =
            (0..STRANDS).filter(|m| results[0].provenance[results[0].range(0, *m).start] != Provenance::Completed);
        let off = |m: usize| -> f64 {
            let strand = results[0].strand(0, m);
            strand
                .windows(2)
                .map(|e| distance_to_edge(tip, [e[0].as_dvec3(), e[1].as_dvec3()]))
                .fold(f64::INFINITY, f64::min)
        };
        let off = beside.map(off).fold(f64::INFINITY, f64::min);
        assert!(off < 0.5, "the tip of strand {n} is {off} mm off all others");
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
