//! How a subcommand ends badly.

use std::path::Path;

use strandflow_engine::EngineError;
use strandflow_io::{FolderError, IoError};

/// What is printed, and whether the user's input is to blame (exit code 2) or not (1).
#[derive(Debug)]
pub struct Failed {
    /// After `error:`.
    pub error: String,
    /// After `hint:`; nothing where empty.
    pub hint: String,
    /// Exit code 2 rather than 1.
    pub input: bool,
}

impl Failed {
    /// Bad usage or bad input.
    pub fn input(error: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { error: error.into(), hint: hint.into(), input: true }
    }
}

impl From<EngineError> for Failed {
    fn from(error: EngineError) -> Self {
        Self { error: error.to_string(), hint: error.hint(), input: error.is_input() }
    }
}

impl From<IoError> for Failed {
    fn from(error: IoError) -> Self {
        let input = !matches!(error, IoError::System { .. });
        Self { error: error.to_string(), hint: error.hint(), input }
    }
}

impl FolderError for Failed {
    fn moved(mut self, from: &Path, to: &Path) -> Self {
        self.error = self.error.replace(&*from.to_string_lossy(), &to.to_string_lossy());
        self
    }
}

impl From<std::io::Error> for Failed {
    fn from(error: std::io::Error) -> Self {
        Self { error: error.to_string(), hint: String::new(), input: false }
    }
}
