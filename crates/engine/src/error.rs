//! What can go wrong between the disk and a stage.

use std::path::{Path, PathBuf};

use strandflow_core::SourceError;
use strandflow_stages::StageError;

/// Why the engine cannot go on. Every variant says where; [`EngineError::hint`] says what to do.
#[derive(Clone, Debug, thiserror::Error)]
pub enum EngineError {
    /// What the user gave cannot lead to a result.
    #[error("{subject}: {fact}")]
    Input {
        /// The file, field, view or frame.
        subject: String,
        /// What is the case.
        fact: String,
        /// What to do about it.
        hint: String,
    },
    /// The file system refused.
    #[error("{}: {fact}", path.display())]
    Disk {
        /// The file or folder.
        path: PathBuf,
        /// What it said.
        fact: String,
    },
    /// The results store holds something else than the stage table says.
    #[error("results array `{array}`: {fact}")]
    Store {
        /// Path of the array within the store.
        array: String,
        /// What is the case.
        fact: String,
    },
    /// A result that is needed does not exist.
    #[error("`{item}` is not there")]
    Missing {
        /// Key of the work item.
        item: String,
    },
    /// A stage refused its input.
    #[error("{stage}: {error}")]
    Stage {
        /// The stage.
        stage: String,
        /// What it said; boxed, because results carry errors by value.
        error: Box<StageError>,
    },
}

impl EngineError {
    /// Bad input: the manifest, a file, a setting.
    pub fn input(subject: impl Into<String>, fact: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Input { subject: subject.into(), fact: fact.into(), hint: hint.into() }
    }

    /// The same of an input, with more about which one.
    pub fn about(mut self, more: &str) -> Self {
        if let Self::Input { subject, .. } = &mut self {
            *subject += &format!(", {more}");
        }
        self
    }

    /// A refusal of the file system.
    pub fn disk(path: &Path, error: impl std::fmt::Display) -> Self {
        Self::Disk { path: path.to_owned(), fact: error.to_string() }
    }

    /// A disagreement with the results store.
    pub fn store(array: &str, error: impl std::fmt::Display) -> Self {
        Self::Store { array: array.to_owned(), fact: error.to_string() }
    }

    /// What the user can do.
    pub fn hint(&self) -> String {
        match self {
            Self::Input { hint, .. } => hint.clone(),
            Self::Disk { .. } => {
                "check that the path exists, that you may write to it, and that the disk is not full".into()
            }
            Self::Store { .. } => "run again with `--verify`: what is damaged is made again; if that does not help, delete the folder results.zarr".into(),
            Self::Missing { .. } => "run the stages before it, or leave --from away".into(),
            Self::Stage { error, .. } => error.hint(),
        }
    }

    /// Whether the input is to blame (exit code 2) rather than the machine or the method (exit code 1).
    pub fn is_input(&self) -> bool {
        match self {
            Self::Input { .. } => true,
            Self::Stage { error, .. } => match &**error {
                StageError::Input { .. } => true,
                StageError::NonFinite { .. } => false,
                StageError::Source(error) => !error.is_shortage,
            },
            _ => false,
        }
    }
}

impl From<SourceError> for EngineError {
    fn from(error: SourceError) -> Self {
        if error.is_shortage {
            return Self::disk(Path::new(&error.file), error.fact);
        }
        Self::Input {
            subject: format!("view {}, frame {}", error.view, error.frame),
            fact: format!("{} ({})", error.fact, error.file),
            hint: error.hint,
        }
    }
}
