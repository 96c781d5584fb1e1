//! The hash of every file that an item wrote, beside its record: what is lost or altered afterwards is found by them.

use std::path::PathBuf;

use super::{
    Store,
    files::{Sums, sum},
};
use crate::{EngineError, disk};

impl Store {
    /// Writes down the hashes of what an item wrote; before its record.
    pub(crate) fn write_sums(&self, item: &str, sums: &Sums) -> Result<(), EngineError> {
        let lines: String = sums.iter().map(|(file, sum)| format!("{sum} {file}\n")).collect();
        self.put(&self.sums_path(item), lines.as_bytes())
    }

    /// The first file of an item that is not as it was written, and how; reads all of them. Of an item that an earlier version
    /// of the program made nothing is known.
    pub fn damage(&self, item: &str) -> Option<String> {
        let sums = disk::read_text(&self.sums_path(item)).ok()?;
        let damaged = |line: &str| {
            let (wanted, file) = line.split_once(' ')?;
            match std::fs::read(self.root().join(file)) {
                Ok(bytes) if sum(&bytes) == wanted => None,
                Ok(_) => Some(format!("{file} is not as it was written")),
                Err(error) if strandflow_io::is_shortage(&error) => None,
                Err(error) => Some(format!("{file} cannot be read: {error}")),
            }
        };
        sums.lines().find_map(damaged)
    }

    fn sums_path(&self, item: &str) -> PathBuf {
        self.root().join(".items").join(format!("{item}.sums"))
    }
}
