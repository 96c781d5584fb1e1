//! What pictures must be: the same at any number of threads, with hair where it is and nothing where the head hides it.

use glam::{DVec3, Vec3};
use strandflow_core::{Camera, RigidTransform, TriMesh};
use strandflow_geometry::{primitives::icosphere, project::project};
use strandflow_render::{
    Hair, HairColour, Head, Light, LightRig, Picture, RenderError, Settings, Subject, full_density, look_at, render,
};

fn camera() -> Camera {
    look_at(DVec3::new(0.0, -1000.0, 0.0), DVec3::ZERO, DVec3::Z, 0.35, [160, 120])
}

fn one_hair(density: usize, shutter: f32) -> Settings {
    Settings { density, shutter, polish: 0, ..Settings::default() }
}

/// A cap of hair on a ball of 90 mm, that falls straight down from where it leaves the ball.
fn wig() -> Hair {
    let mut hair = Hair::default();
    for n in 0..400u32 {
        let (up, around) = (0.15 + 0.8 * (n as f32 / 400.0), n as f32 * 2.399_963);
        let side = Vec3::new(around.cos(), around.sin(), 0.0) * (1.0 - up * up).sqrt();
        let root = (side + Vec3::Z * up) * 90.0;
        let strand: Vec<Vec3> = (0..30)
            .map(|k| {
                let p = root + (side.normalize() * 0.5 - Vec3::Z) * 5.0 * k as f32;
                p.normalize() * p.length().max(91.0)
            })
            .collect();
        let motion: Vec<Vec3> = (0..30).map(|k| Vec3::X * 0.2 * k as f32).collect();
        hair.push(n, &strand, &motion);
    }
    hair
}

fn ball() -> TriMesh {
    icosphere(DVec3::ZERO, 90.0, 3)
}

fn head(mesh: &TriMesh) -> Head<'_> {
    Head { mesh, world_from_head: RigidTransform::IDENTITY, next_world_from_head: RigidTransform::IDENTITY }
}

fn sum(picture: &Picture, channel: usize) -> f64 {
    picture.linear.data.iter().map(|p| f64::from(p[channel])).sum()
}

#[test]
fn the_same_bytes_at_one_and_two_threads() {
    let (hair, mesh, camera) = (wig(), ball(), camera());
    let rig = LightRig::studio(&camera, DVec3::Z);
    let make = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let subject = || Subject { hair: &hair, head: Some(head(&mesh)) };
        pool.install(|| render(&subject(), &camera, &rig, &Settings::default())).unwrap()
    };
    let (one, two) = (make(1), make(2));
    assert!(
        one.linear.data.iter().flatten().zip(two.linear.data.iter().flatten()).all(|(a, b)| a.to_bits() == b.to_bits())
    );
    assert!(one.linear.data.iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
    let covered = one.linear.data.iter().filter(|p| p[3] > 0.9).count();
    assert!(covered > 1500, "{covered} pixels of a head");
}

#[test]
fn a_strand_lies_where_it_projects_and_covers_its_area() {
    let mut hair = Hair::default();
    let ends = [Vec3::new(-60.0, 10.0, 50.0), Vec3::new(80.0, -30.0, -70.0)];
    let strand: Vec<Vec3> = (0..40).map(|k| ends[0].lerp(ends[1], k as f32 / 39.0)).collect();
    hair.push(0, &strand, &[]);
    let camera = camera();
    let rig = LightRig::studio(&camera, DVec3::Z);
    let picture = render(&Subject { hair: &hair, head: None }, &camera, &rig, &one_hair(1, 0.0)).unwrap();
    let [a, b] = ends.map(|p| project(&camera, p.as_dvec3()).unwrap());
    // Of a single strand every point is drawn 0.4 mm thick (few hairs are drawn thicker), its last 30 % thinning to a quarter.
    let px = camera.focal[0] / 1000.0;
    let area = a.distance(b) * 0.4 * px * (1.0 - 0.3 * 0.75 / 2.0);
    assert!((sum(&picture, 3) / area - 1.0).abs() < 0.03, "{} of {area}", sum(&picture, 3));
    let along = (b - a).normalize();
    for y in 0..120 {
        for x in 0..160 {
            let off = (glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - a).perp_dot(along).abs();
            assert!(picture.linear[(x, y)][3] == 0.0 || off < 2.0, "{off} px from the strand");
        }
    }
}

