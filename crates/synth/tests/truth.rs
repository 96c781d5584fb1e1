//! The capture agrees with its own truth.
#![allow(clippy::unwrap_used)] // a helper of a test may fail it

use glam::{DVec2, DVec3};
use strandflow_core::{Mask, RgbImage, Strands};
use strandflow_geometry::{polyline, project::project, triangulate::triangulate};
use strandflow_synth::{
    GroomSpec, MARKER_COLOURS, MotionSpec, NoiseSpec, Picture, RigSpec, Scene, Style, SynthSpec, body::Body, generate,
    head,
};

fn small(style: Style) -> SynthSpec {
    SynthSpec {
        seed: 7,
        rig: RigSpec { frames: 8, width: 200, height: 150, subsamples: 3, ..RigSpec::default() },
        groom: GroomSpec { strands: 400, guides: 50, width_mm: 1.2, ..GroomSpec::of_style(style) },
        motion: MotionSpec { quiet_frames: 2, ..MotionSpec::default() },
        noise: NoiseSpec::none(),
        ..SynthSpec::default()
    }
}

fn scene(spec: &SynthSpec) -> Scene {
    generate(spec).unwrap()
}

const STYLES: [Style; 3] = [Style::Straight, Style::Wavy, Style::Curly];

#[test]
fn strands_keep_their_length_and_stay_out_of_the_head() {
    for style in STYLES {
        let scene = scene(&small(style));
        let lengths = |s: &Strands| (0..s.strand_count()).map(|i| polyline::length(s.strand(i))).collect::<Vec<_>>();
        let first = scene.frame(0);
        let at_first = lengths(&first.strands);
        assert!(at_first.iter().any(|&l| l > 150.0), "{style:?}: hair is long");
        for t in 0..8 {
            let truth = scene.frame(t);
            assert_eq!(truth.strands.offsets, first.strands.offsets);
            for (i, (now, then)) in lengths(&truth.strands).iter().zip(&at_first).enumerate() {
                assert!((now / then - 1.0).abs() < 0.01, "{style:?} strand {i}: {then} became {now} mm");
            }
            let to_head = truth.world_from_head.inverse();
            let depths = truth.strands.points.iter().map(|p| -head::distance(to_head.point(p.as_dvec3())));
            let deepest = depths.fold(f64::NEG_INFINITY, f64::max);
            assert!(deepest < 1.0, "{style:?} frame {t}: {deepest} mm inside the head");
        }
    }
}

#[test]
fn long_hair_lies_on_the_body_and_the_body_is_seen() {
    let mut spec = small(Style::Straight);
    spec.groom = GroomSpec { length_mm: 330.0, cut_below_mm: 250.0, ..spec.groom };
    let floating = scene(&spec);
    spec.body.breadth_mm = 400.0;
    let (scene, body) = (scene(&spec), Body::of(&spec).unwrap());
    for t in 0..8 {
        let truth = scene.frame(t);
        let heights: Vec<f64> = truth.strands.points.iter().map(|p| body.distance(p.as_dvec3())).collect();
        let deepest = heights.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(deepest > -1.5, "frame {t}: {deepest} mm in the body");
        assert!(heights.iter().filter(|height| **height < 8.0).count() > 500, "some hair lies on it");
    }
    let covered = |mask: &Mask| mask.data.iter().filter(|coverage| **coverage >= 128).count();
    let (with, without) = (scene.render_view(3, 0), floating.render_view(3, 0));
    assert!(covered(&with.subject) > covered(&without.subject) + 500);
    assert!(covered(&with.hair) < covered(&with.subject) - 500, "cloth is no hair");
}

#[test]
fn hair_rests_with_the_head_and_lags_behind_its_swing() {
    for style in STYLES {
        let scene = scene(&small(style));
        // Root mean square way of the tips against the head between two frames [mm].
        let way = |a: usize, b: usize| {
            let (first, second) = (scene.frame(a), scene.frame(b));
            let (to_a, to_b) = (first.world_from_head.inverse(), second.world_from_head.inverse());
            let n = first.strands.strand_count();
            let sum: f64 = (0..n)
                .map(|i| {
                    let tip = first.strands.range(i).end - 1;
                    let p = to_a.point(first.strands.points[tip].as_dvec3());
                    p.distance_squared(to_b.point(second.strands.points[tip].as_dvec3()))
                })
                .sum();
            (sum / n as f64).sqrt()
        };
        let (rest, swing) = (way(0, 2), way(5, 7));
        assert!(rest < 2.5, "{style:?}: tips move {rest} mm while the head rests");
        assert!(swing > 1.5 && swing > 2.0 * rest, "{style:?}: tips move {swing} mm in the swing, {rest} mm at rest");
        assert!(scene.stable(8.0).iter().filter(|&&s| s).count() > 360);
    }
}

