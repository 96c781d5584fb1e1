//! Synthetic captures with ground truth.
//!
//! A [`SynthSpec`] says what to make; [`generate`] grows the hair and simulates it; the [`Scene`] then gives the truth
//! ([`Scene::frame`]) and the footage ([`Scene::render`], [`Scene::plate`]) one frame at a time, with the noise that
//! the spec's dials ask for. The same spec gives the same bytes at any number of threads. Files are not written here.
//!
//! ```
//! use strandflow_synth::{RigSpec, GroomSpec, SynthSpec, generate};
//!
//! let spec = SynthSpec {
//!     rig: RigSpec { frames: 1, width: 64, height: 48, ..RigSpec::default() },
//!     groom: GroomSpec { strands: 50, guides: 10, ..GroomSpec::default() },
//!     ..SynthSpec::default()
//! };
//! let scene = generate(&spec).expect("the spec is in range");
//! let pictures = scene.render(0);
//! assert_eq!(pictures.len(), 7);
//! assert_eq!(scene.frame(0).strands.strand_count(), 50);
//! ```

pub mod body;
mod check;
mod follow;
pub mod groom;
pub mod head;
mod light;
pub mod motion;
mod physics;
mod picture;
mod random;
mod raster;
pub mod render;
pub mod rig;
pub mod scene;
pub mod spec;
mod studio;

pub use check::SpecViolation;
pub use groom::Groom;
pub use render::{MarkerLabels, Picture};
pub use scene::{FrameTruth, MARKER_COLOURS, MARKER_RADIUS_MM, Scene, generate};
pub use spec::{BodySpec, GroomSpec, HandSpec, MotionSpec, NoiseSpec, PhysicsSpec, RigSpec, Style, SynthSpec};
pub use strandflow_dynamics::GRAVITY;
