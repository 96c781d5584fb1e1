//! What a run tells its audience, one typed event after another; the command line draws bars from them or prints JSON.

use serde::Serialize;
use strandflow_core::Finding;

use crate::{status::PhaseStatus, store::Failure};

/// How a work item ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Computed and stored.
    Done,
    /// Was there already and rests on the same inputs.
    Fresh,
    /// Could not be done.
    Failed,
    /// Something it needs is not there.
    Blocked,
}

/// One thing that happened.
#[derive(Clone, Debug, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// What was found wrong with the take before the first stage; the run goes on.
    Checked {
        /// The findings.
        findings: Vec<Finding>,
    },
    /// The run begins after the first stage, and stages before it are not up to date: what it makes rests on them as
    /// they are.
    Outdated {
        /// Their phases that are not done.
        phases: Vec<PhaseStatus>,
    },
    /// A phase begins.
    PhaseStarted {
        /// `stage/phase`.
        phase: &'static str,
        /// What the stage does.
        summary: &'static str,
        /// Its work items.
        items: usize,
    },
    /// A work item ended.
    Item {
        /// `stage/phase`.
        phase: &'static str,
        /// Its key.
        item: String,
        /// View and frame in words.
        place: String,
        /// How it ended.
        outcome: Outcome,
        /// Seconds it took.
        secs: f64,
        /// When it began, seconds since 1970.
        start: f64,
        /// Where: the machine, or what a scheduler calls it.
        node: &'static str,
        /// Largest resident memory of the process from the beginning of the phase to the item's end \[MB\]; `None` where the
        /// system does not tell.
        peak_mb: Option<f64>,
        /// What was survived.
        findings: Vec<Finding>,
        /// What went wrong, where it failed or is blocked.
        failure: Option<Failure>,
    },
    /// A phase ended.
    PhaseFinished {
        /// `stage/phase`.
        phase: &'static str,
        /// Wall-clock seconds.
        secs: f64,
        /// Largest resident memory during the phase \[MB\]; `None` where the system does not tell.
        peak_mb: Option<f64>,
    },
    /// The run ended. The last event, unless the results cannot be written at all.
    Ended {
        /// Whether everything that was asked for is there.
        complete: bool,
        /// Whether it was asked to stop.
        interrupted: bool,
        /// Items computed.
        done: usize,
        /// Items that were there already.
        fresh: usize,
        /// Items that failed.
        failed: usize,
        /// Items that something was missing for.
        blocked: usize,
        /// Wall-clock seconds.
        secs: f64,
    },
}
