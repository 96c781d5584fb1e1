//! `run.log`: one line of JSON a work item that was not fresh, and one a phase that had such items.

use std::{
    fs::{File, OpenOptions},
    io::{BufRead, BufReader, Write},
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
    time::{SystemTime, UNIX_EPOCH},
};

use crate::{
    EngineError, Event, Take, node,
    take::{RUN_LOG, TASK_LOGS},
};

/// A log of runs, open at its end.
pub(crate) struct Log(Mutex<File>);

impl Log {
    /// The take's log. Tasks write one a node: machines that append to one file of a shared folder write over one another.
    pub(crate) fn open(take: &Take, is_task: bool) -> Result<Self, EngineError> {
        let path = if is_task {
            let folder = take.root().join(TASK_LOGS);
            std::fs::create_dir_all(&folder).map_err(|error| EngineError::disk(&folder, error))?;
            folder.join(format!("{}.log", node::node()))
        } else {
            take.root().join(RUN_LOG)
        };
        let file = OpenOptions::new().create(true).append(true).open(&path);
        Ok(Self(Mutex::new(file.map_err(|error| EngineError::disk(&path, error))?)))
    }

    /// Appends a line in one piece, so that those of other processes of the machine stay whole.
    pub(crate) fn write(&self, event: &Event) {
        let Ok(mut line) = serde_json::to_value(event) else { return };
        line["unix_secs"] = unix_secs().into();
        let mut file = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // A log that cannot be written must not cost a result.
        let _ = file.write_all(format!("{line}\n").as_bytes());
    }
}

/// Seconds since 1970.
pub(crate) fn unix_secs() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64())
}

/// The lines of all logs of a take, log by log; the last of a killed run may be half a line.
pub fn log_lines(take: &Path) -> impl Iterator<Item = String> {
    let files = logs(take).into_iter().filter_map(|log| File::open(log).ok());
    files.flat_map(|file| BufReader::new(file).lines().map_while(Result::ok))
}

/// All logs of a take, as far as there are any.
fn logs(take: &Path) -> Vec<PathBuf> {
    let of_tasks = std::fs::read_dir(take.join(TASK_LOGS)).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut logs: Vec<PathBuf> = of_tasks.filter(|path| path.extension().is_some_and(|e| e == "log")).collect();
    logs.sort();
    logs.insert(0, take.join(RUN_LOG));
    logs
}
