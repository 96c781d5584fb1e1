use super::*;
use strandflow_core::{Distortion, RigidTransform};

/// Cameras a metre away around the origin, `angle` apart.
fn cameras(count: usize, angle: f64) -> Vec<Camera> {
    let lens = Distortion::BrownConrady([-0.2, 0.05, 1e-3, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let camera = |i: usize| Camera {
        name: format!("c{i}"),
        width: 1280,
        height: 960,
        focal: [1800.0; 2],
        principal: [640.0, 480.0],
        distortion: lens,
        camera_from_world: RigidTransform {
            rotation: DMat3::from_rotation_x(0.1 * i as f64) * DMat3::from_rotation_y(i as f64 * angle),
            translation: DVec3::new(0.0, 0.0, 1000.0),
        },
    };
    (0..count).map(camera).collect()
}

/// A wavy strand of about 220 mm that falls along y, 201 points.
fn strand() -> Vec<DVec3> {
    let at = |s: f64| DVec3::new(30.0 * s * s + 8.0 * (9.0 * s).sin(), -90.0 + 190.0 * s, 40.0 + 6.0 * (9.0 * s).cos());
    (0..=200).map(|i| at(f64::from(i) / 200.0)).collect()
}

/// A hand's drawing: places that differ by view, and noise of a standard deviation of `noise` px in both directions.
fn drawing(camera: &Camera, strand: &[DVec3], step: usize, noise: f64) -> Vec<DVec2> {
    let mut seed = camera.name.bytes().fold(7u64, |a, b| a.wrapping_mul(31).wrapping_add(u64::from(b)));
    let mut uniform = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((seed >> 33) as f64 / f64::from(1u32 << 31) - 0.5) * 2.0
    };
    // The sum of three uniform numbers has the variance 1.
    let mut normal = move || uniform() + uniform() + uniform();
    let mut seen: Vec<DVec2> = strand.iter().step_by(step).filter_map(|p| project(camera, *p)).collect();
    seen.extend(strand.last().filter(|_| !(strand.len() - 1).is_multiple_of(step)).and_then(|p| project(camera, *p)));
    seen.iter().map(|p| *p + DVec2::new(normal(), normal()) * noise).collect()
}

/// Root mean square and largest distance of the curve's points to a dense strand \[mm\].
fn off(curve: &DrawnCurve, truth: &[DVec3]) -> (f64, f64) {
    let to_segment = |p: DVec3, a: DVec3, b: DVec3| {
        let part = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
        p.distance(a.lerp(b, part))
    };
    let distance =
        |p: &DVec3| truth.windows(2).map(|pair| to_segment(*p, pair[0], pair[1])).fold(f64::INFINITY, f64::min);
    let all: Vec<f64> = curve.points.iter().map(distance).collect();
    let mean = all.iter().map(|d| d * d).sum::<f64>() / all.len() as f64;
    (mean.sqrt(), all.iter().copied().fold(0.0, f64::max))
}

fn length(points: &[DVec3]) -> f64 {
    points.windows(2).map(|pair| pair[0].distance(pair[1])).sum()
}

fn curve(count: usize, angle: f64, noise: f64) -> DrawnCurve {
    let (cameras, strand) = (cameras(count, angle), strand());
    let drawings: Vec<Vec<DVec2>> =
        cameras.iter().enumerate().map(|(i, camera)| drawing(camera, &strand, 7 + 3 * i, noise)).collect();
    let views: Vec<(&Camera, &[DVec2])> = cameras.iter().zip(&drawings).map(|(c, d)| (c, d.as_slice())).collect();
    curve_from_drawings(&views).unwrap()
}

#[test]
fn exact_drawings_give_the_strand() {
    for (views, angle) in [(2, 0.9), (3, 0.6)] {
        let curve = curve(views, angle, 0.0);
        let (rms, worst) = off(&curve, &strand());
        // Drawn with corners 7 and more points apart: their chords cut the waves by up to 0.3 mm.
        assert!(rms < 0.35 && worst < 1.0, "{views} views: {rms} {worst}");
        assert!((length(&curve.points) / length(&strand()) - 1.0).abs() < 0.01);
        assert!(curve.rms_px < 0.5, "{}", curve.rms_px);
    }
}

#[test]
fn a_pixel_of_noise_costs_less_than_a_pixel_in_space() {
    // A pixel is 0.56 mm across the view and, under 0.9 rad, 0.6 mm in depth.
    for (views, angle, most) in [(2, 0.9, 0.9), (3, 0.6, 0.8), (4, 0.5, 0.7)] {
        let curve = curve(views, angle, 1.0);
        let (rms, worst) = off(&curve, &strand());
        assert!(rms < most && worst < 4.0 * most, "{views} views: {rms} {worst}");
        let ratio = length(&curve.points) / length(&strand());
        assert!((ratio - 1.0).abs() < 0.02, "{views} views: length by {ratio}");
    }
}

#[test]
fn one_drawing_or_parallel_rays_give_nothing() {
    let (cameras, strand) = (cameras(2, 0.0), strand());
    let drawn = drawing(&cameras[0], &strand, 9, 0.0);
    assert_eq!(curve_from_drawings(&[(&cameras[0], &drawn)]), None);
    assert_eq!(curve_from_drawings(&[(&cameras[0], &drawn), (&cameras[0], &drawn)]), None);
    assert_eq!(curve_from_drawings(&[(&cameras[0], &drawn[..1]), (&cameras[1], &drawn)]), None);
}
