//! Reading at places that a file names: no place past its end, and not the same bytes over and over.

use std::io::{Read, Seek, SeekFrom};

/// How many times over a file's bytes may be read. Writers store equal samples once and refer to them from several places; a
/// file whose places refer to each other without end stops here.
const PASSES: u64 = 64;

/// A file of known length.
pub(crate) struct Placed<'a, R> {
    source: &'a mut R,
    len: u64,
    /// Bytes that may still be read.
    left: u64,
}

impl<'a, R: Read + Seek> Placed<'a, R> {
    pub fn new(source: &'a mut R) -> Result<Self, String> {
        let len = source.seek(SeekFrom::End(0)).map_err(|cause| cause.to_string())?;
        Ok(Self { source, len, left: len.saturating_mul(PASSES) })
    }

    /// Bytes of the file.
    pub fn len(&self) -> u64 {
        self.len
    }

    /// `count` bytes from `at` on.
    pub fn bytes(&mut self, at: u64, count: u64) -> Result<Vec<u8>, String> {
        if at.checked_add(count).is_none_or(|end| end > self.len) {
            return Err(format!("is damaged: byte {at} and {count} more lie past its end"));
        }
        self.left = self.left.checked_sub(count).ok_or("is damaged: its parts contain each other")?;
        self.source.seek(SeekFrom::Start(at)).map_err(|cause| cause.to_string())?;
        let mut bytes = vec![0; count as usize];
        self.source.read_exact(&mut bytes).map_err(|cause| cause.to_string())?;
        Ok(bytes)
    }

    pub fn u64(&mut self, at: u64) -> Result<u64, String> {
        let bytes = self.bytes(at, 8)?;
        Ok(bytes.first_chunk().map_or(0, |&first| u64::from_le_bytes(first)))
    }
}
