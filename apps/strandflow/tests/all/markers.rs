//! Markers on a synthetic take with everything that makes them hard: up to 40 px a frame, a hand before them, drifting light. And
//! on one that is labelled in its middle, or in which markers begin later.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

use crate::common::{assert_bad_input, stderr, strandflow, synthetic, text};
use glam::DVec2;
use serde_json::json;
use strandflow_core::{FrameRange, ImageSource, Report, RgbImage, RigidTransform, SourceError};
use strandflow_engine::Take;
use strandflow_eval::{
    Truth,
    head::{PoseScores, evaluate_pose},
    markers::{MarkerScores, evaluate_markers},
};
use strandflow_stages::{
    Mode,
    pose::{HeadPoses, MarkerLabel, PoseInput, PoseSettings, pose},
};
use strandflow_synth::{
    GroomSpec, HandSpec, MARKER_RADIUS_MM, MotionSpec, NoiseSpec, Picture, RigSpec, Scene, SynthSpec, generate,
};

const FRAMES: usize = 30;

fn spec() -> SynthSpec {
    SynthSpec {
        seed: 21,
        rig: RigSpec {
            frames: FRAMES,
            fps: 30.0,
            views: 5,
            width: 480,
            height: 360,
            subsamples: 2,
            ..RigSpec::default()
        },
        groom: GroomSpec { strands: 150, guides: 30, length_mm: 130.0, width_mm: 2.0, ..GroomSpec::default() },
        motion: MotionSpec { quiet_frames: 3, turn_deg: 70.0, nod_deg: 12.0, rate_hz: 0.8, sway_mm: 100.0 },
        hand: HandSpec { radius_mm: 55.0, distance_mm: 190.0, rate_hz: 1.0 },
        noise: NoiseSpec { light_stops: 0.6, ..NoiseSpec::default() },
        ..SynthSpec::default()
    }
}

/// A take in memory, shape (T, views).
struct Shot {
    scene: Scene,
    pictures: Vec<Vec<Picture>>,
}

impl ImageSource for Shot {
    fn image(&self, view: usize, frame: usize) -> Result<Arc<RgbImage>, SourceError> {
        Ok(Arc::new(self.pictures[frame][view].image.clone()))
    }
}

impl Shot {
    fn of(spec: &SynthSpec) -> Self {
        let scene = generate(spec).unwrap();
        let pictures = (0..spec.rig.frames).map(|frame| scene.render(frame)).collect();
        Self { scene, pictures }
    }

    /// What a person labels in a frame.
    fn labels(&self, frame: usize) -> Vec<MarkerLabel> {
        let clicks = self.scene.marker_labels(&self.pictures[frame]);
        let of_views =
            |views: &[Option<DVec2>]| views.iter().enumerate().filter_map(|(v, p)| Some((v, (*p)?))).collect();
        clicks.iter().enumerate().map(|(m, views)| MarkerLabel { id: m as u32, views: of_views(views) }).collect()
    }

    fn tracked(
        &self,
        labelled: usize,
        labels: &[MarkerLabel],
        corrections: &BTreeMap<usize, Vec<MarkerLabel>>,
    ) -> HeadPoses {
        let frames = FrameRange { start: 0, end: self.pictures.len() };
        let input = PoseInput { rig: &self.scene.given_rig, images: self, frames, labelled, labels, corrections };
        pose(&input, Mode::Robust, &PoseSettings::default(), &mut Report::default()).unwrap()
    }

    /// Tracks and poses against the truth.
    fn scored(&self, found: &HeadPoses) -> (MarkerScores, PoseScores) {
        let frames: Vec<u32> = (0..self.pictures.len() as u32).collect();
        let views: Vec<usize> = (0..self.scene.rig.view_count()).collect();
        let (ids, truth): (Vec<u32>, Truth) = ((0..self.scene.markers.len() as u32).collect(), self.truth());
        let scores = evaluate_markers(&frames, (&self.scene.rig, &views), &ids, &found.tracks, &truth);
        (scores, evaluate_pose(&frames, &found.world_from_head, &truth))
    }

    fn truth(&self) -> Truth {
        let world_from_head: Vec<RigidTransform> =
            (0..self.pictures.len()).map(|t| self.scene.frame(t).world_from_head).collect();
        let first = world_from_head[0];
        let points = |picture: &Picture| -> Vec<(DVec2, f32)> {
            let seen = picture.markers.iter().zip(&picture.visible);
            seen.map(|(point, share)| (point.unwrap(), *share as f32)).collect()
        };
        Truth {
            world_from_head: world_from_head.iter().map(|pose| pose.after(&first.inverse())).collect(),
            markers: self.scene.markers.iter().map(|m| first.point(*m)).collect(),
            marker_radius: MARKER_RADIUS_MM,
            marker_views: self.pictures.iter().map(|views| views.iter().map(points).collect()).collect(),
            ..Truth::default()
        }
    }

