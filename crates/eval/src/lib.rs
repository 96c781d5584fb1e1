//! Metrics, comparisons and report figures.
//!
//! Each metric is a pure function from results and truth to a plain, serialisable record of scores.

pub mod drawing;
pub mod dynamics;
pub mod head;
pub mod images;
pub mod index;
pub mod lengths;
pub mod markers;
pub mod overlay;
pub mod raster;
pub mod sketches;
pub mod spectrum;
pub mod statistics;
pub mod strands;
pub mod table;
pub mod truth;
pub mod volume;

pub use dynamics::{DynamicsSampling, DynamicsScores, evaluate_dynamics, evaluate_refinement};
pub use statistics::Summary;
pub use strands::{StrandSampling, StrandScores, evaluate_strands};
pub use table::Table;
pub use truth::{Truth, TruthError};
