//! What an item's result rests on, hashed by kind, so that a stale item can say why.

use std::{
    collections::{BTreeMap, HashMap},
    io::Read,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
};

use serde::Serialize;

use crate::{
    EngineError,
    store::{Record, Store},
};

/// Collects the inputs of one item.
pub struct Needs<'a> {
    store: &'a Store,
    files: &'a Identities,
    records: Option<&'a Records>,
    kinds: BTreeMap<String, blake3::Hasher>,
    items: Vec<String>,
}

impl<'a> Needs<'a> {
    /// Nothing needed yet.
    pub fn new(store: &'a Store, files: &'a Identities) -> Self {
        Self { store, files, records: None, kinds: BTreeMap::new(), items: Vec::new() }
    }

    /// With records that were read before; for looks at many items while none is made.
    pub(crate) fn by(self, records: Option<&'a Records>) -> Self {
        Self { records, ..self }
    }

    /// A value of a kind (`version`, `mode`, `settings`, `values`).
    pub fn value(&mut self, kind: &str, name: &str, value: &impl Serialize) {
        let text = serde_json::to_string(value).unwrap_or_default();
        let hasher = self.kinds.entry(kind.to_owned()).or_default();
        hasher.update(name.as_bytes()).update(b"=").update(text.as_bytes()).update(b"\n");
    }

    /// A file of the user, by what is in it.
    ///
    /// # Errors
    /// `Disk` where it does not exist.
    pub fn file(&mut self, path: &Path) -> Result<(), EngineError> {
        let identity = self.files.of(path)?;
        self.kinds.entry("files".into()).or_default().update(identity.as_bytes());
        Ok(())
    }

    /// Some arrays of a finished item.
    ///
    /// # Errors
    /// `Missing` where the item is not finished; `Disk` where that cannot be told.
    pub fn item(&mut self, key: &str, arrays: &[&str]) -> Result<(), EngineError> {
        self.arrays_of(key, arrays).map(drop)
    }

    /// A finished item whose values are stated by [`Needs::value`] instead; its record.
    ///
    /// # Errors
    /// `Missing` where the item is not finished.
    pub fn finished(&mut self, key: &str) -> Result<Arc<Record>, EngineError> {
        self.arrays_of(key, &[])
    }

    fn arrays_of(&mut self, key: &str, arrays: &[&str]) -> Result<Arc<Record>, EngineError> {
        let record = match self.records {
            Some(records) => records.of(self.store, key)?,
            None => self.store.finished(key)?.map(Arc::new),
        };
        let record = record.ok_or_else(|| EngineError::Missing { item: key.to_owned() })?;
        let stage = key.split('/').next().unwrap_or_default();
        let hasher = self.kinds.entry(format!("stage {stage}")).or_default();
        for array in arrays {
            let hash = record.outputs.get(*array).map_or("none", String::as_str);
            hasher.update(array.as_bytes()).update(hash.as_bytes());
        }
        self.items.push(key.to_owned());
        Ok(record)
    }

    /// The hashes by kind, and the keys of the items read.
    pub fn finish(self) -> (BTreeMap<String, String>, Vec<String>) {
        let hash = |h: blake3::Hasher| h.finalize().to_hex()[..32].to_owned();
        (self.kinds.into_iter().map(|(kind, hasher)| (kind, hash(hasher))).collect(), self.items)
    }
}

/// Records, read once: every frame after `fit` rests on all blocks.
#[derive(Default)]
pub(crate) struct Records(Mutex<HashMap<String, Option<Arc<Record>>>>);

impl Records {
    /// The record of an item, if it is finished.
    ///
    /// # Errors
    /// `Disk`.
    pub(crate) fn of(&self, store: &Store, key: &str) -> Result<Option<Arc<Record>>, EngineError> {
        let known = self.0.lock().unwrap_or_else(PoisonError::into_inner).get(key).cloned();
        if let Some(known) = known {
            return Ok(known);
        }
        let record = store.finished(key)?.map(Arc::new);
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(key.to_owned(), record.clone());
        Ok(record)
    }
}

/// Files up to this size are known by all of their content, larger ones by size, time of change and both ends.
const WHOLE_BYTES: u64 = 8 << 20;
const END_BYTES: usize = 1 << 16;

/// The identity of files, looked up once a process.
#[derive(Debug, Default)]
pub struct Identities(Mutex<HashMap<PathBuf, String>>);

impl Identities {
    /// The identity of a file.
    ///
    /// # Errors
    /// `Disk` where it cannot be read.
    pub fn of(&self, path: &Path) -> Result<String, EngineError> {
        let known = self.0.lock().unwrap_or_else(PoisonError::into_inner).get(path).cloned();
        if let Some(identity) = known {
            return Ok(identity);
        }
        let identity = identify(path).map_err(|error| EngineError::disk(path, error))?;
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(path.to_owned(), identity.clone());
        Ok(identity)
    }
}

fn identify(path: &Path) -> std::io::Result<String> {
    let mut file = std::fs::File::open(path)?;
    let about = file.metadata()?;
    let mut hasher = blake3::Hasher::new();
    if about.len() <= WHOLE_BYTES {
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)?;
        hasher.update(&bytes);
    } else {
        use std::io::{Seek, SeekFrom};
        let changed = about.modified()?.duration_since(std::time::UNIX_EPOCH).map(|d| d.as_nanos()).unwrap_or(0);
        let mut end = vec![0; END_BYTES];
        file.read_exact(&mut end)?;
        hasher.update(&end).update(&about.len().to_le_bytes()).update(&changed.to_le_bytes());
        file.seek(SeekFrom::End(-(END_BYTES as i64)))?;
        file.read_exact(&mut end)?;
        hasher.update(&end);
    }
    Ok(hasher.finalize().to_hex()[..32].to_owned())
}
