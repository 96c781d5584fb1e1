//! What was submitted, kept as `farm/jobs.json` within the take.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::{EngineError, Take, disk, take::FARM};

const JOBS: &str = "jobs.json";

/// The jobs of a take that were submitted last.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ledger {
    /// In the order of submission.
    pub jobs: Vec<Submitted>,
}

/// One array that was submitted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Submitted {
    /// Number of the job.
    pub job: u64,
    /// `stage/phase`, in order.
    pub phases: Vec<String>,
    /// Parts of a task.
    pub per_task: usize,
    /// Its tasks.
    pub tasks: Vec<usize>,
}

impl Ledger {
    /// The ledger of a take; empty where nothing was submitted.
    ///
    /// # Errors
    /// `Input` where the file is there and cannot be read.
    pub fn of_take(root: &Path) -> Result<Self, EngineError> {
        let path = root.join(FARM).join(JOBS);
        if !path.exists() {
            return Ok(Self::default());
        }
        let text = disk::read_text(&path)?;
        serde_json::from_str(&text).map_err(|error| {
            let hint = "remove the file; jobs that are still queued are then unknown to `status`";
            EngineError::input(path.display().to_string(), error.to_string(), hint)
        })
    }

    /// Writes it down.
    ///
    /// # Errors
    /// `Disk`.
    pub fn write(&self, take: &Take) -> Result<(), EngineError> {
        let path = take.root().join(FARM).join(JOBS);
        let text = serde_json::to_string_pretty(self).map_err(|error| EngineError::disk(&path, error))?;
        take.store().put(&path, text.as_bytes())
    }
}
