//! Masks, pose and orientations on synthetic pictures with known truth.

use std::{collections::BTreeMap, sync::Arc};

use glam::{DMat3, DVec2, DVec3};
use strandflow_core::{
    Camera, Distortion, FrameRange, ImageSource, Mask, Place, Plane, Report, RgbImage, Rig, RigidTransform, SourceError,
};
use strandflow_geometry::project::project;
use strandflow_stages::{
    Mode, StageError, hair_edge::HairEdge, hair_look::HairLook, key_frame::KeyView, masks, orient, pose,
};

/// Noise of about 3 code values, the same for the same seed.
struct Noise(u32);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut sum = 0.0;
        for _ in 0..4 {
            self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            sum += f64::from(self.0 >> 16) / 65536.0 - 0.5;
        }
        5.0 * sum
    }
}

/// Lines at `theta` with irregular brightness across them.
fn line_texture(theta: f64, x: f64, y: f64) -> f64 {
    let across = -x * theta.sin() + y * theta.cos();
    100.0 + 12.0 * (across * 1.1).sin() + 10.0 * (across * 0.73 + 1.0).sin() + 8.0 * (across * 1.63 + 2.0).sin()
}

#[test]
fn noisy_lines_are_read_within_two_degrees_and_confidence_orders_errors() {
    let (w, h) = (160, 140);
    let mut noise = Noise(5);
    // The texture fades to the right: confidence must follow.
    let theta = 1.1f64;
    let image = Plane::from_fn(w, h, |x, y| {
        let contrast = 1.0 - x as f64 / w as f64;
        let v = 100.0 + contrast * (line_texture(theta, x as f64, y as f64) - 100.0) + 2.0 * noise.next();
        [v as u8; 3]
    });
    let hair = Plane::from_fn(w, h, |x, y| if x > 8 && y > 8 && x < w - 4 && y < h - 8 { 255 } else { 0 });
    let start = std::time::Instant::now();
    let (settings, place) = (orient::OrientSettings::default(), Place::default());
    let map = orient::orient(&place, &image, &hair, &hair, Mode::Robust, &settings, &mut Report::default()).unwrap();
    println!("orient: {:.0} ms for {} hair pixels", start.elapsed().as_secs_f64() * 1e3, (w - 13) * (h - 17));
    let mut rated: Vec<(f32, f64)> = (0..w * h)
        .filter(|&i| hair.data[i] > 0)
        .map(|i| {
            let d = (f64::from(map.angle.data[i]) - theta).rem_euclid(std::f64::consts::PI);
            (map.confidence.data[i], d.min(std::f64::consts::PI - d).to_degrees())
        })
        .collect();
    rated.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mean = |part: &[(f32, f64)]| part.iter().map(|r| r.1).sum::<f64>() / part.len() as f64;
    let (sure, unsure) = rated.split_at(rated.len() / 2);
    assert!(mean(sure) < 2.0 && mean(sure) < mean(unsure), "{} {}", mean(sure), mean(unsure));
    assert!((0..w * h).all(|i| hair.data[i] > 0 || (map.angle.data[i] == 0.0 && map.confidence.data[i] == 0.0)));
    let wrong = Plane::filled(w + 1, h, 255u8);
    let error = orient::orient(&place, &image, &wrong, &hair, Mode::Robust, &settings, &mut Report::default());
    assert!(matches!(error, Err(StageError::Input { .. })));
}