    /// Visits every marker of every frame and view: (frame, view, marker, true point, share seen).
    fn each(&self, mut visit: impl FnMut(usize, usize, usize, DVec2, f64)) {
        for (t, views) in self.pictures.iter().enumerate() {
            for (v, picture) in views.iter().enumerate() {
                for (m, (point, &seen)) in picture.markers.iter().zip(&picture.visible).enumerate() {
                    visit(t, v, m, point.unwrap(), seen);
                }
            }
        }
    }

    /// Longest way of a seen marker from one frame to the next \[px\], and how often one that was hidden comes back.
    fn hardships(&self) -> (f64, usize) {
        let (mut longest, mut returns) = (0f64, 0);
        let mut before: BTreeMap<(usize, usize), (DVec2, f64)> = BTreeMap::new();
        self.each(|t, v, m, at, seen| {
            if let Some((was_at, was_seen)) = before.insert((v, m), (at, seen)).filter(|_| t > 0) {
                if seen >= 0.5 && was_seen >= 0.5 {
                    longest = longest.max(at.distance(was_at));
                }
                returns += usize::from(seen >= 0.5 && was_seen < 0.1);
            }
        });
        (longest, returns)
    }
}

#[test]
fn fast_hidden_and_differently_lit_markers_are_held_and_never_swapped() {
    let shot = Shot::of(&spec());
    let (longest, returns) = shot.hardships();
    assert!((36.0..44.0).contains(&longest) && returns > 20, "the take is as hard as meant: {longest} px, {returns}");

    let found = shot.tracked(0, &shot.labels(0), &BTreeMap::new());
    let (scores, poses) = shot.scored(&found);
    println!(
        "{scores:?}, {:.2} degrees, {:.2} mm; {longest:.1} px, {returns} came back",
        poses.worst_degrees, poses.worst_mm
    );
    assert!(scores.visible > 600 && scores.share_within_2px() >= 0.99 && scores.swaps == 0, "{scores:?}");
    assert!(scores.false_tracks <= 5, "{scores:?}");
    // The model is ten balls of 4.4 px as one frame shows them: measured 0.50 degrees at worst, 0.24 on average.
    let (degrees, mm) = (poses.worst_degrees, poses.worst_mm);
    assert!(degrees < 0.6 && mm < 1.0, "{degrees} degrees, {mm} mm");
    assert!(!found.interpolated.contains(&true));
}

/// A take of 12 frames in which the head turns by 30 degrees and more from its first to its last.
fn shorter() -> Shot {
    let whole = spec();
    Shot::of(&SynthSpec {
        rig: RigSpec { frames: 12, ..whole.rig },
        motion: MotionSpec { quiet_frames: 2, turn_deg: 45.0, nod_deg: 8.0, rate_hz: 0.8, sway_mm: 40.0 },
        hand: HandSpec::default(),
        noise: NoiseSpec::default(),
        ..whole
    })
}

#[test]
fn labels_of_frame_7_alone_give_the_poses_of_all_frames() {
    let shot = shorter();
    let found = shot.tracked(7, &shot.labels(7), &BTreeMap::new());
    let (scores, poses) = shot.scored(&found);
    let turned = found.world_from_head[11].angle().to_degrees();
    println!("{scores:?}, {:.3} degrees, {:.3} mm, turned {turned:.1}", poses.worst_degrees, poses.worst_mm);
    assert!(turned > 20.0 && !found.interpolated.contains(&true), "turned {turned}, {:?}", found.interpolated);
    assert!(poses.worst_degrees < 0.5 && poses.worst_mm < 1.0, "{poses:?}");
    assert!(scores.visible > 250 && scores.share_within_2px() >= 0.99 && scores.swaps == 0, "{scores:?}");
}

