//! Animated USD: one `BasisCurves` of constant topology with time samples, written frame by frame.
//!
//! Millimetres (`metersPerUnit` 0.001), Z up: the world is turned so that gravity points along −Z. Time codes are frame
//! numbers. `.usda` is text; `.usd` and `.usdc` are the binary crate format.

use std::path::Path;

use glam::{DQuat, DVec3, Quat, Vec3};

use crate::{
    IoError,
    error::At,
    strands::{Interchange, StrandFrames},
};

mod text;
mod usdc;

/// What a stage says besides the strands.
#[derive(Clone, Copy, Debug)]
pub struct UsdOptions {
    /// Frames per second.
    pub fps: f64,
    /// Gravity in the world, any unit; `None` where Z is up already.
    pub gravity: Option<DVec3>,
    /// Width of a strand \[mm\].
    pub width_mm: f32,
    /// Whether to write velocities (central differences over the frames) for motion blur.
    pub velocities: bool,
}

impl Default for UsdOptions {
    fn default() -> Self {
        // 0.08 mm is the width of a human hair.
        Self { fps: 100.0, gravity: None, width_mm: 0.08, velocities: true }
    }
}

/// Writes strands as USD; the ending of the file decides the form. Memory: a few frames.
///
/// # Errors
/// The ending is none of USD's, no strand takes part, a frame cannot be read, or the file cannot be written; the file is
/// then as it was before.
pub fn write_usd(path: &Path, strands: &dyn StrandFrames, options: &UsdOptions) -> Result<(), IoError> {
    let scene = Scene::new(strands, options)?;
    if scene.curves.strands.is_empty() {
        return Err(IoError::content(path, At::FILE, "no strand has two points to write", "export an earlier stage"));
    }
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    match extension.as_str() {
        "usda" => text::write(path, &scene),
        "usd" | "usdc" => usdc::write(path, &scene),
        _ => Err(IoError::content(path, At::FILE, "is no USD file name", "end it in .usd, .usdc or .usda")),
    }
}

/// What both forms write.
struct Scene<'a> {
    curves: Interchange<'a>,
    options: UsdOptions,
    turn: Quat,
}

/// One frame as it stands in the file.
struct Sample {
    points: Vec<Vec3>,
    velocities: Vec<Vec3>,
    provenance: Vec<i32>,
    confidence: Vec<f32>,
}

impl<'a> Scene<'a> {
    fn new(strands: &'a dyn StrandFrames, options: &UsdOptions) -> Result<Self, IoError> {
        let up = options.gravity.and_then(|gravity| (-gravity).try_normalize()).unwrap_or(DVec3::Z);
        let turn = DQuat::from_rotation_arc(up, DVec3::Z).as_quat();
        Ok(Self { curves: Interchange::new(strands)?, options: *options, turn })
    }

    fn times(&self) -> Vec<f64> {
        self.curves.frames().iter().map(|&frame| f64::from(frame)).collect()
    }

    fn points(&self, t: usize) -> Result<Vec<Vec3>, IoError> {
        Ok(self.curves.frame(t)?.points.into_iter().map(|point| self.turn * point).collect())
    }

    fn sample(&self, t: usize) -> Result<Sample, IoError> {
        let frame = self.curves.frame(t)?;
        let points: Vec<Vec3> = frame.points.into_iter().map(|point| self.turn * point).collect();
        let provenance = frame.provenance.iter().map(|&how| how as i32).collect();
        let velocities = if self.options.velocities { self.velocities(t, points.len())? } else { Vec::new() };
        Ok(Sample { points, velocities, provenance, confidence: frame.confidence })
    }

    /// Differences of the neighbouring frames [mm/s]; at the ends of one neighbour.
    fn velocities(&self, t: usize, count: usize) -> Result<Vec<Vec3>, IoError> {
        let frames = self.curves.frames();
        let (a, b) = (t.saturating_sub(1), (t + 1).min(frames.len() - 1));
        let seconds = (f64::from(frames[b]) - f64::from(frames[a])) / self.options.fps;
        if seconds <= 0.0 {
            return Ok(vec![Vec3::ZERO; count]);
        }
        let per_second = (1.0 / seconds) as f32;
        let (before, after) = (self.points(a)?, self.points(b)?);
        Ok(before.iter().zip(after).map(|(p, q)| (q - *p) * per_second).collect())
    }
}

/// The box around points, widened by the strands' width.
fn extent(points: &[Vec3], width: f32) -> [Vec3; 2] {
    let low = points.iter().copied().fold(Vec3::INFINITY, Vec3::min) - width * 0.5;
    let high = points.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max) + width * 0.5;
    [low, high]
}

#[cfg(test)]
#[path = "usd/tests.rs"]
mod tests;
