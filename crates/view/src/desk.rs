//! What the page of `strandflow annotate` asks for and hands in, answered by whoever knows a take.

use std::collections::BTreeMap;

use serde::Serialize;
use strandflow_core::{Distortion, Mask};

use crate::{
    Picture, Refusal,
    describe::{Note, View},
};

/// Version of something that is not there; whoever makes it states it.
pub const ABSENT: &str = "absent";

/// A document of the take with the version that it has now. Whoever hands a document in states the version it was made from;
/// where the document has another one by now, nothing is written ([`crate::refusal::Kind::Changed`]).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Document {
    /// Changes with the content; [`ABSENT`] where there is no file.
    pub version: String,
    /// JSON.
    pub json: Vec<u8>,
}

/// Which masks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MaskKind {
    /// Hair.
    Hair,
    /// Head, hair and markers.
    Subject,
}

/// Where a mask comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// There is none.
    None = 0,
    /// A person gave it for this frame.
    Given = 1,
    /// The program made it.
    Computed = 2,
}

/// A mask, and the version of the file that a person gave.
#[derive(Clone, Debug, PartialEq)]
pub struct MaskFound {
    /// Of the given file; [`ABSENT`] where none is given.
    pub version: String,
    /// Where it comes from.
    pub origin: Origin,
    /// Coverage, of the view's size; all 0 where there is none.
    pub mask: Mask,
}

/// What there is to label.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Work {
    /// Tells takes apart: that of the same folder is the same whenever it is opened.
    pub id: String,
    /// The folder's name.
    pub name: String,
    /// Frames a second.
    pub fps: f64,
    /// First frame and one past the last.
    pub frames: [usize; 2],
    /// The cameras.
    pub views: Vec<WorkView>,
    /// Frames with a given hair mask, by view.
    pub hair: BTreeMap<String, Vec<usize>>,
    /// Frames with a given subject mask, by view.
    pub subject: BTreeMap<String, Vec<usize>>,
    /// Frames with sketches.
    pub sketches: Vec<usize>,
    /// Radius of a marker in the images \[px\].
    pub marker_radius_px: f64,
    /// What is missing, and what to do about it.
    pub notes: Vec<Note>,
}

/// A camera, with its lens: the page draws epipolar lines itself.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WorkView {
    /// As in the viewer.
    #[serde(flatten)]
    pub view: View,
    /// The lens, as calibrations of our own write it.
    pub distortion: Distortion,
}

/// Where stage `pose` saw the markers in a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Tracks {
    /// Image point \[px\] by view and number of the marker.
    pub views: BTreeMap<String, BTreeMap<u32, [f64; 2]>>,
    /// World position \[mm\] that the pose gives each marker.
    pub markers: BTreeMap<u32, [f64; 3]>,
    /// Markers that the pose rests on.
    pub used: u32,
    /// Root mean square reprojection error \[px\].
    pub rms_px: Option<f64>,
    /// Whether the pose lies between those of its neighbours.
    pub interpolated: bool,
}

/// Everything that the page asks for and hands in. Called from several threads at once.
///
/// Frames are numbers of the take, views go by their names. What is written is written whole or not at all, and never outside
/// the take. What is handed in and refused is a [`Refusal`] that says where and why.
#[expect(clippy::missing_errors_doc, reason = "one contract for all methods, above")]
pub trait Desk: Send + Sync + 'static {
    /// What there is to label.
    fn work(&self) -> Result<Work, Refusal>;
    /// The footage, as filmed.
    fn image(&self, view: &str, frame: usize) -> Result<Picture, Refusal>;
    /// Image size of a view \[px\].
    fn size(&self, view: &str) -> Result<(usize, usize), Refusal>;
    /// Labels of markers.
    fn labels(&self) -> Result<Document, Refusal>;
    /// New labels, made from the stated version; gives their version.
    fn put_labels(&self, made_from: &str, json: &[u8]) -> Result<String, Refusal>;
    /// Where stage `pose` saw the markers.
    fn tracks(&self, frame: usize) -> Result<Tracks, Refusal>;
    /// A mask.
    fn mask(&self, kind: MaskKind, view: &str, frame: usize) -> Result<MaskFound, Refusal>;
    /// A new mask of the view's size, or none: the program's own holds again.
    fn put_mask(
        &self,
        kind: MaskKind,
        view: &str,
        frame: usize,
        made_from: &str,
        mask: Option<&Mask>,
    ) -> Result<String, Refusal>;
    /// Sketched strands of a frame.
    fn sketches(&self, frame: usize) -> Result<Document, Refusal>;
    /// New sketches of a frame.
    fn put_sketches(&self, frame: usize, made_from: &str, json: &[u8]) -> Result<String, Refusal>;
    /// Told of every request that was refused.
    fn refused(&self, request: &str, status: u16, why: &str);
}
