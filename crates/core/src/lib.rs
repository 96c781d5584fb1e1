//! The vocabulary of Strandflow: what the stages say to one another.
//!
//! Units are millimetres, seconds and radians throughout; see `docs/conventions.md`. This crate knows no other crate of
//! the workspace, opens no files and owns no threads.

pub mod camera;
pub mod chance;
pub mod frames;
pub mod grid;
pub mod image;
pub mod mesh;
pub mod provenance;
pub mod report;
pub mod rigid;
pub mod strands;

pub use camera::{Camera, Distortion, PolynomialLens, Rig};
pub use chance::normal_from_even;
pub use frames::{FrameRange, ImageSource, SourceError};
pub use grid::{Grid, Occupancy, SparseVoxels};
pub use image::{Mask, Plane, RgbImage};
pub use mesh::TriMesh;
pub use provenance::Provenance;
pub use report::{Finding, Place, Report};
pub use rigid::RigidTransform;
pub use strands::{StrandSequence, Strands};
