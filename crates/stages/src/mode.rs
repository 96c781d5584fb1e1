//! The two readings of the method.

use serde::{Deserialize, Serialize};

/// Which reading of the method a stage follows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// The letter of the paper, to reproduce it.
    Paper,
    /// What measures best.
    #[default]
    Robust,
}
