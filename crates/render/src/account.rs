//! What the phases of a picture cost.

use std::time::{Duration, Instant};

/// What a phase of a picture did, and how long it took.
#[derive(Clone, Debug, PartialEq)]
pub struct Phase {
    /// What it is.
    pub name: &'static str,
    /// Wall clock \[s\]; of phases within another one (`draw: …`) the sum over all threads.
    pub secs: f64,
    /// How many things it dealt with. Points lit twice, by two threads at once, count twice.
    pub count: usize,
    /// What they are.
    pub of: &'static str,
}

/// The phases up to now.
pub(crate) struct Account {
    /// In their order.
    pub phases: Vec<Phase>,
    since: Instant,
}

impl Account {
    /// The first phase begins.
    pub(crate) fn start() -> Self {
        Self { phases: Vec::new(), since: Instant::now() }
    }

    /// A phase ends, the next one begins.
    pub(crate) fn end(&mut self, name: &'static str, of: &'static str, count: usize) {
        self.phases.push(Phase { name, secs: self.since.elapsed().as_secs_f64(), count, of });
        self.since = Instant::now();
    }

    /// A part of the phase that ended last, on all threads.
    pub(crate) fn within(&mut self, name: &'static str, of: &'static str, (count, time): (usize, Duration)) {
        self.phases.push(Phase { name, secs: time.as_secs_f64(), count, of });
    }
}
