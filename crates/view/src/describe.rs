//! The JSON of the protocol. Lengths are millimetres; numbers that are not there are `null`.

use std::collections::BTreeMap;

use serde::Serialize;

/// What a take has to show.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Take {
    /// The folder's name.
    pub name: String,
    /// Frames a second.
    pub fps: f64,
    /// First frame and one past the last.
    pub frames: [usize; 2],
    /// \[mm/s²\], world.
    pub gravity: [f64; 3],
    /// The head's motion; no poses before stage `pose`.
    pub world_from_head: Motion,
    /// A box around the hair, or around what the cameras look at.
    pub bounds: Bounds,
    /// The cameras; none where the calibration cannot be read.
    pub views: Vec<View>,
    /// What has strands.
    pub sets: Vec<Set>,
    /// What strands can be coloured by.
    pub attributes: Vec<Attribute>,
    /// Which layers some frame has.
    pub layers: Layers,
    /// How each stage stands.
    pub stages: Vec<StageState>,
    /// What is missing, and what to do about it.
    pub notes: Vec<Note>,
}

/// Poses of the head, one a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Motion {
    /// Frame of the first pose.
    pub first: usize,
    /// World from head: 16 numbers, row-major; `null` where it is not known.
    pub poses: Vec<Option<Vec<f64>>>,
}

/// An axis-aligned box, world \[mm\].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Bounds {
    /// Smallest coordinates.
    pub lo: [f64; 3],
    /// Largest coordinates.
    pub hi: [f64; 3],
}

/// A camera. Distortion stays with the program: `project` goes through the lens.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct View {
    /// Its name.
    pub name: String,
    /// Image size \[px\].
    pub width: usize,
    /// See `width`.
    pub height: usize,
    /// Focal length and principal point \[px\].
    pub fx: f64,
    /// See `fx`.
    pub fy: f64,
    /// See `fx`.
    pub cx: f64,
    /// See `fx`.
    pub cy: f64,
    /// 16 numbers, row-major; OpenCV axes.
    pub camera_from_world: Vec<f64>,
    /// Centre of projection, world.
    pub center: [f64; 3],
    /// Whether the footage can be shown.
    pub footage: bool,
    /// Whether the view takes no part in the reconstruction.
    pub held_out: bool,
}

/// Strands over time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Set {
    /// What requests call it; a `/` in it is written `%2F` there.
    pub id: String,
    /// In words.
    pub title: String,
    /// Strands of every frame, absent ones included.
    pub strands: usize,
    /// Points of the longest.
    pub points: usize,
    /// First frame and one past the last.
    pub frames: [usize; 2],
    /// The frames that are there.
    pub done: Vec<usize>,
    /// Names of the attributes it has.
    pub attributes: Vec<String>,
}

/// Something to colour strands by.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Attribute {
    /// What requests call it.
    pub name: &'static str,
    /// `point` or `strand`.
    pub per: &'static str,
    /// Unit; empty where there is none.
    pub unit: &'static str,
    /// In words.
    pub title: &'static str,
    /// A range that shows most values well.
    pub range: [f64; 2],
    /// Names of the values 0, 1, ...; none where values are measures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub categories: Option<Vec<&'static str>>,
}

/// Which layers some frame has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Layers {
    /// Visual hulls.
    pub hull: bool,
    /// Lifted lines.
    pub lines: bool,
    /// Velocities.
    pub arrows: bool,
    /// Masks.
    pub masks: bool,
    /// Orientation maps.
    pub orientation: bool,
    /// The head.
    pub head: bool,
}

/// How a stage stands.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct StageState {
    /// Its name.
    pub name: &'static str,
    /// `done`, `partial`, `failed` or `none`. Whether it is up to date, `strandflow status` says.
    pub state: &'static str,
    /// In words.
    pub detail: String,
}

/// Something missing.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Note {
    /// What is the case.
    pub fact: String,
    /// What to do about it.
    pub hint: String,
}

/// One strand over time; lists have one entry a frame of `frames`, `null` where the frame lacks the strand.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StrandHistory {
    /// Frame numbers.
    pub frames: Vec<usize>,
    /// Length of what the frame has of it, gaps bridged.
    pub length_mm: Vec<Option<f64>>,
    /// Mean speed of its points.
    pub speed_mm_s: Vec<Option<f64>>,
    /// The same beside the head's motion; none where poses are not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relative_speed_mm_s: Option<Vec<Option<f64>>>,
    /// Mean distance of its points to the nearest true strand; only with truth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error_mm: Option<Vec<Option<f64>>>,
    /// Share of its points over all frames by provenance.
    pub provenance: BTreeMap<&'static str, f64>,
    /// Mean confidence of its points over all frames.
    pub confidence: Option<f64>,
    /// Fitted parameters, per unit mass.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub parameters: Option<BTreeMap<&'static str, f64>>,
    /// Root mean square distance of the refined to the given points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub residual_mm: Option<f64>,
    /// Most points that a frame has of it.
    pub points: usize,
}
