//! Why a request is not answered: a fact with its place, and what to do.

/// The kind decides the status of the answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The request makes no sense (400).
    Bad,
    /// What is asked for is not there (404).
    Missing,
    /// It was changed meanwhile (409).
    Changed,
    /// More was sent than is taken (413).
    TooLarge,
    /// It is there, and cannot be read or written (500).
    Broken,
}

/// A request that is not answered.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{error}")]
pub struct Refusal {
    /// What kind of refusal.
    pub kind: Kind,
    /// The place and the fact.
    pub error: String,
    /// What to do about it.
    pub hint: String,
}

impl Refusal {
    /// A request that makes no sense.
    pub fn bad(error: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { kind: Kind::Bad, error: error.into(), hint: hint.into() }
    }

    /// Something that is not there.
    pub fn missing(error: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { kind: Kind::Missing, error: error.into(), hint: hint.into() }
    }

    /// Something that was changed meanwhile.
    pub fn changed(error: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { kind: Kind::Changed, error: error.into(), hint: hint.into() }
    }

    /// Something too large.
    pub fn too_large(error: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { kind: Kind::TooLarge, error: error.into(), hint: hint.into() }
    }

    /// Something that is there and cannot be read or written.
    pub fn broken(error: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { kind: Kind::Broken, error: error.into(), hint: hint.into() }
    }

    /// The status of the answer.
    pub fn status(&self) -> u16 {
        match self.kind {
            Kind::Bad => 400,
            Kind::Missing => 404,
            Kind::Changed => 409,
            Kind::TooLarge => 413,
            Kind::Broken => 500,
        }
    }
}
