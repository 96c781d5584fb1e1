//! Whole files or none.

use std::path::Path;

use crate::EngineError;

/// Writes a file by a temporary name and a rename, and makes the folders above it: readers see the old bytes or the new.
///
/// # Errors
/// `Disk`.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<(), EngineError> {
    let fail = |error: std::io::Error| EngineError::disk(path, error);
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(fail)?;
    }
    strandflow_io::write_bytes(path, bytes).map_err(|error| match error {
        strandflow_io::IoError::System { cause, .. } => EngineError::disk(path, cause),
        other => other.into(),
    })
}

/// Reads a text file.
///
/// # Errors
/// `Disk`.
pub fn read_text(path: &Path) -> Result<String, EngineError> {
    std::fs::read_to_string(path).map_err(|error| EngineError::disk(path, error))
}

/// Reads a file that may not exist.
///
/// # Errors
/// `Disk` where it is there and cannot be read.
pub fn read_if_there(path: &Path) -> Result<Option<Vec<u8>>, EngineError> {
    match std::fs::read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(EngineError::disk(path, error)),
    }
}

/// Removes a file that may not exist.
///
/// # Errors
/// `Disk`.
pub fn remove_file(path: &Path) -> Result<(), EngineError> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(EngineError::disk(path, error)),
        _ => Ok(()),
    }
}
