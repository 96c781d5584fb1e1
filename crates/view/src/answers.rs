//! What has to be answered by whoever knows a take.

use std::sync::Arc;

use glam::Vec3;
use strandflow_core::{Plane, RgbImage, TriMesh};

use crate::{
    Refusal, Selection,
    describe::{StrandHistory, Take},
};

/// Values of chosen strands, strand after strand.
#[derive(Clone, Debug, PartialEq)]
pub struct PerStrand<T> {
    /// Values a strand.
    pub points: usize,
    /// Shape (strands, points).
    pub values: Vec<T>,
}

/// An image, as it goes to the browser.
#[derive(Clone, Debug, PartialEq)]
pub enum Picture {
    /// Goes as JPEG.
    Photo(Arc<RgbImage>),
    /// Goes as PNG; red, green, blue, opacity.
    Layer(Plane<[u8; 4]>),
}

/// Everything that the page can ask for. Called from several threads at once; must not change the take.
///
/// Frames are numbers of the take, views go by their names. Lengths are millimetres. What is not there is
/// a [`Refusal`] that says where and what to do.
#[expect(clippy::missing_errors_doc, reason = "one contract for all methods, above")]
pub trait Answers: Send + Sync + 'static {
    /// What there is.
    fn take(&self) -> Result<Take, Refusal>;
    /// Positions of strands in a frame, world; NaN where missing.
    fn strands(&self, set: &str, frame: usize, selection: &Selection) -> Result<PerStrand<Vec3>, Refusal>;
    /// Values of an attribute in the order of [`Answers::strands`], one a point or one a strand.
    fn attribute(&self, set: &str, name: &str, frame: usize, selection: &Selection) -> Result<PerStrand<f32>, Refusal>;
    /// Image points \[px\] of strands in a view; NaN where missing or behind the camera.
    fn project(
        &self,
        set: &str,
        view: &str,
        frame: usize,
        selection: &Selection,
    ) -> Result<PerStrand<[f32; 2]>, Refusal>;
    /// One strand over all frames.
    fn strand(&self, set: &str, index: usize) -> Result<StrandHistory, Refusal>;
    /// The footage, as filmed.
    fn image(&self, view: &str, frame: usize) -> Result<Picture, Refusal>;
    /// Hair and subject in colours.
    fn mask(&self, view: &str, frame: usize) -> Result<Picture, Refusal>;
    /// Orientation: the hue is the angle, the opacity the confidence.
    fn orientation(&self, view: &str, frame: usize) -> Result<Picture, Refusal>;
    /// The head, head space.
    fn head(&self) -> Result<TriMesh, Refusal>;
    /// The visual hull, world.
    fn hull(&self, frame: usize) -> Result<TriMesh, Refusal>;
    /// Lifted lines: voxel centre, direction, confidence; at most so many.
    fn lines(&self, frame: usize, most: Option<usize>) -> Result<Vec<[f32; 7]>, Refusal>;
    /// Velocities: voxel centre, velocity \[mm/s\]; at most so many.
    fn arrows(&self, frame: usize, most: Option<usize>) -> Result<Vec<[f32; 6]>, Refusal>;
}