/// A head of skin below and textured hair above, moved by `shift`, before a flat wall.
fn head_scene(shift: f64, seed: u32) -> (RgbImage, Mask, Mask) {
    let (w, h) = (150, 130);
    let mut noise = Noise(seed);
    let at = |x: usize, y: usize| (x as f64 - 60.0 - shift, y as f64 - 60.0 - 0.5 * shift);
    let subject = |x: usize, y: usize| at(x, y).0.hypot(at(x, y).1) < 38.0;
    let hair = |x: usize, y: usize| subject(x, y) && at(x, y).1 < 8.0;
    let image = Plane::from_fn(w, h, |x, y| {
        let (u, v) = at(x, y);
        let base = match (hair(x, y), subject(x, y)) {
            (true, _) => [0.0, -28.0, -55.0].map(|c| line_texture(1.4, u, v) + c),
            (_, true) => [215.0, 180.0, 155.0],
            _ => [150.0, 172.0, 158.0],
        };
        base.map(|c| (c + noise.next()).clamp(0.0, 255.0) as u8)
    });
    let mask = |f: &dyn Fn(usize, usize) -> bool| Plane::from_fn(w, h, |x, y| if f(x, y) { 255 } else { 0 });
    (image, mask(&subject), mask(&hair))
}

fn iou(a: &Mask, b: &Mask) -> f64 {
    let count = |f: fn(bool, bool) -> bool| {
        a.data.iter().zip(&b.data).filter(|(a, b)| f(**a >= 128, **b >= 128)).count() as f64
    };
    count(|a, b| a && b) / count(|a, b| a || b)
}

#[test]
fn hair_is_carried_over_five_frames_from_the_first_mask() {
    let plate = {
        let mut noise = Noise(99);
        Plane::from_fn(150, 130, |_, _| [150.0, 172.0, 158.0].map(|c| (c + noise.next()) as u8))
    };
    let (key_image, _, key_hair) = head_scene(0.0, 1);
    let settings = masks::MasksSettings::default();
    let key = KeyView { image: &key_image, plate: &plate, hair: &key_hair, subject: None };
    let look = HairLook::learn(&Place::default(), &key, [], &settings).unwrap();
    let edge = HairEdge::learn(&Place::default(), &key, &settings).unwrap();
    for mode in [Mode::Paper, Mode::Robust] {
        let mut before: Option<(RgbImage, masks::Masks)> = None;
        for t in 0..6u32 {
            let (image, subject, hair) = head_scene(4.0 * f64::from(t), t + 1);
            let input = masks::MasksInput {
                place: Place::default(),
                image: &image,
                plate: &plate,
                given_subject: None,
                given_hair: (t == 0).then_some(&key_hair),
                neighbour: before.as_ref().map(|(image, masks)| masks::NeighbourFrame { image, masks }),
                key: Some(&key_hair),
                look: Some(&look),
                edge: Some(&edge),
            };
            let found = masks::masks(&input, mode, &settings, &mut Report::default()).unwrap();
            let (s, h) = (iou(&found.subject, &subject), iou(&found.hair, &hair));
            assert!(s > 0.97 && h > 0.93, "{mode:?} frame {t}: subject {s:.3}, hair {h:.3}");
            before = Some((image, found));
        }
    }
}

/// Dense hair that ends in a fringe before the wall, and beside it skin with thin hair before it: image, true subject, hair.
fn fringe_scene(seed: u32) -> (RgbImage, Mask, Mask) {
    let (w, h) = (240, 180);
    let mut noise = Noise(seed);
    let mut chance = Noise(seed + 1000);
    // Single hairs: a coverage of one third, which varies from pixel to pixel.
    let thin = Plane::from_fn(w, h, |_, _| (0.33 + 0.12 * chance.next()).clamp(0.0, 1.0));
    let skin = |x: usize, y: usize| (150..200).contains(&x) && (20..150).contains(&y);
    let hair = |x: usize, y: usize| match (x, y) {
        (40..150, 20..90) => 1.0,
        (40..150, 90..150) => thin[(x, y)],
        (150..165, 20..150) => thin[(x, y)],
        _ => 0.0,
    };
    let image = Plane::from_fn(w, h, |x, y| {
        let behind = if skin(x, y) { [215.0, 180.0, 155.0] } else { [150.0, 172.0, 158.0] };
        let share = hair(x, y);
        let strands = [0.0, -28.0, -55.0].map(|c| line_texture(1.4, x as f64, y as f64) + c);
        let mixed = |c: usize| {
            let light = |code: f64| (code.max(0.0) / 255.0).powf(2.2);
            255.0 * (share * light(strands[c]) + (1.0 - share) * light(behind[c])).powf(1.0 / 2.2)
        };
        [0, 1, 2].map(|c| (mixed(c) + noise.next()).clamp(0.0, 255.0) as u8)
    });
    let code = |share: f64| (255.0 * share).round() as u8;
    let hair_mask = Plane::from_fn(w, h, |x, y| code(hair(x, y)));
    let subject = Plane::from_fn(w, h, |x, y| if skin(x, y) { 255 } else { code(hair(x, y)) });
    (image, subject, hair_mask)
}

