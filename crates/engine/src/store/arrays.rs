//! Arrays of the store: made to the catalogue's description, written chunk by chunk, read by range.

use std::{
    collections::BTreeMap,
    ops::Range,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
};

use strandflow_core::Finding;
use zarrs::{
    array::{
        Array, ArrayBuilder, ArrayError, ArrayMetadata, ArrayMetadataOptions, ArraySubset, BytesToBytesCodecTraits,
        CodecError, CodecOptions, DataType, ElementOwned, FillValue,
        codec::{BloscCodec, BloscCompressionLevel, BloscCompressor, BloscShuffleMode, Crc32cCodec},
        data_type,
    },
    group::{Group, GroupBuilder},
};

use super::{
    Record,
    catalogue::{self, DType},
    files::{Files, Sums, refusal, sum},
};
use crate::{EngineError, disk};

/// A number an array can hold.
pub trait Element: ElementOwned + zarrs::array::Element + bytemuck::Pod {
    /// The type's name in the catalogue.
    const DTYPE: DType;
}

macro_rules! elements {
    ($($type:ty => $dtype:ident),*) => { $(impl Element for $type { const DTYPE: DType = DType::$dtype; })* };
}
elements!(u8 => U8, u16 => U16, u32 => U32, f32 => F32, f64 => F64);

/// The folder `results.zarr` of a take.
#[derive(Clone)]
pub struct Store {
    root: PathBuf,
    files: Arc<Files>,
    groups: Arc<Mutex<()>>,
}

impl Store {
    /// Opens the store; makes it if it does not exist.
    ///
    /// # Errors
    /// `Disk` where the folder cannot be made.
    pub fn open(root: &Path) -> Result<Self, EngineError> {
        std::fs::create_dir_all(root).map_err(|e| EngineError::disk(root, e))?;
        Ok(Self { root: root.to_owned(), files: Arc::new(Files::new(root)), groups: Arc::default() })
    }

    /// From now on only finished items are read: a chunk that is not there is damage, not fill values.
    pub fn expect_complete(&self) {
        self.files.expect_complete();
    }

    /// Removes what killed processes left half written.
    pub fn sweep(&self) {
        self.files.sweep();
    }

