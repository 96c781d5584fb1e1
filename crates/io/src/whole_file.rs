//! Whole files or none: written under another name, then renamed.

use std::{
    fs::File,
    io::{BufWriter, Write},
    path::Path,
};

use crate::{IoError, error::At};

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
    // A rename puts a file in the place of a device or a pipe, for every program.
    if std::fs::metadata(path).is_ok_and(|there| !there.is_file()) {
        return Err(IoError::content(path, At::FILE, "is there and no file", "give the name of a new file"));
    }
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

/// Why a folder of files could not be written; names files as they should have been, not where they were made.
pub trait FolderError: From<IoError> {
    /// The same error with places below `from` named as below `to`.
    fn moved(self, from: &Path, to: &Path) -> Self;
}

impl FolderError for IoError {
    fn moved(self, from: &Path, to: &Path) -> Self {
        self.moved(from, to)
    }
}

/// Makes a folder of files by a function that writes them into the folder it is given. All files appear under `folder` or
/// none does: they are made beside it and moved in at the end, over files of the same name.
///
/// # Errors
/// The function's own, naming the files under `folder`; or the folder cannot be written.
pub fn write_folder<E: FolderError>(folder: &Path, write: impl FnOnce(&Path) -> Result<(), E>) -> Result<(), E> {
    let name = folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let temporary = folder.with_file_name(format!(".{name}.tmp"));
    let make = || {
        // What a killed program left.
        if temporary.exists() {
            std::fs::remove_dir_all(&temporary)?;
        }
        std::fs::create_dir_all(&temporary)
    };
    if folder.exists() && !folder.is_dir() {
        return Err(IoError::content(folder, At::FILE, "is a file, not a folder", "give the name of a folder").into());
    }
    let done = make().map_err(|cause| IoError::writing(folder)(cause).into()).and_then(|()| {
        write(&temporary).map_err(|error| error.moved(&temporary, folder))?;
        move_into(&temporary, folder).map_err(|cause| IoError::writing(folder)(cause).into())
    });
    if done.is_err() {
        // What cannot be removed was never made.
        let _ = std::fs::remove_dir_all(&temporary);
    }
    done
}

fn move_into(temporary: &Path, folder: &Path) -> std::io::Result<()> {
    if !folder.exists() {
        return std::fs::rename(temporary, folder);
    }
    for entry in std::fs::read_dir(temporary)? {
        let entry = entry?;
        std::fs::rename(entry.path(), folder.join(entry.file_name()))?;
    }
    std::fs::remove_dir(temporary)
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
    fn a_folder_that_fails_half_way_keeps_its_old_files_and_gets_no_new_ones() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("frames");
        write_folder::<IoError>(&folder, |to| write_bytes(&to.join("0"), b"old")).unwrap();
        let failed = write_folder::<IoError>(&folder, |to| {
            write_bytes(&to.join("0"), b"new")?;
            write_bytes(&to.join("1/none"), b"new")
        });
        let named = folder.join("1/none");
        assert!(failed.unwrap_err().to_string().starts_with(named.to_str().unwrap()), "the file as the user knows it");
        assert_eq!(std::fs::read(folder.join("0")).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        let file = folder.join("0");
        let told = write_folder::<IoError>(&file, |_| Ok(())).unwrap_err();
        assert!(told.to_string().contains("not a folder"), "{told}");
        write_folder::<IoError>(&folder, |to| write_bytes(&to.join("1"), b"new")).unwrap();
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 2);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_device_is_not_replaced() {
        let told = write_bytes(Path::new("/dev/full"), b"new").unwrap_err();
        assert!(told.to_string().contains("/dev/full: is there and no file"), "{told}");
        let folder = tempfile::tempdir().unwrap();
        assert!(write_bytes(folder.path(), b"new").unwrap_err().to_string().contains("no file"));
    }

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