#[test]
fn a_fringe_is_thinned_where_the_wall_is_behind_it_and_not_where_skin_is() {
    let plate = Plane::from_fn(240, 180, |_, _| [150u8, 172, 158]);
    let (key_image, _, key_hair) = fringe_scene(1);
    let (settings, place) = (masks::MasksSettings::default(), Place::default());
    let key = KeyView { image: &key_image, plate: &plate, hair: &key_hair, subject: None };
    let look = HairLook::learn(&place, &key, [], &settings).unwrap();
    let edge = HairEdge::learn(&place, &key, &settings).unwrap();
    let (image, subject, _) = fringe_scene(2);
    let [matte, thinned] = [Mode::Paper, Mode::Robust].map(|mode| {
        let input = masks::MasksInput {
            place: place.clone(),
            image: &image,
            plate: &plate,
            given_subject: None,
            given_hair: None,
            neighbour: None,
            key: Some(&key_hair),
            look: Some(&look),
            edge: Some(&edge),
        };
        masks::masks(&input, mode, &settings, &mut Report::default()).unwrap().subject
    });
    let (before, after) = (iou(&matte, &subject), iou(&thinned, &subject));
    assert!(before < 0.85 && after > 0.92, "{before:.3} {after:.3}");
    let skin = (20..150).flat_map(|y| (150..198).map(move |x| (x, y)));
    let lost = skin.filter(|&at| thinned[at] < 128).count();
    assert!(lost < 60, "{lost} of 6240 pixels of skin are lost");
}

#[test]
fn a_key_frame_of_another_size_or_without_hair_is_no_disaster() {
    let plate = Plane::from_fn(150, 130, |_, _| [150u8, 172, 158]);
    let (image, _, hair) = head_scene(0.0, 1);
    let (settings, place) = (masks::MasksSettings::default(), Place::default());
    let small = Plane::filled(149, 130, 0u8);
    let key = |image, hair| KeyView { image, plate: &plate, hair, subject: None };
    let error = HairLook::learn(&place, &key(&image, &small), [], &settings);
    assert!(matches!(error, Err(StageError::Input { .. })));
    let error = HairEdge::learn(&place, &key(&image, &small), &settings);
    assert!(matches!(error, Err(StageError::Input { .. })));
    // A bald head and an empty scene teach nothing; the mask carried by flow is then kept.
    let bald = hair.map(|_| 0u8);
    for (image, hair) in [(&image, &bald), (&plate, &hair)] {
        let look = HairLook::learn(&place, &key(image, hair), [], &settings).unwrap();
        let region = strandflow_image::region::Region::whole(hair);
        assert!(look.hair_odds(image, &plate, hair, region, 3).iter().all(|&o| o == 0.0));
        let edge = HairEdge::learn(&place, &key(image, hair), &settings).unwrap();
        assert_eq!(edge.thinned(image, &plate, hair), *hair);
    }
}

struct Takes {
    images: Vec<Vec<Arc<RgbImage>>>,
}

impl ImageSource for Takes {
    fn image(&self, view: usize, frame: usize) -> Result<Arc<RgbImage>, SourceError> {
        Ok(self.images[frame][view].clone())
    }
}

const IN_FRONT: &str = "the balls are before all cameras";

/// A head of seven balls before three cameras, six frames of it.
struct Balls {
    rig: Rig,
    balls: Vec<DVec3>,
    pose_at: fn(usize) -> RigidTransform,
    source: Takes,
}

