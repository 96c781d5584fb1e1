//! Why a stage cannot go on, and which settings are out of range.

use strandflow_core::{Place, SourceError};

/// Why a stage cannot go on. Every variant says where and what to do.
#[derive(Clone, Debug, thiserror::Error)]
pub enum StageError {
    /// The input cannot lead to a result.
    #[error("{place}: {fact}")]
    Input {
        /// Where.
        place: Place,
        /// What is the case.
        fact: String,
        /// What to do about it.
        hint: String,
    },
    /// A number that is not finite reached a stage boundary.
    #[error("{place}: {what} is not finite")]
    NonFinite {
        /// Where.
        place: Place,
        /// Which quantity.
        what: String,
    },
    /// An image could not be had.
    #[error(transparent)]
    Source(#[from] SourceError),
}

impl StageError {
    /// What the user can do.
    pub fn hint(&self) -> String {
        match self {
            Self::Input { hint, .. } => hint.clone(),
            Self::NonFinite { .. } => "check the calibration and the input of the stage before".into(),
            Self::Source(error) => error.hint.clone(),
        }
    }
}

/// A setting outside its range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{field} = {value}: {reason} (allowed: {range})")]
pub struct SettingViolation {
    /// Path of the field, e.g. `orient.wavelengths_px`.
    pub field: String,
    /// The value found.
    pub value: String,
    /// What is allowed.
    pub range: String,
    /// Why.
    pub reason: String,
}

impl SettingViolation {
    /// Adds a violation to `found` where `ok` does not hold.
    pub fn unless(
        ok: bool,
        found: &mut Vec<Self>,
        (field, value): (&str, impl ToString),
        (range, reason): (&str, &str),
    ) {
        if !ok {
            let (field, value) = (field.to_owned(), value.to_string());
            found.push(Self { field, value, range: range.to_owned(), reason: reason.to_owned() });
        }
    }
}