#[test]
fn the_head_hides_hair_behind_it() {
    let mut hair = Hair::default();
    for n in 0..40 {
        let strand: Vec<Vec3> = (0..20).map(|k| Vec3::new(n as f32 - 20.0, 130.0, 30.0 - 3.0 * k as f32)).collect();
        hair.push(n, &strand, &[]);
    }
    let (mesh, camera) = (ball(), camera());
    // Without light hair is black, the head too: what is left is coverage, and the head's is the same.
    let rig =
        LightRig { lights: vec![Light { towards: Vec3::Y, irradiance: Vec3::ONE }], dome: Vec3::ZERO, up: Vec3::Z };
    let with = |head| render(&Subject { hair: &hair, head }, &camera, &rig, &one_hair(3, 0.0)).unwrap();
    assert!(sum(&with(None), 0) > 1.0, "lit from behind, hair alone shines");
    assert!(sum(&with(Some(head(&mesh))), 0) < 1e-3, "the head is between it and the eye");
}

#[test]
fn motion_blur_moves_coverage_and_loses_none() {
    let camera = camera();
    let rig = LightRig::studio(&camera, DVec3::Z);
    let coverage = |shutter| {
        let mut hair = Hair::default();
        let strand: Vec<Vec3> = (0..30).map(|k| Vec3::new(0.0, 0.0, 60.0 - 4.0 * k as f32)).collect();
        hair.push(0, &strand, &[Vec3::X * 20.0; 30]);
        let picture = render(&Subject { hair: &hair, head: None }, &camera, &rig, &one_hair(1, shutter)).unwrap();
        let most = picture.linear.data.iter().map(|p| p[3]).fold(0.0, f32::max);
        (sum(&picture, 3), sum(&picture, 1), most)
    };
    let (sharp, blurred) = (coverage(0.0), coverage(1.0));
    assert!(
        (blurred.0 / sharp.0 - 1.0).abs() < 0.01 && (blurred.1 / sharp.1 - 1.0).abs() < 0.01,
        "{sharp:?} {blurred:?}"
    );
    assert!(blurred.2 < 0.3 * sharp.2, "spread over its way");
}

#[test]
fn bad_input_is_an_error_with_a_hint() {
    let camera = camera();
    let rig = LightRig::studio(&camera, DVec3::Z);
    let of = |hair: &Hair, camera: &Camera, settings: &Settings| {
        let error = render(&Subject { hair, head: None }, camera, &rig, settings).unwrap_err();
        assert!(!error.hint().is_empty());
        error
    };
    let good = wig();
    assert_eq!(of(&Hair::default(), &camera, &Settings::default()), RenderError::NoHair);
    let mut dot = Hair::default();
    dot.push(0, &[Vec3::ZERO], &[]);
    assert_eq!(of(&dot, &camera, &Settings::default()), RenderError::NoHair);
    let mut broken = good.clone();
    broken.points[65].y = f32::NAN;
    assert_eq!(of(&broken, &camera, &Settings::default()), RenderError::NotFinite { strand: 2, point: 5 });
    let mut many = Hair::default();
    (0..8000).for_each(|n| many.push(n, &[Vec3::X * n as f32; 11], &[]));
    let dense = Settings { density: 500, ..Settings::default() };
    assert_eq!(of(&many, &camera, &dense), RenderError::TooMany { points: 44_000_000 });
    let huge = Camera { width: 1 << 40, ..camera.clone() };
    assert!(matches!(of(&good, &huge, &Settings::default()), RenderError::Size { .. }));
    for wrong in [
        Settings { density: 0, ..Settings::default() },
        Settings { shutter: f32::NAN, ..Settings::default() },
        Settings { hair_mm: -1.0, ..Settings::default() },
        Settings { polish: 1_000_000, ..Settings::default() },
    ] {
        assert!(matches!(of(&good, &camera, &wrong), RenderError::Setting { .. }));
    }
}

#[test]
fn lighter_hair_is_lighter_and_few_strands_are_drawn_as_many() {
    let (hair, mesh, camera) = (wig(), ball(), camera());
    let rig = LightRig::studio(&camera, DVec3::Z);
    let light = |colour| {
        let settings = Settings { colour, ..Settings::default() };
        sum(&render(&Subject { hair: &hair, head: Some(head(&mesh)) }, &camera, &rig, &settings).unwrap(), 1)
    };
    let lights = [HairColour::BLACK, HairColour::BROWN, HairColour::BLOND].map(light);
    assert!(lights[0] < lights[1] && lights[1] < lights[2], "{lights:?}");
    assert_eq!(full_density(7359, 0.96), 7);
    assert_eq!(full_density(100_000, 5.0), 1);
    assert_eq!(full_density(0, f64::NAN), 1);
}
