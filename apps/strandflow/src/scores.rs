//! What `evaluate` measures: each stage's results against truth.

use std::path::Path;

use rayon::prelude::*;
use serde::Serialize;
use strandflow_core::{Mask, Occupancy, StrandSequence, Strands};
use strandflow_engine::{Plan, Take};
use strandflow_eval::{
    DynamicsSampling, DynamicsScores, StrandSampling, StrandScores, Summary, Truth, evaluate_dynamics,
    evaluate_refinement, evaluate_strands,
    head::{PoseScores, ScalpScores, evaluate_pose, evaluate_scalp, marker_reprojection},
    images::{MaskScores, OrientationScores, evaluate_orientation, iou_with_itself_smoothed, mask_iou, mask_scores},
    markers::{MarkerScores, evaluate_markers},
    raster::StrandView,
    statistics::evenly,
    volume::{
        HullScores, LineScores, MotionScores, SurfaceScores, evaluate_hull, evaluate_lines, evaluate_motion,
        evaluate_surface,
    },
};
use strandflow_geometry::polyline;

use crate::{failure::Failed, held_out::ViewScores, sketched::SketchScores};

/// Frames on which maps and lines are scored, evenly chosen.
const IMAGE_FRAMES: usize = 10;

/// Everything that was measured; a part is absent where the stage has no results or the truth has nothing to say.
#[derive(Debug, Default, Serialize)]
pub struct Scores {
    /// Subject masks.
    pub subject: Option<MaskScores>,
    /// Hair masks.
    pub hair: Option<MaskScores>,
    /// Hulls, per frame.
    pub hull: Vec<(usize, HullScores)>,
    /// Head poses.
    pub pose: Option<PoseScores>,
    /// Triangulated markers against their true projections \[px\].
    pub marker_px: Option<Summary>,
    /// Marker tracks in the views that take part.
    pub markers: Option<MarkerScores>,
    /// Scalp.
    pub scalp: Option<ScalpScores>,
    /// Orientation maps, per frame.
    pub orient: Vec<(usize, OrientationScores)>,
    /// Lifted lines, per frame.
    pub lift: Vec<(usize, LineScores)>,
    /// Dense field, per frame.
    pub field: Vec<(usize, LineScores)>,
    /// First voxels of the hair volume along viewing rays, per frame.
    pub surface: Vec<(usize, SurfaceScores)>,
    /// Motion since the frame before, per frame.
    pub motion: Vec<(usize, MotionScores)>,
    /// Strands as shapes, per stage.
    pub strands: Vec<(String, StrandScores)>,
    /// Strands in motion, per stage.
    pub dynamics: Vec<(String, DynamicsScores)>,
    /// Strands that were drawn, per strand and frame.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sketches: Vec<SketchScores>,
    /// Strands in views that were held out; without truth and where none was, in all views.
    pub views: Vec<ViewScores>,
}

/// Stages whose result is strands of fixed topology.
pub const SEQUENCE_STAGES: [&str; 3] = ["smooth", "fit", "blend"];

