//! Markers on a synthetic take with everything that makes them hard: up to 40 px a frame, a hand before them, drifting light.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

use std::{collections::BTreeMap, sync::Arc};

use glam::DVec2;
use strandflow_core::{FrameRange, ImageSource, Report, RgbImage, RigidTransform, SourceError};
use strandflow_eval::{Truth, head::evaluate_pose, markers::evaluate_markers};
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
        let pictures = (0..FRAMES).map(|frame| scene.render(frame)).collect();
        Self { scene, pictures }
    }

    fn labels(&self) -> Vec<MarkerLabel> {
        let clicks = self.scene.marker_labels(&self.pictures[0]);
        let of_views =
            |views: &[Option<DVec2>]| views.iter().enumerate().filter_map(|(v, p)| Some((v, (*p)?))).collect();
        clicks.iter().enumerate().map(|(m, views)| MarkerLabel { id: m as u32, views: of_views(views) }).collect()
    }

    fn tracked(&self) -> HeadPoses {
        let (labels, corrections) = (self.labels(), BTreeMap::new());
        let frames = FrameRange { start: 0, end: FRAMES };
        let input =
            PoseInput { rig: &self.scene.given_rig, images: self, frames, labels: &labels, corrections: &corrections };
        pose(&input, Mode::Robust, &PoseSettings::default(), &mut Report::default()).unwrap()
    }

    fn truth(&self) -> Truth {
        let world_from_head: Vec<RigidTransform> = (0..FRAMES).map(|t| self.scene.frame(t).world_from_head).collect();
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

    let found = shot.tracked();
    let (frames, views): (Vec<u32>, Vec<usize>) =
        ((0..FRAMES as u32).collect(), (0..shot.scene.rig.view_count()).collect());
    let (ids, truth): (Vec<u32>, Truth) = ((0..shot.scene.markers.len() as u32).collect(), shot.truth());
    let scores = evaluate_markers(&frames, (&shot.scene.rig, &views), &ids, &found.tracks, &truth);
    let poses = evaluate_pose(&frames, &found.world_from_head, &truth);
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
