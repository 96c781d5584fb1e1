//! Strands as animation programs take them: filled, in the program's space, with velocities and root coordinates.

use std::path::Path;

use glam::{DVec3, Mat3, Vec2, Vec3};

use crate::{
    IoError, Space,
    error::At,
    root_uv::root_uvs,
    strands::{Interchange, InterchangeFrame, StrandFrames},
};

/// What a scene says besides the strands.
#[derive(Clone, Copy, Debug)]
pub struct SceneOptions {
    /// Frames per second.
    pub fps: f64,
    /// Gravity in the world, any unit; `None` where Z is up already.
    pub gravity: Option<DVec3>,
    /// Width of a strand \[mm\].
    pub width_mm: f32,
    /// Whether to write velocities (central differences over the frames) for motion blur; USD only.
    pub velocities: bool,
    /// Unit and axes of the file.
    pub space: Space,
}

impl Default for SceneOptions {
    fn default() -> Self {
        // 0.08 mm is the width of a human hair.
        Self { fps: 100.0, gravity: None, width_mm: 0.08, velocities: true, space: Space::default() }
    }
}

/// Strands of fixed topology in the space of a file.
pub(crate) struct Scene<'a> {
    pub curves: Interchange<'a>,
    pub options: SceneOptions,
    /// One a strand that takes part, from the roots of the first frame.
    pub root_uvs: Vec<Vec2>,
    linear: Mat3,
}

/// One frame as it stands in the file.
pub(crate) struct Sample {
    pub points: Vec<Vec3>,
    /// Units a second; empty where none are asked for.
    pub velocities: Vec<Vec3>,
    pub provenance: Vec<i32>,
    pub confidence: Vec<f32>,
}

impl<'a> Scene<'a> {
    /// The scene of a file `path`, which errors name.
    ///
    /// # Errors
    /// There is no frame, no strand takes part, or a frame cannot be read.
    pub fn new(path: &Path, strands: &'a dyn StrandFrames, options: &SceneOptions) -> Result<Self, IoError> {
        let curves = Interchange::new(strands)?;
        if curves.strands.is_empty() {
            return Err(no_strand(path));
        }
        let upright = Space::default().linear_from_world(options.gravity).as_mat3();
        let roots: Vec<Vec3> = curves.roots(0)?.into_iter().map(|root| upright * root).collect();
        let linear = options.space.linear_from_world(options.gravity).as_mat3();
        Ok(Self { curves, options: *options, root_uvs: root_uvs(&roots), linear })
    }

    /// Frame numbers as times.
    pub fn times(&self) -> Vec<f64> {
        self.curves.frames().iter().map(|&frame| f64::from(frame)).collect()
    }

    /// Width of a strand in the file's unit.
    pub fn width(&self) -> f32 {
        (f64::from(self.options.width_mm) / self.options.space.unit_mm) as f32
    }

    /// Metres in a unit.
    pub fn metres_per_unit(&self) -> f64 {
        self.options.space.unit_mm / 1000.0
    }

    /// The `t`-th frame.
    pub fn sample(&self, t: usize) -> Result<Sample, IoError> {
        let frame = self.curves.frame(t)?;
        let points = self.turned(&frame);
        let provenance = frame.provenance.iter().map(|&how| how as i32).collect();
        let velocities = if self.options.velocities { self.velocities(t, points.len())? } else { Vec::new() };
        Ok(Sample { points, velocities, provenance, confidence: frame.confidence })
    }

    fn turned(&self, frame: &InterchangeFrame) -> Vec<Vec3> {
        frame.points.iter().map(|&point| self.linear * point).collect()
    }

    /// Differences of the neighbouring frames; at the ends of one neighbour.
    fn velocities(&self, t: usize, count: usize) -> Result<Vec<Vec3>, IoError> {
        let frames = self.curves.frames();
        let (a, b) = (t.saturating_sub(1), (t + 1).min(frames.len() - 1));
        let seconds = (f64::from(frames[b]) - f64::from(frames[a])) / self.options.fps;
        if seconds <= 0.0 {
            return Ok(vec![Vec3::ZERO; count]);
        }
        let per_second = (1.0 / seconds) as f32;
        let (before, after) = (self.curves.frame(a)?, self.curves.frame(b)?);
        let velocity = |(p, q): (&Vec3, &Vec3)| self.linear * (*q - *p) * per_second;
        Ok(before.points.iter().zip(&after.points).map(velocity).collect())
    }
}

pub(crate) fn no_strand(path: &Path) -> IoError {
    IoError::content(path, At::FILE, "no strand has two points to write", "export an earlier stage")
}

/// The box around points, widened by the strands' width.
pub(crate) fn extent(points: &[Vec3], width: f32) -> [Vec3; 2] {
    let low = points.iter().copied().fold(Vec3::INFINITY, Vec3::min) - width * 0.5;
    let high = points.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max) + width * 0.5;
    [low, high]
}
