//! The rig doctor: whether a take's calibration, clocks, footage, masks and markers can carry a reconstruction.
//!
//! - [`table`]: every check, what it looks at and which stage it protects; [`check`] goes through it.
//! - [`finding`]: what a check says. [`evidence`]: what checks look at; [`gather`]: where it comes from.
//! - one file per family of checks, each with pure functions over small inputs.
//!
//! A fault is named by trying its repair: where exchanging two cameras lets the labelled markers agree, the cameras are
//! exchanged. What comes after judges the rig as if it were mended, so that one fault is said once.

pub mod calibration;
pub mod clock;
pub mod conventions;
pub mod cost;
pub mod coverage;
pub mod epipolar;
pub mod evidence;
pub mod files;
pub mod finding;
pub mod follow;
pub mod footage;
pub mod gather;
pub mod identity;
pub mod labels;
pub mod lens;
pub mod masks;
pub mod repair;
pub mod silhouettes;
pub mod table;
pub mod time;
pub mod turn;

pub use evidence::Evidence;
pub use finding::{Finding, Outcome, Verdict};
pub use table::{CHECKS, Check, Said, check, check_quick, check_to};