    /// Writes a file of the store or beside it, and the folders above it: readers see the old bytes or the new, and of two
    /// processes the later wins.
    ///
    /// # Errors
    /// `Disk`.
    pub fn put(&self, path: &Path, bytes: &[u8]) -> Result<(), EngineError> {
        self.files.put(path, bytes).map_err(|error| EngineError::disk(path, error))
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Makes the array `path` with this shape and chunk shape, unless it is there already and the same. An array that
    /// differs in the number of frames only keeps its chunks. `more`: attributes beside the catalogue's.
    ///
    /// # Errors
    /// `Store` for a path that the catalogue does not know; `Disk`.
    pub fn ensure(
        &self,
        path: &str,
        shape: &[usize],
        chunk: &[usize],
        more: serde_json::Value,
    ) -> Result<(), EngineError> {
        if self.matches(path, shape, chunk, more.clone())? {
            return Ok(());
        }
        let metadata = self.describe(path, shape, chunk, more.clone())?;
        if self.must_remove(path, shape, chunk, more)? {
            self.remove(path)?;
        }
        self.ensure_groups(path)?;
        self.put(&self.root.join(path).join("zarr.json"), metadata.as_bytes())
    }

    /// Whether `ensure` would change nothing.
    ///
    /// # Errors
    /// `Store` for a path that the catalogue does not know; `Disk`.
    pub fn matches(
        &self,
        path: &str,
        shape: &[usize],
        chunk: &[usize],
        more: serde_json::Value,
    ) -> Result<bool, EngineError> {
        let present = disk::read_if_there(&self.root.join(path).join("zarr.json"))?;
        Ok(present
            .is_some_and(|present| self.describe(path, shape, chunk, more).is_ok_and(|m| m.as_bytes() == present)))
    }

    /// Whether `ensure` would have to throw chunks away. What cannot be read is not thrown away.
    ///
    /// # Errors
    /// As [`Store::matches`].
    pub fn must_remove(
        &self,
        path: &str,
        shape: &[usize],
        chunk: &[usize],
        more: serde_json::Value,
    ) -> Result<bool, EngineError> {
        let folder = self.root.join(path);
        if disk::read_if_there(&folder.join("zarr.json"))?.is_none() {
            // Without chunks it is about to be made by another process.
            return Ok(folder.join("c").exists());
        }
        let present = match self.shape(path) {
            Ok(present) => present,
            Err(error @ EngineError::Disk { .. }) => return Err(error),
            Err(_) => return Ok(true),
        };
        let mut same_frames = shape.to_vec();
        if let (Some(first), Some(frames)) = (same_frames.first_mut(), present.first()) {
            *first = *frames;
        }
        Ok(!(chunk.first() == Some(&1) && self.matches(path, &same_frames, chunk, more)?))
    }

    /// Removes an array or a group with all that is in it, at once: another process sees all of it or nothing.
    ///
    /// # Errors
    /// `Disk`.
    pub fn remove(&self, path: &str) -> Result<(), EngineError> {
        let folder = self.root.join(path);
        self.files.remove_folder(&folder).map_err(|error| EngineError::disk(&folder, error))
    }

    /// Samples of an array; `range` has one entry a dimension.
    ///
    /// # Errors
    /// `Store` where the array does not exist, holds another type, or the range lies outside.
    pub fn read<T: Element>(&self, path: &str, range: &[Range<usize>]) -> Result<Vec<T>, EngineError> {
        let array = self.array(path)?;
        let shape = array.shape();
        if range.len() != shape.len() || range.iter().zip(shape).any(|(r, s)| r.end > *s as usize) {
            return Err(EngineError::store(path, format!("range {range:?} lies outside shape {shape:?}")));
        }
        let range: Vec<Range<u64>> = range.iter().map(|r| r.start as u64..r.end as u64).collect();
        let subset = ArraySubset::new_with_ranges(&range);
        array.retrieve_array_subset_opt(&subset, &options()).map_err(|error| self.error_of(path, error))
    }

    /// All samples of an array.
    ///
    /// # Errors
    /// As [`Store::read`].
    pub fn read_all<T: Element>(&self, path: &str) -> Result<Vec<T>, EngineError> {
        let range: Vec<_> = self.shape(path)?.into_iter().map(|n| 0..n).collect();
        self.read(path, &range)
    }

    /// Shape of an array.
    ///
    /// # Errors
    /// `Store` where it does not exist.
    pub fn shape(&self, path: &str) -> Result<Vec<usize>, EngineError> {
        Ok(self.array(path)?.shape().iter().map(|n| *n as usize).collect())
    }

    pub(crate) fn array(&self, path: &str) -> Result<Array<Files>, EngineError> {
        let file = self.root.join(path).join("zarr.json");
        let text = std::fs::read_to_string(&file).map_err(|error| match error.kind() {
            std::io::ErrorKind::NotFound => EngineError::store(path, "is not there"),
            _ => EngineError::disk(&file, error),
        })?;
        let metadata: ArrayMetadata = serde_json::from_str(&text).map_err(|e| EngineError::store(path, e))?;
        // Arrays of earlier versions have no checksums.
        let files = if text.contains("\"crc32c\"") { Arc::new(self.files.checked()) } else { self.files.clone() };
        Array::new_with_metadata(files, &format!("/{path}"), metadata).map_err(|e| EngineError::store(path, e))
    }

    /// A full disk or a lack of file handles is no fault of the array.
    fn error_of(&self, path: &str, error: ArrayError) -> EngineError {
        match &error {
            ArrayError::StorageError(cause) | ArrayError::CodecError(CodecError::StorageError(cause)) => {
                match refusal(cause) {
                    Some(cause) => EngineError::disk(&self.root.join(path), cause),
                    None => EngineError::store(path, cause),
                }
            }
            _ => EngineError::store(path, error),
        }
    }

    fn describe(
        &self,
        path: &str,
        shape: &[usize],
        chunk: &[usize],
        more: serde_json::Value,
    ) -> Result<String, EngineError> {
        let spec = catalogue::spec_of(path).ok_or_else(|| EngineError::store(path, "is not in the catalogue"))?;
        let (dtype, fill): (DataType, FillValue) = match spec.dtype {
            DType::U8 => (data_type::uint8(), 0u8.into()),
            DType::U16 => (data_type::uint16(), 0u16.into()),
            DType::U32 => (data_type::uint32(), 0u32.into()),
            DType::F32 => (data_type::float32(), f32::NAN.into()),
            DType::F64 => (data_type::float64(), f64::NAN.into()),
        };
        let mut attributes = serde_json::Map::new();
        attributes.insert("description".into(), spec.meaning.into());
        attributes.insert("units".into(), spec.units.into());
        if let serde_json::Value::Object(more) = more {
            attributes.extend(more);
        }
        let wide = |n: &[usize]| n.iter().map(|n| *n as u64).collect::<Vec<_>>();
        let chunk: Vec<u64> = wide(chunk).into_iter().map(|n| n.max(1)).collect();
        let level = BloscCompressionLevel::try_from(5u8).map_err(|e| EngineError::store(path, format!("{e:?}")))?;
        let blosc =
            BloscCodec::new(BloscCompressor::LZ4, level, None, BloscShuffleMode::Shuffle, Some(spec.dtype.bytes()))
                .map_err(|e| EngineError::store(path, e))?;
        let array = ArrayBuilder::new(wide(shape), chunk, dtype, fill)
            .bytes_to_bytes_codecs(vec![
                Arc::new(blosc) as Arc<dyn BytesToBytesCodecTraits>,
                Arc::new(Crc32cCodec::new()),
            ])
            .dimension_names(Some(spec.dims.iter().copied()))
            .attributes(attributes)
            .build(self.files.clone(), &format!("/{path}"))
            .map_err(|e| EngineError::store(path, e))?;
        let metadata = array.metadata_opt(&ArrayMetadataOptions::default().with_include_zarrs_metadata(false));
        Ok(metadata.to_string_pretty())
    }

    /// Metadata of the groups above an array, so that foreign readers can walk the tree.
    fn ensure_groups(&self, path: &str) -> Result<(), EngineError> {
        let _one_at_a_time = self.groups.lock().unwrap_or_else(PoisonError::into_inner);
        let mut above = vec![String::new()];
        let parts: Vec<&str> = path.split('/').collect();
        above.extend((1..parts.len()).map(|n| parts[..n].join("/")));
        for group in above {
            let file = self.root.join(&group).join("zarr.json");
            if !file.exists() {
                let built: Group<Files> = GroupBuilder::new()
                    .build(self.files.clone(), &format!("/{group}"))
                    .map_err(|e| EngineError::store(&group, e))?;
                self.put(&file, built.metadata().to_string_pretty().as_bytes())?;
            }
        }
        Ok(())
    }
}

/// Writes the arrays of one work item and hashes what it writes.
pub struct Writer {
    store: Store,
    sums: Arc<Mutex<Sums>>,
    hashes: BTreeMap<String, blake3::Hasher>,
}

impl Writer {
    /// A writer for one item.
    pub fn new(store: &Store) -> Self {
        let sums = Arc::<Mutex<Sums>>::default();
        let files = Arc::new(store.files.noting(sums.clone()));
        Self { store: Store { files, ..store.clone() }, sums, hashes: BTreeMap::new() }
    }