impl Balls {
    fn moving(pose_at: fn(usize) -> RigidTransform) -> Self {
        let camera = |i: usize| Camera {
            name: format!("c{i}"),
            width: 200,
            height: 160,
            focal: [700.0; 2],
            principal: [100.0, 80.0],
            distortion: Distortion::None,
            camera_from_world: RigidTransform {
                rotation: DMat3::from_rotation_y(0.5 * i as f64 - 0.5),
                translation: DVec3::new(0.0, 0.0, 900.0),
            },
        };
        let rig = Rig { cameras: (0..3).map(camera).collect() };
        let ball = |i: i32| {
            DVec3::new(-75.0 + 25.0 * f64::from(i), if i % 2 == 0 { -45.0 } else { 30.0 }, f64::from(i * i % 5) * 12.0)
        };
        let balls: Vec<DVec3> = (0..7).map(ball).collect();
        let colours = [[230.0, 40.0, 40.0], [40.0, 200.0, 60.0], [50.0, 70.0, 230.0], [230.0, 210.0, 40.0]];
        let mut noise = Noise(3);
        let mut shot = |t: usize, view: usize| {
            let seen: Vec<_> =
                balls.iter().map(|b| project(&rig.cameras[view], pose_at(t).point(*b)).expect(IN_FRONT)).collect();
            Arc::new(Plane::from_fn(200, 160, |x, y| {
                let mut colour = [110.0, 90.0, 70.0];
                for (i, p) in seen.iter().enumerate() {
                    let a = (5.0 - DVec2::new(x as f64 + 0.5, y as f64 + 0.5).distance(*p)).clamp(0.0, 1.0);
                    (0..3).for_each(|c| colour[c] += a * (colours[i % 4][c] - colour[c]));
                }
                colour.map(|c| (c + noise.next()).clamp(0.0, 255.0) as u8)
            }))
        };
        let images = (0..6).map(|t| (0..3).map(|view| shot(t, view)).collect()).collect();
        Self { rig, balls, pose_at, source: Takes { images } }
    }

    /// Labels of the first balls in the first views of a frame.
    fn labels(&self, t: usize, balls: usize, views: usize) -> Vec<pose::MarkerLabel> {
        let label = |(i, b): (usize, &DVec3)| {
            let seen = self.rig.cameras[..views].iter().enumerate();
            let views = seen.map(|(v, c)| (v, project(c, (self.pose_at)(t).point(*b)).expect(IN_FRONT))).collect();
            pose::MarkerLabel { id: i as u32, views }
        };
        self.balls[..balls].iter().enumerate().map(label).collect()
    }

    fn poses(
        &self,
        labels: &[pose::MarkerLabel],
        corrections: &BTreeMap<usize, Vec<pose::MarkerLabel>>,
        mode: Mode,
        settings: &pose::PoseSettings,
    ) -> Result<pose::HeadPoses, StageError> {
        self.poses_from(0, labels, corrections, mode, settings)
    }

    fn poses_from(
        &self,
        labelled: usize,
        labels: &[pose::MarkerLabel],
        corrections: &BTreeMap<usize, Vec<pose::MarkerLabel>>,
        mode: Mode,
        settings: &pose::PoseSettings,
    ) -> Result<pose::HeadPoses, StageError> {
        let frames = FrameRange { start: 0, end: 6 };
        let input = pose::PoseInput { rig: &self.rig, images: &self.source, frames, labelled, labels, corrections };
        pose::pose(&input, mode, settings, &mut Report::default())
    }

    /// How far a pose is off \[degrees, mm\].
    fn off(&self, found: &pose::HeadPoses, t: usize) -> (f64, f64) {
        let truth = (self.pose_at)(t).after(&(self.pose_at)(0).inverse());
        let turn = found.world_from_head[t].inverse().after(&truth).angle().to_degrees();
        (turn, found.world_from_head[t].point(DVec3::ZERO).distance(truth.point(DVec3::ZERO)))
    }
}