#[test]
fn the_truth_hardly_depends_on_the_step() {
    let with = |substeps: usize| {
        let mut spec = small(Style::Wavy);
        (spec.groom.strands, spec.groom.guides) = (60, 60);
        spec.physics.substeps = substeps;
        scene(&spec).frame(7).strands.points
    };
    let (usual, fine) = (with(10), with(30));
    let sum: f32 = usual.iter().zip(&fine).map(|(a, b)| a.distance_squared(*b)).sum();
    let rms = (sum / usual.len() as f32).sqrt();
    assert!(rms < 0.7, "{rms} mm between 1 ms and a third of it");
}

#[test]
fn the_same_bytes_at_any_number_of_threads() {
    let mut spec = small(Style::Curly);
    spec.noise = NoiseSpec { image_sigma: 2.0, blur_px: 0.4, sync_ms: 2.0, ..NoiseSpec::default() };
    let make = |threads: usize, spec: &SynthSpec| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let scene = scene(spec);
            (scene.frame(5), scene.render_view(2, 5), scene.plate(2))
        })
    };
    let one = make(1, &spec);
    assert!(one == make(3, &spec));
    spec.seed += 1;
    assert!(one.1.image != make(2, &spec).1.image, "the seed matters");
}

#[test]
fn masks_agree_with_the_difference_to_the_plate() {
    for style in [Style::Straight, Style::Curly] {
        let scene = scene(&small(style));
        for (view, picture) in scene.render(4).iter().enumerate() {
            let plate = scene.plate(view);
            let differs = |a: &[u8; 3], b: &[u8; 3]| (0..3).any(|c| a[c].abs_diff(b[c]) > 12);
            let (mut both, mut either) = (0, 0);
            for (i, &coverage) in picture.subject.data.iter().enumerate() {
                let (seen, said) = (differs(&picture.image.data[i], &plate.data[i]), coverage >= 64);
                both += usize::from(seen && said);
                either += usize::from(seen || said);
                assert!(picture.hair.data[i] <= coverage);
                assert!(coverage > 0 || picture.image.data[i] == plate.data[i], "where nothing is, the plate is seen");
            }
            assert!(both as f64 > 0.95 * either as f64, "{style:?} view {view}: {both} of {either} pixels");
        }
    }
}

#[test]
fn markers_are_where_they_project_and_triangulate_from_their_labels() {
    let scene = scene(&small(Style::Straight));
    let pictures = scene.render(0);
    let labels = scene.marker_labels(&pictures);
    let truth = scene.frame(0).markers;
    for (m, views) in labels.iter().enumerate() {
        let seen: Vec<_> =
            views.iter().enumerate().filter_map(|(v, at)| Some((&scene.given_rig.cameras[v], (*at)?))).collect();
        assert!(seen.len() >= 3, "marker {m} is seen in {} views", seen.len());
        let found = triangulate(&seen, 1.0).unwrap();
        assert!(found.point.distance(truth[m]) < 1e-3);
        for (v, at) in views.iter().enumerate() {
            let Some(at) = at else { continue };
            let colour = pictures[v].image.at_point(at.x, at.y).unwrap().map(f32::from);
            let expected = MARKER_COLOURS[m];
            let (brightest, darkest) = (largest(expected), largest(expected.map(|c| -c)));
            assert!(colour[brightest] >= colour[darkest], "marker {m} in view {v} has colour {colour:?}");
        }
    }
}

fn largest(values: [f32; 3]) -> usize {
    (0..3).max_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap()
}

/// Undirected direction of the nearest strand of each pixel.
fn directions(scene: &Scene, view: usize, frame: usize) -> Vec<Option<DVec2>> {
    let camera = &scene.rig.cameras[view];
    let strands = scene.frame(frame).strands;
    let mut nearest = vec![(f64::INFINITY, None); camera.width * camera.height];
    for i in 0..strands.strand_count() {
        for pair in strands.strand(i).windows(2) {
            let (a, b) = (pair[0].as_dvec3(), pair[1].as_dvec3());
            let (p, q) = (project(camera, a).unwrap(), project(camera, b).unwrap());
            for s in 0..12 {
                let share = (s as f64 + 0.5) / 12.0;
                let at = p.lerp(q, share);
                let depth = camera.camera_from_world.point(a.lerp(b, share)).z;
                if at.x < 0.0 || at.y < 0.0 || at.x as usize >= camera.width || at.y as usize >= camera.height {
                    continue;
                }
                let slot: &mut (f64, Option<DVec2>) = &mut nearest[at.y as usize * camera.width + at.x as usize];
                if depth < slot.0 {
                    *slot = (depth, (q - p).try_normalize());
                }
            }
        }
    }
    nearest.into_iter().map(|n| n.1).collect()
}

/// Direction of least change over a window (structure tensor; Bigün and Granlund 1987), with its coherence.
fn structure(image: &RgbImage, x: usize, y: usize) -> (DVec2, f64) {
    const REACH: isize = 2;
    let light = |x: isize, y: isize| image[(x as usize, y as usize)].iter().map(|&c| c as f64).sum::<f64>();
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for dy in -REACH..=REACH {
        for dx in -REACH..=REACH {
            let (u, v) = (x as isize + dx, y as isize + dy);
            let (gx, gy) = (light(u + 1, v) - light(u - 1, v), light(u, v + 1) - light(u, v - 1));
            (xx, xy, yy) = (xx + gx * gx, xy + gx * gy, yy + gy * gy);
        }
    }
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy) + std::f64::consts::FRAC_PI_2;
    (DVec2::from_angle(angle), (xx - yy).hypot(2.0 * xy) / (xx + yy + 1e-9))
}