/// Scores what a take has, or one stage of it.
pub fn score_take(
    take: &Take,
    plan: &Plan,
    truth: &Truth,
    folder: &Path,
    only: Option<&str>,
) -> Result<Scores, Failed> {
    let wanted = |stage: &str| only.is_none_or(|name| name == stage);
    let mut scores = Scores::default();
    let frames: Vec<usize> = (plan.frames.start..plan.frames.end).filter(|f| truth.at(*f as u32).is_some()).collect();
    if wanted("masks") {
        scores.subject = score_masks(take, &frames, &folder.join("mask_subject"), Kind::Subject)?;
        scores.hair = score_masks(take, &frames, &folder.join("mask_hair"), Kind::Hair)?;
    }
    if wanted("hull") {
        scores.hull = frames
            .iter()
            .filter_map(|&frame| {
                let hull = take.read_hull(frame).ok()?;
                // The hull is of the views that take part: so is the one it is compared with.
                let masks = true_masks(take, &folder.join("mask_subject"), frame).unwrap_or_default();
                let part: Vec<&Mask> = take.views().taking_part().iter().filter_map(|&view| masks.get(view)).collect();
                let t = truth.at(frame as u32)?;
                Some((frame, evaluate_hull(&hull, truth, t, take.views().rig(), &part)))
            })
            .collect();
    }
    if wanted("pose")
        && let Ok(poses) = take.read_poses()
    {
        let numbers: Vec<u32> = (0..poses.world_from_head.len()).map(|t| (plan.lead.start + t) as u32).collect();
        scores.pose = Some(evaluate_pose(&numbers, &poses.world_from_head, truth));
        scores.marker_px = Some(marker_reprojection(&numbers, &poses.markers, take.rig(), truth));
        if let Ok(ids) = take.store().read_all::<u32>("pose/ids")
            && !truth.marker_views.is_empty()
        {
            let views = (take.rig(), take.views().taking_part());
            scores.markers = Some(evaluate_markers(&numbers, views, &ids, &poses.tracks, truth));
        }
    }
    if wanted("scalp")
        && let Ok(scalp) = take.read_scalp()
    {
        scores.scalp = Some(evaluate_scalp(&scalp.mesh, &scalp.roots, truth));
    }
    let chosen: Vec<usize> = evenly(frames.len(), IMAGE_FRAMES).into_iter().map(|i| frames[i]).collect();
    for &frame in &chosen {
        let Some(t) = truth.at(frame as u32) else { continue };
        let drawn = if wanted("orient") || wanted("field") { drawn_truth(take, truth, t) } else { Vec::new() };
        if wanted("orient") {
            scores.orient.extend(score_orientation(take, &drawn, frame).map(|found| (frame, found)));
        }
        if wanted("lift")
            && let Ok(lines) = take.read_lines(frame)
        {
            let directions: Vec<_> = lines.values.iter().map(|line| line.direction).collect();
            scores.lift.push((frame, evaluate_lines(&lines.grid, &lines.indices, &directions, truth, t)));
        }
        if wanted("field")
            && let Ok(field) = take.read_field(frame)
        {
            let directions: Vec<_> = field.values.iter().map(|voxel| voxel.direction).collect();
            scores.field.push((frame, evaluate_lines(&field.grid, &field.indices, &directions, truth, t)));
            let mut volume = Occupancy::empty(field.grid);
            field.indices.iter().for_each(|&voxel| volume.set(voxel as usize, true));
            scores.surface.push((frame, evaluate_surface(&volume, take.rig(), &drawn)));
        }
        if wanted("field")
            && t > 0
            && frame > plan.lead.start
            && let Ok(motion) = take.read_motion(frame)
        {
            scores.motion.push((frame, evaluate_motion(&motion, truth, t - 1, t)));
        }
    }
    for stage in ["grow", "prune"] {
        if wanted(stage)
            && let Some(sequence) = ragged_sequence(take, stage, &frames)
        {
            let found = evaluate_strands(&sequence, truth, take.rig(), &StrandSampling::default());
            scores.strands.push((stage.to_owned(), found));
        }
    }
    let stages: Vec<&str> = SEQUENCE_STAGES.into_iter().filter(|stage| wanted(stage)).collect();
    let input = (!stages.is_empty()).then(|| take.read_sequence(SEQUENCE_STAGES[0]).ok()).flatten();
    for stage in stages {
        if let Ok(sequence) = take.read_sequence(stage) {
            scores.add_sequence(stage, &sequence, input.as_ref(), take, truth);
        }
    }
    Ok(scores)
}

impl Scores {
    /// Scores strands from elsewhere.
    pub fn of_sequence(name: &str, sequence: &StrandSequence, take: &Take, truth: &Truth) -> Self {
        let mut scores = Self::default();
        scores.add_sequence(name, sequence, None, take, truth);
        scores
    }

    /// Scores one sequence as shapes and in motion; against what the refinement was given, where it is a stage's.
    fn add_sequence(
        &mut self,
        name: &str,
        sequence: &StrandSequence,
        input: Option<&StrandSequence>,
        take: &Take,
        truth: &Truth,
    ) {
        let found = evaluate_strands(sequence, truth, take.rig(), &StrandSampling::default());
        self.strands.push((name.to_owned(), found));
        let sampling = DynamicsSampling { frame_secs: take.frame_secs(), ..DynamicsSampling::default() };
        let motion = match input {
            Some(input) => evaluate_refinement(sequence, input, truth, &sampling),
            None => evaluate_dynamics(sequence, truth, &sampling),
        };
        self.dynamics.push((name.to_owned(), motion));
    }
}

