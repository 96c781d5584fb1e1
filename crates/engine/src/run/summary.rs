//! What a run came to.

use crate::{Event, store::Failure};

/// What a run came to.
#[derive(Clone, Debug, Default)]
pub struct Summary {
    /// By phase, in order.
    pub phases: Vec<PhaseSummary>,
    /// Whether it was asked to stop.
    pub interrupted: bool,
}

/// What became of the items of one phase.
#[derive(Clone, Debug, Default)]
pub struct PhaseSummary {
    /// `stage/phase`.
    pub phase: &'static str,
    /// Wall-clock seconds.
    pub secs: f64,
    /// Largest resident memory \[MB\].
    pub peak_mb: Option<f64>,
    /// Items by outcome.
    pub done: usize,
    /// Items that were there already.
    pub fresh: usize,
    /// Items that failed.
    pub failed: usize,
    /// Items that something was missing for.
    pub blocked: usize,
    /// Number of findings.
    pub findings: usize,
    /// Kinds of findings: those of one view with the same consequence are one.
    pub finding_kinds: usize,
    /// The first of the first kinds, in words, by view.
    pub first_findings: Vec<String>,
    /// The failures, by item.
    pub failures: Vec<(String, Failure)>,
}

impl Summary {
    /// Items that failed.
    pub fn failures(&self) -> impl Iterator<Item = &(String, Failure)> {
        self.phases.iter().flat_map(|phase| &phase.failures)
    }

    /// Whether everything asked for is there.
    pub fn complete(&self) -> bool {
        !self.interrupted && self.phases.iter().all(|phase| phase.failed == 0 && phase.blocked == 0)
    }

    pub(super) fn ended(&self, secs: f64) -> Event {
        let sum = |of: fn(&PhaseSummary) -> usize| self.phases.iter().map(of).sum();
        Event::Ended {
            complete: self.complete(),
            interrupted: self.interrupted,
            done: sum(|phase| phase.done),
            fresh: sum(|phase| phase.fresh),
            failed: sum(|phase| phase.failed),
            blocked: sum(|phase| phase.blocked),
            secs,
        }
    }
}