#[test]
fn image_texture_runs_along_the_projected_strands() {
    let mut spec = small(Style::Straight);
    spec.rig = RigSpec { frames: 1, width: 400, height: 300, ..RigSpec::default() };
    spec.groom = GroomSpec { strands: 1500, ..GroomSpec::default() };
    spec.groom.width_mm = 0.7;
    let scene = scene(&spec);
    let view = 3;
    let picture = scene.render_view(view, 0);
    let directions = directions(&scene, view, 0);
    let inside = |x: usize, y: usize| (0..49).all(|i| picture.hair[(x + i % 7 - 3, y + i / 7 - 3)] > 200);
    let mut errors = Vec::new();
    for y in 4..296 {
        for x in 4..396 {
            let Some(true_direction) = directions[y * 400 + x].filter(|_| inside(x, y)) else { continue };
            let (seen, coherence) = structure(&picture.image, x, y);
            if coherence > 0.4 {
                errors.push(seen.dot(true_direction).abs().min(1.0).acos().to_degrees());
            }
        }
    }
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    assert!(errors.len() > 3000, "{} textured pixels", errors.len());
    assert!(mean < 15.0, "mean error {mean:.1}°");
}

#[test]
fn every_dial_does_what_it_says() {
    let clean = scene(&small(Style::Straight));
    let first = clean.render_view(3, 0);

    let with = |noise: NoiseSpec| scene(&SynthSpec { noise, ..small(Style::Straight) });
    let none = NoiseSpec::none;

    let (noisy, plate) = (with(NoiseSpec { image_sigma: 4.0, ..none() }).plate(3), clean.plate(3));
    let pairs = noisy.data.as_flattened().iter().zip(plate.data.as_flattened());
    let sum: f64 = pairs.map(|(&a, &b)| (a as f64 - b as f64).powi(2)).sum();
    let deviation = (sum / (3 * noisy.data.len()) as f64).sqrt();
    assert!((deviation - 4.0).abs() < 0.15, "{deviation} levels");

    let disc = |x: usize, y: usize| if (x as f64 - 100.0).hypot(y as f64 - 75.0) < 40.0 { 255 } else { 0 };
    let drawn = Picture { hair: Mask::from_fn(200, 150, disc), ..first.clone() };
    let overlap = iou(&with(NoiseSpec { mask_px: 2.0, ..none() }).given_hair_mask(3, &drawn), &drawn.hair);
    assert!(overlap > 0.85 && overlap < 0.98, "mask overlap {overlap}");
    assert_eq!(clean.given_hair_mask(3, &first), first.hair);

    let off = with(NoiseSpec { calibration_px: 1.0, ..none() });
    let moved: Vec<f64> = off
        .rig
        .cameras
        .iter()
        .zip(&off.given_rig.cameras)
        .map(|(a, b)| {
            let p = DVec3::new(0.0, 0.0, 1250.0);
            project(a, p).unwrap().distance(project(b, p).unwrap())
        })
        .collect();
    let rms = (moved.iter().map(|d| d * d).sum::<f64>() / moved.len() as f64).sqrt();
    assert!(rms > 0.5 && rms < 2.5, "{rms} px");

    let late = with(NoiseSpec { sync_ms: 8.0, ..none() });
    assert!(late.delays.iter().all(|d| d.abs() <= 0.8) && late.delays.iter().any(|d| d.abs() > 0.2));
    let shift = |s: &Scene| s.marker_points(3, 7)[0].unwrap();
    assert!(shift(&late).distance(shift(&clean)) > 0.05);

    let blurred = with(NoiseSpec { blur_px: 1.5, ..none() }).render_view(3, 0);
    assert!(roughness(&blurred) < 0.6 * roughness(&first));
}

fn iou(a: &Mask, b: &Mask) -> f64 {
    let count =
        |f: fn(bool, bool) -> bool| a.data.iter().zip(&b.data).filter(|(a, b)| f(**a >= 128, **b >= 128)).count();
    count(|a, b| a && b) as f64 / count(|a, b| a || b) as f64
}

fn roughness(picture: &Picture) -> f64 {
    picture.image.data.windows(2).map(|p| p[0][1].abs_diff(p[1][1]) as f64).sum()
}

#[test]
fn specs_are_checked_in_full() {
    let mut spec = small(Style::Straight);
    spec.rig.views = 0;
    spec.groom.guides = 401;
    spec.noise.blur_px = f64::NAN;
    let fields: Vec<&str> = generate(&spec).err().unwrap().iter().map(|v| v.field).collect();
    assert_eq!(fields, ["rig.views", "groom.guides", "noise.blur_px"]);
    for style in STYLES {
        assert!(SynthSpec::demo(style).check().is_empty() && SynthSpec::full(style, 200).check().is_empty());
    }
}
