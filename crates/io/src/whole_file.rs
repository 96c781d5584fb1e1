//! Whole files or none: written under another name, then renamed.

use std::{
    fs::File,
    io::{BufWriter, Write},
    path::Path,
};

use crate::IoError;

/// Why a file could not be finished: what is written to, or what is written.
pub(crate) enum Unfinished {
    /// The file system refused.
    Disk(std::io::Error),
    /// What goes into the file could not be had.
    Content(IoError),
}

impl From<std::io::Error> for Unfinished {
    fn from(error: std::io::Error) -> Self {
        Self::Disk(error)
    }
}

impl From<IoError> for Unfinished {
    fn from(error: IoError) -> Self {
        Self::Content(error)
    }
}

/// Makes a file by a function that writes it. Under the final name stand the old bytes or the new, never a part: where the
/// function fails, or the program is killed, the file that was there before is still there.
pub(crate) fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<(), Unfinished>,
) -> Result<(), IoError> {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    // The name is fixed, so that what a killed program leaves is taken up by the one that writes the file again.
    let temporary = path.with_file_name(format!(".{name}.tmp"));
    let done = File::create(&temporary).map_err(Unfinished::Disk).and_then(|file| {
        let mut out = BufWriter::new(file);
        write(&mut out)?;
        out.flush()?;
        Ok(std::fs::rename(&temporary, path)?)
    });
    done.map_err(|why| {
        // What cannot be removed was never made.
        let _ = std::fs::remove_file(&temporary);
        match why {
            Unfinished::Disk(cause) => IoError::writing(path)(cause),
            Unfinished::Content(error) => error,
        }
    })
}

/// Writes bytes as a whole file or not at all.
///
/// # Errors
/// The file cannot be written.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), IoError> {
    write_whole(path, |out| Ok(out.write_all(bytes)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_fails_half_way_leaves_the_old_one_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        write_bytes(&path, b"old").unwrap();
        let failed = write_whole(&path, |out| {
            out.write_all(b"ne")?;
            Err(Unfinished::Disk(std::io::Error::other("the disk is full")))
        });
        assert!(failed.unwrap_err().to_string().contains("the disk is full"));
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }
}
