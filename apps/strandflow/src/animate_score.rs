//! How well an animation of strands whose motion is known follows that motion, against strands that only the head carries.

use std::fmt;

use glam::{DVec3, Vec3};
use serde::Serialize;
use strandflow_core::{Report, SparseVoxels};
use strandflow_engine::{EngineError, Performance, animation::AnimationStrands};
use strandflow_eval::truth::Truth;
use strandflow_io::StrandFrames;
use strandflow_stages::{
    Mode,
    animate::Timeline,
    flow::{FlowInput, FlowSettings, flow},
};

use crate::failure::Failed;

/// Whose motion is known.
pub enum Reference<'a> {
    /// The true strands.
    Truth(&'a Truth),
    /// The captured strands after `blend`.
    Captured(&'a Performance),
}

impl Reference<'_> {
    fn strands(&self, frame: usize) -> Result<Vec<Vec<DVec3>>, EngineError> {
        match self {
            Self::Captured(performance) => performance.strands("blend", frame),
            Self::Truth(truth) => {
                let Some(t) = truth.at(frame as u32) else { return Ok(Vec::new()) };
                let strand = |n: usize| truth.strand(t, n).iter().map(|p| p.as_dvec3()).collect();
                Ok((0..truth.strand_count()).map(strand).collect())
            }
        }
    }

    fn name(&self) -> &'static str {
        match self {
            Self::Truth(_) => "true strands",
            Self::Captured(_) => "captured strands",
        }
    }
}

/// Mean errors over all frames after the first and all particles.
#[derive(Clone, Debug, Serialize)]
pub struct Scores {
    reference: &'static str,
    /// Of the animation.
    distance_mm: f64,
    velocity_mm_s: f64,
    /// Of the placed groom carried by the head.
    rigid_distance_mm: f64,
    rigid_velocity_mm_s: f64,
}

impl fmt::Display for Scores {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<22}{:>14}{:>18}", format!("to the {}", self.reference), "distance, mm", "velocity, mm/s")?;
        writeln!(f, "{:<22}{:>14.2}{:>18.1}", "animated", self.distance_mm, self.velocity_mm_s)?;
        writeln!(f, "{:<22}{:>14.2}{:>18.1}", "carried by the head", self.rigid_distance_mm, self.rigid_velocity_mm_s)?;
        let share = |a: f64, b: f64| format!("{:.0} %", 100.0 * a / b);
        let (distance, velocity) =
            (share(self.distance_mm, self.rigid_distance_mm), share(self.velocity_mm_s, self.rigid_velocity_mm_s));
        writeln!(f, "{:<22}{distance:>14}{velocity:>18}", "share")
    }
}

/// Compares an animation at captured speed with the reference, frame by frame.
pub fn compare(
    performance: &Performance,
    name: &str,
    timeline: &Timeline,
    reference: &Reference,
) -> Result<Scores, Failed> {
    let animated = AnimationStrands::open(performance.store(), name)?;
    let frames = (timeline.last - timeline.first + 1).min(animated.frames().len());
    let secs = 1.0 / performance.fps();
    let mut sums = [Sum::default(); 4];
    let first_pose = performance.pose(timeline.first)?;
    let groom = strands_of(&animated, 0)?;
    let (mut last, mut last_rigid, mut last_true) = (groom.clone(), groom.clone(), reference.strands(timeline.first)?);
    for k in 1..frames {
        let head = performance.pose(timeline.first + k)?.after(&first_pose.inverse());
        let (now, truth) = (strands_of(&animated, k)?, reference.strands(timeline.first + k)?);
        let rigid: Vec<Vec<DVec3>> = groom.iter().map(|s| s.iter().map(|p| head.point(*p)).collect()).collect();
        for n in 0..groom.len().min(truth.len()).min(last_true.len()) {
            let count = now[n].len().min(truth[n].len()).min(last_true[n].len());
            for i in 0..count {
                let moved = (truth[n][i] - last_true[n][i]) / secs;
                sums[0].add(now[n][i].distance(truth[n][i]));
                sums[1].add(((now[n][i] - last[n][i]) / secs).distance(moved));
                sums[2].add(rigid[n][i].distance(truth[n][i]));
                sums[3].add(((rigid[n][i] - last_rigid[n][i]) / secs).distance(moved));
            }
        }
        (last, last_rigid, last_true) = (now, rigid, truth);
    }
    let [distance_mm, velocity_mm_s, rigid_distance_mm, rigid_velocity_mm_s] = sums.map(Sum::mean);
    Ok(Scores { reference: reference.name(), distance_mm, velocity_mm_s, rigid_distance_mm, rigid_velocity_mm_s })
}

#[derive(Clone, Copy, Default)]
struct Sum(f64, usize);

impl Sum {
    fn add(&mut self, value: f64) {
        if value.is_finite() {
            *self = Self(self.0 + value, self.1 + 1);
        }
    }

    fn mean(self) -> f64 {
        self.0 / self.1.max(1) as f64
    }
}

fn strands_of(animated: &AnimationStrands, k: usize) -> Result<Vec<Vec<DVec3>>, Failed> {
    let frame = animated.frame(k)?;
    Ok((0..frame.strand_count).map(|n| frame.strand(0, n).iter().map(|p| p.as_dvec3()).collect()).collect())
}

/// The velocity field that stage `flow` makes of the true strands around a frame.
pub fn field_of_truth(
    truth: Option<&Truth>,
    performance: &Performance,
    frame: usize,
) -> Result<SparseVoxels<Vec3>, EngineError> {
    let lacking =
        || EngineError::input("--true-field", format!("the truth has no frame {frame}"), "give its gt/ folder");
    let truth = truth.ok_or_else(lacking)?;
    let t = truth.at(frame as u32).ok_or_else(lacking)?;
    let range = (t.saturating_sub(1), (t + 1).min(truth.frames.len() - 1));
    let width = truth.offsets.windows(2).map(|o| (o[1] - o[0]) as usize).max().unwrap_or(1);
    let padded = |t: usize| {
        let mut points = vec![Vec3::NAN; truth.strand_count() * width];
        for n in 0..truth.strand_count() {
            points[n * width..][..truth.strand(t, n).len()].copy_from_slice(truth.strand(t, n));
        }
        points
    };
    let (before, now, after) = (padded(range.0), padded(t), padded(range.1));
    let hull = performance.hull(frame)?;
    let input = FlowInput {
        frame,
        grid: hull.grid,
        hull: &hull,
        points: [&before, &now, &after],
        point_count: width,
        span_secs: (range.1 - range.0).max(1) as f64 / performance.fps(),
    };
    flow(&input, Mode::Robust, &FlowSettings::default(), &mut Report::default())
        .map_err(|error| EngineError::Stage { stage: "flow".into(), error: Box::new(error) })
}
