//! How well strands explain images that had no part in their making; needs no truth.

use rayon::prelude::*;
use serde::Serialize;
use strandflow_core::{StrandSequence, TriMesh};
use strandflow_engine::Take;
use strandflow_eval::{
    Table,
    images::{CoverageScores, OrientationScores, coverage, held_out_agreement},
    raster::StrandView,
    statistics::evenly,
};

/// Frames that are looked at, evenly chosen.
const FRAMES: usize = 10;

/// The scalp hides strands behind the head. It lies within millimetres of their roots: shrunk by this share (5 mm of a
/// head's radius) it does not hide those in front of it, and still hides the far side.
const OCCLUDER_SCALE: f64 = 0.95;

/// What one view says of one stage's strands.
#[derive(Debug, Serialize)]
pub struct ViewScores {
    /// The stage, or the file the strands came from.
    pub stage: String,
    /// The view.
    pub view: String,
    /// Whether the view was held out; one that took part flatters.
    pub held_out: bool,
    /// By frame.
    pub frames: Vec<FrameScores>,
}

/// What one view says in one frame.
#[derive(Debug, Serialize)]
pub struct FrameScores {
    /// The frame.
    pub frame: usize,
    /// Directions of the strands against the orientation map.
    pub orientation: OrientationScores,
    /// Strands against the hair mask.
    pub coverage: CoverageScores,
}

/// Views to judge by: those held out; all where none is.
fn judges(take: &Take) -> Vec<usize> {
    match take.views().held_out() {
        [] => (0..take.rig().view_count()).collect(),
        held_out => held_out.to_vec(),
    }
}

/// Scores a sequence in the views that judge it, in frames that have orientation maps.
pub fn score(stage: &str, sequence: &StrandSequence, take: &Take) -> Vec<ViewScores> {
    let chosen = evenly(sequence.frame_count(), FRAMES);
    let of_view = |&view: &usize| {
        let frames: Vec<FrameScores> =
            chosen.par_iter().filter_map(|&t| score_frame(sequence, t, take, view)).collect();
        let (name, held_out) = (take.rig().cameras[view].name.clone(), !take.views().held_out().is_empty());
        ViewScores { stage: stage.to_owned(), view: name, held_out, frames }
    };
    judges(take).iter().map(of_view).filter(|view| !view.frames.is_empty()).collect()
}

fn score_frame(sequence: &StrandSequence, t: usize, take: &Take, view: usize) -> Option<FrameScores> {
    let frame = sequence.frames[t] as usize;
    let (map, hair) = (take.read_orientation(view, frame).ok()?, take.read_hair(view, frame).ok()?);
    // A map that is all zero was never made.
    map.confidence.data.iter().any(|c| *c > 0.0).then_some(())?;
    let strands = (0..sequence.strand_count).map(|n| (n as u32, sequence.strand(t, n)));
    let drawn = StrandView::draw(&take.rig().cameras[view], strands, &occluder(take, frame));
    Some(FrameScores {
        frame,
        orientation: held_out_agreement(&drawn, &map.angle, &map.confidence),
        coverage: coverage(&drawn, &hair),
    })
}

/// The scalp where the head is in a frame; nothing where there is none yet.
fn occluder(take: &Take, frame: usize) -> TriMesh {
    let (Ok(scalp), Ok(pose)) = (take.read_scalp(), take.read_pose(frame)) else { return TriMesh::default() };
    let mut mesh = scalp.mesh;
    let middle = mesh.vertices.iter().sum::<glam::DVec3>() / mesh.vertices.len().max(1) as f64;
    mesh.vertices.iter_mut().for_each(|v| *v = pose.point(middle + (*v - middle) * OCCLUDER_SCALE));
    mesh
}

/// One row a stage and view, means over the frames.
pub fn table(scores: &[ViewScores]) -> Table {
    let title = if scores.iter().any(|view| view.held_out) { "held out" } else { "took part" };
    let mut table = Table::new(&[
        title,
        "view",
        "frames",
        "2D error, all pixels, degrees",
        "most confident half",
        "coverage IoU",
        "hair covered",
        "strands on hair",
    ]);
    for view in scores {
        let mean = |of: fn(&FrameScores) -> f64| view.frames.iter().map(of).sum::<f64>() / view.frames.len() as f64;
        table.row(
            &view.stage,
            [
                view.view.clone(),
                view.frames.len().to_string(),
                format!("{:.2}", mean(|f| f.orientation.all.mean)),
                format!("{:.2}", mean(|f| f.orientation.confident_half.mean)),
                format!("{:.3}", mean(|f| f.coverage.iou)),
                format!("{:.3}", mean(|f| f.coverage.hair_covered)),
                format!("{:.3}", mean(|f| f.coverage.strands_on_hair)),
            ],
        );
    }
    table
}
