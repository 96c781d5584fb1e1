//! Why a request is not answered: a fact with its place, and what to do.

/// The kind decides the status of the answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The request makes no sense (400).
    Bad,
    /// What is asked for is not there (404).
    Missing,
    /// It is there, and cannot be read (500).
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

    /// Something that is there and cannot be read.
    pub fn broken(error: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { kind: Kind::Broken, error: error.into(), hint: hint.into() }
    }

    /// The status of the answer.
    pub fn status(&self) -> u16 {
        match self.kind {
            Kind::Bad => 400,
            Kind::Missing => 404,
            Kind::Broken => 500,
        }
    }
}