    /// The store.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// Writes one whole chunk of an array (at the array's border: padded to the chunk's shape).
    ///
    /// # Errors
    /// `Store` where the array does not exist, holds another type, or the length is not the chunk's; `Disk`.
    pub fn chunk<T: Element>(&mut self, path: &str, chunk: &[usize], data: &[T]) -> Result<(), EngineError> {
        let array = self.store.array(path)?;
        let at: Vec<u64> = chunk.iter().map(|i| *i as u64).collect();
        array.store_chunk_opt(&at, data, &options()).map_err(|error| self.store.error_of(path, error))?;
        let hasher = self.hashes.entry(path.to_owned()).or_default();
        hasher.update(format!("{chunk:?}{}", data.len()).as_bytes());
        hasher.update(bytemuck::cast_slice(data));
        Ok(())
    }

    /// Makes an array of one chunk and writes it: for results whose size is only known with them. Nothing is removed first, since
    /// another process may be making the same.
    ///
    /// # Errors
    /// As [`Writer::chunk`].
    pub fn whole<T: Element>(&mut self, path: &str, shape: &[usize], data: &[T]) -> Result<(), EngineError> {
        self.describe(path, shape)?;
        if data.is_empty() {
            // A chunk that is there is of another size.
            self.store.remove(&format!("{path}/c"))?;
            self.hashes.entry(path.to_owned()).or_default().update(b"empty");
            return Ok(());
        }
        self.hashes.entry(path.to_owned()).or_default().update(format!("{shape:?}").as_bytes());
        self.chunk(path, &vec![0; shape.len()], data)
    }

    /// Writes the description of an array of one chunk, and notes it.
    fn describe(&self, path: &str, shape: &[usize]) -> Result<(), EngineError> {
        let (store, file) = (&self.store, format!("{path}/zarr.json"));
        let metadata = store.describe(path, shape, shape, serde_json::Value::Null)?;
        if !store.matches(path, shape, shape, serde_json::Value::Null)? {
            store.ensure_groups(path)?;
            store.put(&store.root.join(&file), metadata.as_bytes())?;
        }
        self.sums.lock().unwrap_or_else(PoisonError::into_inner).insert(file, sum(metadata.as_bytes()));
        Ok(())
    }

    /// Declares the item finished: hashes of its files, then its record.
    ///
    /// # Errors
    /// `Disk`.
    pub fn finish(
        self,
        item: &str,
        inputs: BTreeMap<String, String>,
        findings: Vec<Finding>,
    ) -> Result<Record, EngineError> {
        let hash = |hasher: blake3::Hasher| hasher.finalize().to_hex()[..32].to_owned();
        let outputs = self.hashes.into_iter().map(|(path, hasher)| (path, hash(hasher))).collect();
        let record = Record { inputs, outputs, findings };
        self.store.write_sums(item, &self.sums.lock().unwrap_or_else(PoisonError::into_inner))?;
        self.store.write_record(item, &record)?;
        Ok(record)
    }
}

/// One thread a chunk: items run in parallel already, and the bytes must not depend on the machine. Chunks of nothing but fill
/// values are written too, so that one that is lost is not taken for one.
fn options() -> CodecOptions {
    CodecOptions::default().with_concurrent_target(1).with_store_empty_chunks(true)
}
