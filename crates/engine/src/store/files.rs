//! The files of the store: written whole or not at all, whoever else is writing; the checksum at a chunk's end is looked at
//! whatever part of it is asked for.

use std::{
    collections::BTreeMap,
    io::{Error, ErrorKind, Result},
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use zarrs::storage::{
    Bytes, MaybeBytesIterator, OffsetBytesIterator, ReadableStorageTraits, StorageError, StoreKey, StorePrefix,
    WritableStorageTraits, byte_range::ByteRangeIterator,
};

use crate::node;

/// Where files are written before they get their name. What a killed process left there is removed by [`Files::sweep`].
const UNNAMED: &str = ".tmp";

/// What another machine left without a name is that of a killed process after this time: no chunk takes so long to write.
const ABANDONED: Duration = Duration::from_secs(24 * 3600);

/// Bytes of a checksum at the end of a chunk.
const CHECKSUM: usize = 4;

/// Hashes of written chunks, by their path in the store.
pub(crate) type Sums = BTreeMap<String, String>;

/// One way of looking at the files of a store.
#[derive(Clone)]
pub(crate) struct Files {
    root: PathBuf,
    /// Whether a chunk that was never written is damage rather than fill values.
    complete: Arc<AtomicBool>,
    /// Whether chunks end in a checksum.
    checked: bool,
    /// Notes what is written.
    notes: Option<Arc<Mutex<Sums>>>,
}

impl Files {
    pub(crate) fn new(root: &Path) -> Self {
        Self { root: root.to_owned(), complete: Arc::default(), checked: false, notes: None }
    }

    /// The same files, whose chunks end in a checksum.
    pub(crate) fn checked(&self) -> Self {
        Self { checked: true, ..self.clone() }
    }

    /// The same files; `notes` gets the hashes of chunks that are written.
    pub(crate) fn noting(&self, notes: Arc<Mutex<Sums>>) -> Self {
        Self { notes: Some(notes), ..self.clone() }
    }

    /// From now on only finished chunks are asked for.
    pub(crate) fn expect_complete(&self) {
        self.complete.store(true, Ordering::Relaxed);
    }

    /// Writes a file and the folders above it: readers see the old bytes or the new, and of two writers the later wins.
    pub(crate) fn put(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        let unnamed = self.unnamed_for(path);
        let in_folder = |path: &Path, act: &dyn Fn() -> Result<()>| match act() {
            Err(error) if error.kind() == ErrorKind::NotFound => {
                path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
                act()
            }
            done => done,
        };
        let done = in_folder(&unnamed, &|| std::fs::write(&unnamed, bytes))
            .and_then(|()| in_folder(path, &|| std::fs::rename(&unnamed, path)));
        if done.is_err() {
            // What cannot be removed was never made.
            let _ = std::fs::remove_file(&unnamed);
        }
        done
    }

    /// Removes a folder that may not exist: it is out of the way at once, however much is in it.
    pub(crate) fn remove_folder(&self, folder: &Path) -> Result<()> {
        if !folder.exists() {
            return Ok(());
        }
        let unnamed = self.unnamed_for(folder);
        unnamed.parent().map_or(Ok(()), std::fs::create_dir_all)?;
        match std::fs::rename(folder, &unnamed) {
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
            Err(error) => Err(error),
            Ok(()) => std::fs::remove_dir_all(&unnamed),
        }
    }

    /// A name that no other process on any machine uses, and this one once; for files beside the store in its own folder: the
    /// store may lie on another disk.
    fn unnamed_for(&self, path: &Path) -> PathBuf {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let nanos = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.subsec_nanos());
        let (process, next) = (std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        let above = if path.starts_with(&self.root) { Some(&*self.root) } else { path.parent() };
        above.unwrap_or(Path::new("")).join(UNNAMED).join(format!("{}~{process}~{nanos:x}~{next}", node::machine()))
    }

    /// Removes what killed processes left in the store and in the folder that it lies in.
    pub(crate) fn sweep(&self) {
        [Some(&*self.root), self.root.parent()].into_iter().flatten().for_each(|folder| sweep(&folder.join(UNNAMED)));
    }

    fn read(&self, key: &StoreKey) -> std::result::Result<Option<Bytes>, StorageError> {
        let checked = self.checked && is_chunk(key.as_str());
        let damaged = |fact: &str| Err(StorageError::Other(format!("chunk `{key}` {fact}")));
        match std::fs::read(self.root.join(key.as_str())) {
            Ok(bytes) if checked && !ends_in_its_checksum(&bytes) => damaged("does not match its checksum"),
            Ok(bytes) => Ok(Some(Bytes::from(bytes))),
            Err(error) if error.kind() == ErrorKind::NotFound => {
                let damage = checked && self.complete.load(Ordering::Relaxed);
                if damage { damaged("is not there") } else { Ok(None) }
            }
            Err(error) => Err(StorageError::IOError(Arc::new(error))),
        }
    }
}

fn sweep(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let age = entry.metadata().and_then(|about| about.modified()).ok().and_then(|at| at.elapsed().ok());
        let old = age.is_some_and(|age| age > ABANDONED);
        if old || of_dead_process(&entry.file_name().to_string_lossy()) {
            // Another process may sweep too.
            let path = entry.path();
            let _ = if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
        }
    }
    // Stays where it is in use; who needs it makes it.
    let _ = std::fs::remove_dir(folder);
}

