//! The record of a work item: written last, removed first.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use serde::{Deserialize, Serialize};
use strandflow_core::Finding;

use super::Store;
use crate::{EngineError, disk};

/// A finished work item. Holds no times, so that the same input gives the same bytes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// What the result rests on, by kind: `version`, `mode`, `settings`, `values`, `files`, and one entry a stage read
    /// from. An item whose inputs hash otherwise now is stale, and the entry that differs says why.
    pub inputs: BTreeMap<String, String>,
    /// Hash of what was written, by array.
    pub outputs: BTreeMap<String, String>,
    /// What was survived.
    pub findings: Vec<Finding>,
}

/// A work item that could not be finished.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Failure {
    /// What is wrong.
    pub error: String,
    /// What to do.
    pub hint: String,
    /// Whether the input is to blame.
    pub input: bool,
}

impl Store {
    /// The record of an item, if it is finished and can be read.
    pub fn record(&self, item: &str) -> Option<Record> {
        self.finished(item).ok().flatten()
    }

    /// The record of an item, if it is finished. One that is no record counts as none; one that the system refuses to read does
    /// not: nothing may be made again, let alone removed, because file handles ran out.
    ///
    /// # Errors
    /// `Disk`.
    pub fn finished(&self, item: &str) -> Result<Option<Record>, EngineError> {
        let path = self.record_path(item);
        Ok(disk::read_if_there(&path)?.and_then(|bytes| serde_json::from_slice(&bytes).ok()))
    }

    /// Why an item failed, if it did.
    pub fn failure(&self, item: &str) -> Option<Failure> {
        serde_json::from_str(&std::fs::read_to_string(self.failure_path(item)).ok()?).ok()
    }

    /// Keys of the items of a phase (`stage/phase`) that are finished or failed, sorted. A phase that was never begun has none.
    pub fn items_of(&self, phase: &str) -> Vec<String> {
        let items = self.root().join(".items");
        let mut keys = Vec::new();
        keys_below(&items.join(phase), phase, &mut keys);
        keys.sort();
        keys
    }

    /// Declares an item finished.
    ///
    /// # Errors
    /// `Disk`.
    pub fn write_record(&self, item: &str, record: &Record) -> Result<(), EngineError> {
        self.put(&self.record_path(item), to_json(record)?.as_bytes())
    }

    /// Declares an item failed.
    ///
    /// # Errors
    /// `Disk`.
    pub fn write_failure(&self, item: &str, failure: &Failure) -> Result<(), EngineError> {
        self.put(&self.failure_path(item), to_json(failure)?.as_bytes())
    }

    /// Declares an item neither finished nor failed; before anything of it is written.
    ///
    /// # Errors
    /// `Disk`.
    pub fn forget(&self, item: &str) -> Result<(), EngineError> {
        disk::remove_file(&self.record_path(item))?;
        disk::remove_file(&self.failure_path(item))
    }

    /// Declares an item that is finished not to have failed: it had been refused something, and now was not.
    ///
    /// # Errors
    /// `Disk`.
    pub fn forgive(&self, item: &str) -> Result<(), EngineError> {
        disk::remove_file(&self.failure_path(item))
    }

    /// Forgets all items of a phase (`stage/phase`).
    ///
    /// # Errors
    /// `Disk`.
    pub fn forget_phase(&self, phase: &str) -> Result<(), EngineError> {
        self.remove(&format!(".items/{phase}"))
    }

    fn record_path(&self, item: &str) -> PathBuf {
        self.root().join(".items").join(format!("{item}.json"))
    }

    fn failure_path(&self, item: &str) -> PathBuf {
        self.root().join(".items").join(format!("{item}.failed"))
    }
}

/// Adds the keys of the records and failures below a folder, whose own key is `key`. A folder that cannot be read has none.
fn keys_below(folder: &Path, key: &str, found: &mut Vec<String>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for path in entries.flatten().map(|entry| entry.path()) {
        let Some(stem) = path.file_stem().and_then(|stem| stem.to_str()) else { continue };
        let key = format!("{key}/{stem}");
        match path.extension().and_then(|ending| ending.to_str()) {
            None => keys_below(&path, &key, found),
            Some("json" | "failed") => found.push(key),
            Some(_) => {}
        }
    }
}

fn to_json<T: Serialize>(value: &T) -> Result<String, EngineError> {
    serde_json::to_string_pretty(value).map_err(|e| EngineError::store(".items", e))
}