/// Which of the two masks.
#[derive(Clone, Copy)]
enum Kind {
    Subject,
    Hair,
}

fn score_masks(take: &Take, frames: &[usize], folder: &Path, kind: Kind) -> Result<Option<MaskScores>, Failed> {
    if !folder.is_dir() {
        return Ok(None);
    }
    let rows: Vec<Option<Vec<(f64, f64)>>> = frames
        .par_iter()
        .map(|&frame| {
            let truth = true_masks(take, folder, frame)?;
            let one = |(view, truth): (usize, &Mask)| {
                let found = match kind {
                    Kind::Subject => take.read_subject(view, frame),
                    Kind::Hair => take.read_hair(view, frame),
                };
                found.ok().map(|found| (mask_iou(&found, truth), iou_with_itself_smoothed(truth)))
            };
            truth.iter().enumerate().map(one).collect()
        })
        .collect();
    let rows: Vec<Vec<(f64, f64)>> = rows.into_iter().flatten().collect();
    let itself = Summary::of(rows.iter().flatten().map(|(_, itself)| *itself));
    let scores = mask_scores(rows.iter().map(|row| row.iter().map(|(iou, _)| *iou).collect()).collect());
    Ok((!rows.is_empty()).then_some(MaskScores { truth_smoothed: Some((itself.min, itself.mean)), ..scores }))
}

/// The true masks of all views of a frame; `None` where one is absent.
fn true_masks(take: &Take, folder: &Path, frame: usize) -> Option<Vec<Mask>> {
    let file = |name: &str| folder.join(name).join(format!("{frame:06}.png"));
    take.rig().cameras.iter().map(|camera| strandflow_io::read_mask(&file(&camera.name)).ok()).collect()
}

/// What each view truly sees of the hair in the `t`-th true frame.
fn drawn_truth(take: &Take, truth: &Truth, t: usize) -> Vec<StrandView> {
    let head = truth.head_at(truth.frames[t]);
    let strands = || (0..truth.strand_count()).map(|n| (n as u32, truth.strand(t, n)));
    take.rig().cameras.par_iter().map(|camera| StrandView::draw(camera, strands(), &head)).collect()
}

fn score_orientation(take: &Take, drawn: &[StrandView], frame: usize) -> Option<OrientationScores> {
    let views: Option<Vec<_>> =
        (0..take.rig().view_count()).map(|view| take.read_orientation(view, frame).ok()).collect();
    let views = views?;
    let maps: Vec<_> = views.iter().map(|map| (&map.angle, &map.confidence)).collect();
    Some(evaluate_orientation(&maps, drawn))
}

/// Strands of some evenly chosen frames as a sequence, resampled to 5 mm.
fn ragged_sequence(take: &Take, stage: &str, frames: &[usize]) -> Option<StrandSequence> {
    let chosen: Vec<usize> =
        evenly(frames.len(), StrandSampling::default().frames).into_iter().map(|i| frames[i]).collect();
    let all: Option<Vec<Strands>> = chosen.iter().map(|&frame| take.read_strands(stage, frame).ok()).collect();
    let all: Vec<Strands> = all?;
    let resampled = |strands: &Strands, n: usize| -> Vec<_> {
        let points = strands.strand(n);
        polyline::arc_parameters(points, 5.0).into_iter().map(|s| polyline::at_parameter(points, s)).collect()
    };
    let lines: Vec<Vec<Vec<_>>> =
        all.par_iter().map(|strands| (0..strands.strand_count()).map(|n| resampled(strands, n)).collect()).collect();
    let strand_count = lines.iter().map(Vec::len).max()?;
    let count = |n: usize| lines.iter().filter_map(|frame| frame.get(n)).map(Vec::len).max().unwrap_or(0) as u16;
    let counts: Vec<u16> = (0..strand_count).map(count).collect();
    let most = counts.iter().copied().max()? as usize;
    let mut sequence = StrandSequence::missing(chosen.iter().map(|&f| f as u32).collect(), counts, most);
    for (t, frame) in lines.iter().enumerate() {
        for (n, points) in frame.iter().enumerate() {
            let start = sequence.range(t, n).start;
            for (p, point) in points.iter().enumerate() {
                sequence.points[start + p] = *point;
                sequence.provenance[start + p] = strandflow_core::Provenance::Observed;
            }
        }
    }
    Some(sequence)
}