/// Whether a file without a name is of a process of this machine that is no more.
fn of_dead_process(name: &str) -> bool {
    let mut parts = name.split('~');
    let (machine, process) = (parts.next(), parts.next().and_then(|id| id.parse::<u32>().ok()));
    let alive = |process: u32| !cfg!(target_os = "linux") || Path::new(&format!("/proc/{process}")).exists();
    machine == Some(node::machine()) && process.is_some_and(|process| !alive(process))
}

/// Whether a key is that of a chunk: `ARRAY/c/0/1`.
fn is_chunk(key: &str) -> bool {
    !key.ends_with("zarr.json")
}

fn ends_in_its_checksum(bytes: &[u8]) -> bool {
    let Some(at) = bytes.len().checked_sub(CHECKSUM) else { return false };
    let (data, checksum) = bytes.split_at(at);
    crc32c::crc32c(data).to_le_bytes() == checksum
}

/// The hash by which [`Files`] notes a file.
pub(crate) fn sum(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex()[..16].to_owned()
}

impl ReadableStorageTraits for Files {
    fn get_partial_many<'a>(
        &'a self,
        key: &StoreKey,
        ranges: ByteRangeIterator<'a>,
    ) -> std::result::Result<MaybeBytesIterator<'a>, StorageError> {
        let Some(bytes) = self.read(key)? else { return Ok(None) };
        let size = bytes.len() as u64;
        Ok(Some(Box::new(ranges.map(move |range| {
            let (start, end) = (range.start(size), range.end(size));
            let lies_inside = start <= end && end <= size;
            lies_inside
                .then(|| bytes.slice(start as usize..end as usize))
                .ok_or_else(|| StorageError::Other(format!("bytes {start}..{end} of {size}")))
        }))))
    }

    fn size_key(&self, key: &StoreKey) -> std::result::Result<Option<u64>, StorageError> {
        Ok(std::fs::metadata(self.root.join(key.as_str())).ok().map(|about| about.len()))
    }

    fn supports_get_partial(&self) -> bool {
        false
    }
}

impl WritableStorageTraits for Files {
    fn set(&self, key: &StoreKey, value: Bytes) -> std::result::Result<(), StorageError> {
        self.put(&self.root.join(key.as_str()), &value).map_err(|error| StorageError::IOError(Arc::new(error)))?;
        if let Some(notes) = &self.notes {
            notes.lock().unwrap_or_else(PoisonError::into_inner).insert(key.as_str().to_owned(), sum(&value));
        }
        Ok(())
    }

    fn set_partial_many(&self, _: &StoreKey, _: OffsetBytesIterator) -> std::result::Result<(), StorageError> {
        Err(StorageError::Unsupported("chunks are written whole".into()))
    }

    fn erase(&self, key: &StoreKey) -> std::result::Result<(), StorageError> {
        match std::fs::remove_file(self.root.join(key.as_str())) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(StorageError::IOError(Arc::new(error))),
            _ => Ok(()),
        }
    }

    fn erase_prefix(&self, _: &StorePrefix) -> std::result::Result<(), StorageError> {
        Err(StorageError::Unsupported("arrays are removed by the store".into()))
    }

    fn supports_set_partial(&self) -> bool {
        false
    }
}

/// The refusal of the file system in an error of the storage, if it is one.
pub(crate) fn refusal(error: &StorageError) -> Option<&Error> {
    if let StorageError::IOError(cause) = error { Some(cause) } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_dead_processes_left_goes_and_what_others_write_stays() {
        let root = tempfile::tempdir().unwrap();
        let files = Files::new(root.path());
        files.put(&root.path().join("a/b"), b"bytes").unwrap();
        assert_eq!(std::fs::read(root.path().join("a/b")).unwrap(), b"bytes");
        let unnamed = root.path().join(UNNAMED);
        assert_eq!(std::fs::read_dir(&unnamed).unwrap().count(), 0);
        let mine = files.unnamed_for(&root.path().join("a"));
        let elsewhere = unnamed.join("another~1~0~0");
        // No process has this number: the largest is smaller on every system.
        let dead = unnamed.join(format!("{}~{}~0~0", node::machine(), u32::MAX));
        for path in [&mine, &elsewhere, &dead] {
            std::fs::write(path, b"").unwrap();
        }
        files.sweep();
        assert!(mine.exists() && elsewhere.exists());
        assert_eq!(dead.exists(), !cfg!(target_os = "linux"));
    }

    #[test]
    fn a_flipped_bit_or_a_lost_end_is_seen() {
        let mut bytes = b"strands".to_vec();
        bytes.extend(crc32c::crc32c(&bytes).to_le_bytes());
        assert!(ends_in_its_checksum(&bytes));
        for bit in 0..bytes.len() * 8 {
            let mut flipped = bytes.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert!(!ends_in_its_checksum(&flipped), "bit {bit}");
        }
        (0..bytes.len()).for_each(|len| assert!(!ends_in_its_checksum(&bytes[..len]), "{len} bytes"));
    }
}