#[test]
fn a_turning_head_is_followed_by_its_balls() {
    let scene = Balls::moving(|t| {
        let angle = 0.012 * (t * t) as f64;
        RigidTransform { rotation: DMat3::from_rotation_y(angle), translation: DVec3::new(1.5 * t as f64, -0.5, 0.0) }
    });
    let (labels, none, settings) = (scene.labels(0, 7, 3), BTreeMap::new(), pose::PoseSettings::default());
    for (mode, degrees) in [(Mode::Robust, 0.15), (Mode::Paper, 3.0)] {
        let found = scene.poses(&labels, &none, mode, &settings).unwrap();
        for t in 0..6 {
            let (turn, shift) = scene.off(&found, t);
            println!("{mode:?} frame {t}: {turn:.3} degrees, {shift:.3} mm");
            assert!(turn < degrees && shift < 5.0 * degrees, "{mode:?} frame {t}: {turn}, {shift}");
        }
    }
    let error = scene.poses(&labels[..4], &none, Mode::Robust, &settings);
    assert!(matches!(error, Err(StageError::Input { .. })));
}

/// The head jumps between frames 2 and 3, further than markers are searched; the labels of frame 4 bring frames 3 to 5 back.
#[test]
fn a_correction_holds_forward_and_backward() {
    let scene = Balls::moving(|t| {
        let jump = if t < 3 { 0.0 } else { 40.0 };
        let translation = DVec3::new(jump + 0.5 * t as f64, 0.3 * jump, 0.0);
        RigidTransform { rotation: DMat3::from_rotation_y(0.004 * t as f64 + 0.004 * jump), translation }
    });
    let labels = scene.labels(0, 7, 3);
    let settings = pose::PoseSettings { search_px: 4.0, ..pose::PoseSettings::default() };
    let lost = scene.poses(&labels, &BTreeMap::new(), Mode::Robust, &settings).unwrap();
    assert!((3..6).all(|t| scene.off(&lost, t).1 > 10.0), "{:?}", [3, 4, 5].map(|t| scene.off(&lost, t)));
    // Numbers that were not labelled in the first frame, and frames outside the take, change nothing.
    let mut corrections = BTreeMap::from([(4, scene.labels(4, 5, 2)), (9, scene.labels(4, 5, 2))]);
    corrections.get_mut(&4).unwrap().push(pose::MarkerLabel { id: 77, views: BTreeMap::new() });
    for (mode, degrees) in [(Mode::Robust, 0.15), (Mode::Paper, 3.0)] {
        let found = scene.poses(&labels, &corrections, mode, &settings).unwrap();
        for t in 0..6 {
            let (turn, shift) = scene.off(&found, t);
            println!("{mode:?} frame {t}: {turn:.3} degrees, {shift:.3} mm, {} markers", found.used[t]);
            assert!(turn < degrees && shift < 5.0 * degrees && !found.interpolated[t], "{mode:?} frame {t}");
        }
        let at = found.tracks[4][0][2].unwrap();
        assert!(at.distance(corrections[&4][2].views[&0]) < 0.6, "a labelled point stays");
    }
    // A label that contradicts all others is told, and moves the pose little.
    corrections.get_mut(&4).unwrap()[0].views.insert(1, DVec2::new(20.0, 20.0));
    let frames = FrameRange { start: 0, end: 6 };
    let input = pose::PoseInput {
        rig: &scene.rig,
        images: &scene.source,
        frames,
        labelled: 0,
        labels: &labels,
        corrections: &corrections,
    };
    let mut report = Report::default();
    let found = pose::pose(&input, Mode::Robust, &settings, &mut report).unwrap();
    assert!(report.findings.iter().any(|f| f.fact.contains("marker 0 is")), "{:?}", report.findings);
    assert!(scene.off(&found, 4).1 < 1.0, "{:?}", scene.off(&found, 4));
}

