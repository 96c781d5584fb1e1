//! Where a point's position comes from: what was seen and what was inferred.

use serde::{Deserialize, Serialize};

/// How a strand point came to be. The numbers are those of the exports.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum Provenance {
    /// No point here: the strand is shorter, or the frame does not have it.
    #[default]
    Missing = 0,
    /// The line direction was triangulated from images at this place.
    Observed = 1,
    /// The direction was filled in from the neighbourhood.
    Diffused = 2,
    /// The point comes from the fitted simulation where the frame had none.
    Simulated = 3,
    /// The whole strand was completed from its neighbours.
    Completed = 4,
}

impl Provenance {
    /// From the stored number; unknown numbers are `Missing`.
    pub fn from_number(number: u8) -> Self {
        match number {
            1 => Self::Observed,
            2 => Self::Diffused,
            3 => Self::Simulated,
            4 => Self::Completed,
            _ => Self::Missing,
        }
    }
}