#[test]
fn markers_that_begin_in_frame_7_are_followed_over_the_whole_take() {
    let shot = shorter();
    let (mut labels, mut begun) = (shot.labels(0), shot.labels(7));
    let late = |label: &MarkerLabel| label.id % 3 == 1;
    labels.iter_mut().filter(|label| late(label)).for_each(|label| label.views.clear());
    begun.retain(late);
    assert!(begun.len() == 3 && begun.iter().all(|label| label.views.len() >= 2), "{begun:?}");
    let found = shot.tracked(0, &labels, &BTreeMap::from([(7, begun)]));
    let (scores, poses) = shot.scored(&found);
    let first = shot.truth().markers;
    let off: Vec<f64> =
        (0..first.len()).filter(|m| m % 3 == 1).map(|m| found.markers[0][m].unwrap().distance(first[m])).collect();
    println!("{scores:?}, {:.3} degrees, {:.3} mm, placed within {off:.2?} mm", poses.worst_degrees, poses.worst_mm);
    assert!(scores.visible > 250 && scores.share_within_2px() >= 0.99 && scores.swaps == 0, "{scores:?}");
    // A centre is measured to a pixel or two of shading, of 3 mm each.
    assert!(off.iter().all(|mm| *mm < 4.0), "{off:?}");
    assert!(poses.worst_degrees < 0.5 && poses.worst_mm < 1.0, "{poses:?}");
}

/// On disk: labels of frame 2 alone serve `run` (of all frames, and of those before it), `check` and the page; labels of no frame
/// of the take are refused with place and hint.
#[test]
fn a_take_need_not_be_labelled_in_its_first_frame() {
    let root = tempfile::tempdir().unwrap();
    let capture = root.path().join("capture");
    synthetic::capture(&capture);
    let take = synthetic::take_of(&capture, "take", &[]);
    let run = |more: &[&str]| strandflow(&[&["run", text(&take), "--to", "pose"], more].concat());
    let poses = |more: &[&str]| {
        let run = run(more);
        assert!(run.status.success(), "{}", stderr(&run));
        Take::open(&take).unwrap().read_poses().unwrap()
    };
    // Markers of two pixels do not all look like markers; that is said wherever they are labelled.
    let said_of_labels = || -> BTreeSet<String> {
        let checked = strandflow(&["check", text(&take), "--to", "identity", "--json"]);
        let said: Vec<serde_json::Value> = serde_json::from_slice(&checked.stdout).unwrap();
        let findings = said.iter().flat_map(|check| check["findings"].as_array().unwrap());
        let faults = findings.map(|finding| finding["fault"].as_str().unwrap().to_owned());
        faults.filter(|fault| fault.starts_with("labels-") || fault == "few-markers").collect()
    };
    let (from_first, of_first) = (poses(&[]), said_of_labels());
    assert!(!of_first.contains("labels-frame") && !of_first.contains("few-markers"), "{of_first:?}");
    let names: Vec<String> = Take::open(&take).unwrap().rig().cameras.iter().map(|c| c.name.clone()).collect();
    // What a person would click: markers that are seen for the greater part.
    let truth = &strandflow_eval::truth::read(&capture.join("gt")).unwrap().marker_views[2];
    let views = |m: usize| -> BTreeMap<&str, [f64; 2]> {
        let seen = names.iter().zip(truth).filter(|(_, points)| points[m].1 >= 0.6);
        seen.map(|(name, points)| (name.as_str(), points[m].0.to_array())).collect()
    };
    let markers: Vec<_> = (0..truth[0].len()).map(|m| json!({"id": m, "views": views(m)})).collect();
    let labels = capture.join("user/marker_labels.json");
    crate::common::write(&labels, &json!({"frame": 2, "markers": markers}).to_string());

    let from_third = poses(&[]);
    let head = from_first.markers[0].iter().flatten().next().copied().unwrap();
    assert!(from_third.world_from_head.len() == 4 && !from_third.interpolated.contains(&true));
    for (t, (a, b)) in from_first.world_from_head.iter().zip(&from_third.world_from_head).enumerate() {
        let (turn, shift) = (a.inverse().after(b).angle().to_degrees(), a.point(head).distance(b.point(head)));
        println!("frame {t}: {turn:.2} degrees, {shift:.2} mm apart");
        // A pixel is 8 mm of the head here, a marker two pixels.
        assert!(turn < 1.0 && shift < 2.0, "frame {t}: {turn} degrees, {shift} mm");
    }
    assert_eq!(poses(&["--frames", "0..2"]).world_from_head, from_third.world_from_head[..2]);
    assert_eq!(said_of_labels(), of_first);

    crate::common::write(&labels, &json!({"frame": 9, "markers": markers}).to_string());
    let refused = run(&[]);
    assert_bad_input(&refused, &["marker_labels.json", "labelled in frame 9", "0..4"]);
    assert!(stderr(&refused).contains("any one will do"), "{}", stderr(&refused));
    assert!(said_of_labels().contains("labels-frame"), "{:?}", said_of_labels());
}