/// Labelled in the middle of the take alone, the head is followed to both ends of it.
#[test]
fn labels_of_a_later_frame_hold_forward_and_backward() {
    let scene = Balls::moving(|t| {
        let angle = 0.05 * t as f64;
        RigidTransform { rotation: DMat3::from_rotation_y(angle), translation: DVec3::new(1.5 * t as f64, -0.5, 0.0) }
    });
    let (none, settings) = (BTreeMap::new(), pose::PoseSettings::default());
    for (mode, degrees) in [(Mode::Robust, 0.2), (Mode::Paper, 3.0)] {
        let found = scene.poses_from(3, &scene.labels(3, 7, 3), &none, mode, &settings).unwrap();
        assert_eq!(found.world_from_head[0], RigidTransform::IDENTITY, "head space is the first frame's world");
        for t in 0..6 {
            let (turn, shift) = scene.off(&found, t);
            println!("{mode:?} frame {t}: {turn:.3} degrees, {shift:.3} mm");
            assert!(
                turn < degrees && shift < 5.0 * degrees && !found.interpolated[t],
                "{mode:?} frame {t}: {turn}, {shift}"
            );
        }
        let first = found.markers[0][2].unwrap().distance((scene.pose_at)(0).point(scene.balls[2]));
        assert!(first < 3.0 * degrees, "{mode:?}: the markers are where the first frame has them: {first} mm off");
    }
    let outside = scene.poses_from(6, &scene.labels(3, 7, 3), &none, Mode::Robust, &settings).unwrap_err();
    assert!(outside.to_string().contains("outside the frames 0..6"), "{outside}");
}

/// A marker that is first labelled in frame 4 gets its place by the head's pose there and is seen in all frames; so is one that
/// one view shows in frame 2 and another in frame 4. One that a single view shows has no place, and that is told.
#[test]
fn a_marker_may_begin_in_any_frame() {
    let scene = Balls::moving(|t| {
        let angle = 0.03 * t as f64;
        RigidTransform { rotation: DMat3::from_rotation_y(angle), translation: DVec3::new(1.5 * t as f64, -0.5, 0.0) }
    });
    let mut labels = scene.labels(0, 7, 3);
    (5..7).for_each(|m| labels[m].views.clear());
    labels.push(pose::MarkerLabel { id: 9, views: BTreeMap::new() });
    let of = |t: usize, m: usize, views: &[usize]| {
        let mut label = scene.labels(t, 7, 3)[m].clone();
        label.views.retain(|view, _| views.contains(view));
        label
    };
    let mut nine = of(4, 0, &[1]);
    nine.id = 9;
    let corrections = BTreeMap::from([(2, vec![of(2, 6, &[0])]), (4, vec![of(4, 5, &[0, 2]), of(4, 6, &[2]), nine])]);
    let input = |labels| pose::PoseInput {
        rig: &scene.rig,
        images: &scene.source,
        frames: FrameRange { start: 0, end: 6 },
        labelled: 0,
        labels,
        corrections: &corrections,
    };
    for mode in [Mode::Robust, Mode::Paper] {
        let mut report = Report::default();
        let found = pose::pose(&input(&labels), mode, &pose::PoseSettings::default(), &mut report).unwrap();
        for m in [5, 6] {
            let off = found.markers[0][m].unwrap().distance((scene.pose_at)(0).point(scene.balls[m]));
            println!("{mode:?} marker {m}: {off:.3} mm");
            assert!(off < if mode == Mode::Robust { 0.5 } else { 5.0 }, "{mode:?} marker {m}: {off} mm off");
        }
        assert!(
            found.markers[0][7].is_none()
                && report.findings.iter().any(|f| f.fact.contains("marker 9 is not labelled"))
        );
        if mode == Mode::Robust {
            for (t, views) in found.tracks.iter().enumerate() {
                let seen = |m: usize| views.iter().flat_map(|view| view[m]).count();
                assert!(seen(5) >= 2 && seen(6) >= 2, "frame {t}: {} and {}", seen(5), seen(6));
            }
            assert!((1..6).all(|t| found.used[t] == 7), "{:?}", found.used);
        }
    }
}
