//! The thirteen stages as pure functions: what goes in and what comes out is stated here, in the order of the pipeline; and
//! [`animate`], which drives other grooms with what they found.
//!
//! A stage is `fn(input, &Settings, &mut Report) -> Result<Output, StageError>`. Stages meet in `strandflow_core` types: they
//! do not depend on one another, open files or print. Parallelism inside a stage is rayon's; results do not depend on
//! the number of threads.

pub mod error;
pub mod mode;

pub mod animate;
pub mod blend;
pub mod field;
pub mod fit;
pub mod flow;
pub mod grow;
pub mod hair_edge;
pub mod hair_look;
pub mod hull;
pub mod key_frame;
pub mod lift;
pub mod masks;
mod neighbours;
pub mod orient;
pub mod pose;
pub mod prune;
pub mod scalp;
pub mod smooth;

pub use error::{SettingViolation, StageError};
pub use mode::Mode;
