//! Ogawa, the container of Alembic: groups of children, each child a group or bytes, children before parents.
//!
//! Header 16 bytes: `Ogawa`, 0xff once complete, version 0 1, position of the root group. A group is the number of its
//! children and their positions, the top bit marking bytes; bytes are their length and themselves.

use std::{
    fs::File,
    io::{BufWriter, Result, Seek, SeekFrom, Write},
};

/// Where a child lies; 0 is an empty group.
#[derive(Clone, Copy, Debug)]
pub(super) struct Child(u64);

const DATA: u64 = 1 << 63;

impl Child {
    /// A group without children.
    pub const EMPTY_GROUP: Self = Self(0);
    /// No bytes.
    pub const EMPTY_DATA: Self = Self(DATA);
}

/// Bytes with the key by which readers tell equal samples: 16 bytes of a hash.
pub(super) struct Keyed {
    pub child: Child,
    pub key: [u8; 16],
}

/// A file being written.
pub(super) struct Ogawa<'a> {
    out: &'a mut BufWriter<File>,
    at: u64,
}

impl<'a> Ogawa<'a> {
    pub fn begin(out: &'a mut BufWriter<File>) -> Result<Self> {
        let mut file = Self { out, at: 0 };
        file.put(b"Ogawa\0\0\x01\0\0\0\0\0\0\0\0")?;
        Ok(file)
    }

    pub fn data(&mut self, bytes: &[u8]) -> Result<Child> {
        if bytes.is_empty() {
            return Ok(Child::EMPTY_DATA);
        }
        let start = self.at;
        self.put(&(bytes.len() as u64).to_le_bytes())?;
        self.put(bytes)?;
        Ok(Child(start | DATA))
    }

    /// A sample of a property: its key and its bytes.
    pub fn sample(&mut self, bytes: &[u8]) -> Result<Keyed> {
        let key = key(bytes);
        let start = self.at;
        self.put(&(bytes.len() as u64 + 16).to_le_bytes())?;
        self.put(&key)?;
        self.put(bytes)?;
        Ok(Keyed { child: Child(start | DATA), key })
    }

    pub fn group(&mut self, children: &[Child]) -> Result<Child> {
        if children.is_empty() {
            return Ok(Child::EMPTY_GROUP);
        }
        let start = self.at;
        self.put(&(children.len() as u64).to_le_bytes())?;
        children.iter().try_for_each(|child| self.put(&child.0.to_le_bytes()))?;
        Ok(Child(start))
    }

    /// Names the root group and marks the file complete.
    pub fn finish(self, root: Child) -> Result<()> {
        self.out.seek(SeekFrom::Start(8))?;
        self.out.write_all(&root.0.to_le_bytes())?;
        self.out.seek(SeekFrom::Start(5))?;
        self.out.write_all(&[0xff])?;
        self.out.flush()
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.at += bytes.len() as u64;
        self.out.write_all(bytes)
    }
}

/// Readers compare keys and never compute them: any hash will do that hardly ever repeats.
pub(super) fn key(bytes: &[u8]) -> [u8; 16] {
    let mut key = [0; 16];
    key.copy_from_slice(&blake3::hash(bytes).as_bytes()[..16]);
    key
}
