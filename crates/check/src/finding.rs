//! What a check says: a verdict, the numbers behind it, and what was found.

use serde::Serialize;

/// How grave it is; the order is that of gravity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Nothing stands out.
    Sound,
    /// What the check needs is not there or is at fault itself; the outcome says what.
    NotJudged,
    /// A run goes through, and something of it suffers.
    LookAtThis,
    /// A run fails, or what it makes has nothing to do with the footage.
    CannotWork,
}

impl Verdict {
    /// The verdict in words.
    pub fn in_words(self) -> &'static str {
        match self {
            Self::Sound => "sound",
            Self::NotJudged => "not judged",
            Self::LookAtThis => "look at this",
            Self::CannotWork => "cannot work",
        }
    }
}

/// One thing that is wrong.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// The fault's name, `words-with-hyphens`; `docs/check.md` lists those that are planted.
    pub fault: &'static str,
    /// How grave it is.
    pub verdict: Verdict,
    /// Where: views, frames, markers, or a file.
    pub place: String,
    /// What is the case, with numbers.
    pub fact: String,
    /// The first stage that suffers, and how.
    pub suffers: &'static str,
    /// What to do.
    pub hint: String,
}

impl Finding {
    /// Something to look at.
    pub fn look(fault: &'static str, place: impl Into<String>, fact: impl Into<String>) -> Self {
        let (place, fact) = (place.into(), fact.into());
        Self { fault, verdict: Verdict::LookAtThis, place, fact, suffers: "", hint: String::new() }
    }

    /// Something with which a run cannot work.
    pub fn cannot(fault: &'static str, place: impl Into<String>, fact: impl Into<String>) -> Self {
        Self { verdict: Verdict::CannotWork, ..Self::look(fault, place, fact) }
    }

    /// With the stage that suffers, and how.
    pub fn suffers(mut self, what: &'static str) -> Self {
        self.suffers = what;
        self
    }

    /// With what to do.
    pub fn hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = hint.into();
        self
    }
}

/// What one check came to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// What was measured, in a few words with numbers; why nothing was, where it was not.
    pub measured: String,
    /// Whether it could be judged at all.
    pub unjudged: bool,
    /// What is wrong.
    pub findings: Vec<Finding>,
}

impl Outcome {
    /// What was measured, and what is wrong.
    pub fn of(measured: impl Into<String>, findings: Vec<Finding>) -> Self {
        Self { measured: measured.into(), unjudged: false, findings }
    }

    /// Not judged, because of this.
    pub fn unjudged(why: impl Into<String>) -> Self {
        Self { measured: why.into(), unjudged: true, findings: Vec::new() }
    }

    /// The gravest verdict.
    pub fn verdict(&self) -> Verdict {
        let grave = self.findings.iter().map(|finding| finding.verdict).max();
        grave.unwrap_or(if self.unjudged { Verdict::NotJudged } else { Verdict::Sound })
    }
}
