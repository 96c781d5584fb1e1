//! What can be wrong with a file: which file, where in it, what is the case, and what to do about it.

use std::{
    fmt,
    io::ErrorKind,
    path::{Path, PathBuf},
};

/// A place in the input; parts that do not apply are `None`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct At {
    /// Line of a text file, from 1.
    pub line: Option<usize>,
    /// Name of the view.
    pub view: Option<String>,
    /// Frame.
    pub frame: Option<usize>,
}

impl At {
    /// Nowhere in particular.
    pub const FILE: Self = Self { line: None, view: None, frame: None };

    /// A line, from 1.
    pub fn line(line: usize) -> Self {
        Self { line: Some(line), ..Self::FILE }
    }

    /// A view.
    pub fn view(view: &str) -> Self {
        Self { view: Some(view.to_owned()), ..Self::FILE }
    }

    /// A frame of a view.
    pub fn view_frame(view: &str, frame: usize) -> Self {
        Self { view: Some(view.to_owned()), frame: Some(frame), line: None }
    }
}

impl fmt::Display for At {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
        }
        if let Some(view) = &self.view {
            write!(f, ", view {view}")?;
        }
        if let Some(frame) = self.frame {
            write!(f, ", frame {frame}")?;
        }
        Ok(())
    }
}

/// Why a file could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum IoError {
    /// The operating system refused.
    #[error("{}: cannot {action}: {cause}", file.display())]
    System {
        /// The file.
        file: PathBuf,
        /// What was tried ("read", "write").
        action: &'static str,
        /// Why it failed.
        cause: std::io::Error,
    },
    /// The file is not what it claims to be, or holds something that cannot be.
    #[error("{}{at}: {fact}", file.display())]
    Content {
        /// The file.
        file: PathBuf,
        /// Where in it.
        at: Box<At>,
        /// What is the case.
        fact: String,
        /// What to do about it.
        hint: String,
    },
    /// A program that is needed is not installed.
    #[error("the program `{program}` was not found (needed to read {})", file.display())]
    Program {
        /// Its name.
        program: &'static str,
        /// The file that needs it.
        file: PathBuf,
    },
}

/// Whether the system lacked something of its own: no file handle (of the process, of the system) or no memory was left, or no
/// process could be started. That says nothing of the file that was asked for, and passes.
pub fn is_shortage(cause: &std::io::Error) -> bool {
    /// POSIX: ENFILE, EMFILE.
    const NO_HANDLE: [i32; 2] = [23, 24];
    let code = cfg!(unix).then(|| cause.raw_os_error()).flatten();
    matches!(cause.kind(), ErrorKind::OutOfMemory | ErrorKind::WouldBlock)
        || code.is_some_and(|code| NO_HANDLE.contains(&code))
}

impl IoError {
    /// Whether this says nothing of the file: [`is_shortage`].
    pub fn is_shortage(&self) -> bool {
        matches!(self, Self::System { cause, .. } if is_shortage(cause))
    }

    /// What to do about it.
    pub fn hint(&self) -> String {
        match self {
            Self::System { action, cause, .. } => match (cause.kind(), *action) {
                (ErrorKind::StorageFull | ErrorKind::QuotaExceeded, _) => "free some disk space and run again".into(),
                (ErrorKind::FileTooLarge, _) => {
                    "the file system or a limit (`ulimit -f`) allows no larger file: write elsewhere, or less".into()
                }
                _ if is_shortage(cause) => {
                    "raise the limits (`ulimit -n`, `ulimit -u`), or run with fewer threads".into()
                }
                (_, "write") => "give a path that you may write to, on a disk that is not full".into(),
                (ErrorKind::NotFound, _) => "check the path in the take's manifest".into(),
                (ErrorKind::PermissionDenied, _) => "give yourself the right to this file".into(),
                _ => "check the disk and run again".into(),
            },
            Self::Content { hint, .. } => hint.clone(),
            Self::Program { program, .. } => format!(
                "install {program} (Debian/Ubuntu: `apt install ffmpeg`, macOS: `brew install ffmpeg`, Windows: \
                 `winget install ffmpeg`) and put it on the PATH, or turn the videos into image folders elsewhere"
            ),
        }
    }

    /// The same error, with the view whose file it is.
    pub fn in_view(mut self, view: &str) -> Self {
        if let Self::Content { at, .. } = &mut self {
            at.view.get_or_insert_with(|| view.to_owned());
        }
        self
    }

    /// The same error of a file that was made below the folder `from` and should have been below `to`.
    pub fn moved(mut self, from: &Path, to: &Path) -> Self {
        let (Self::System { file, .. } | Self::Content { file, .. } | Self::Program { file, .. }) = &mut self;
        if let Ok(below) = file.strip_prefix(from) {
            *file = to.join(below);
        }
        self
    }

    /// File, line, view and frame.
    pub fn place(&self) -> String {
        match self {
            Self::Content { file, at, .. } => format!("{}{at}", file.display()),
            _ => self.file().display().to_string(),
        }
    }

    /// What is the case, without the place.
    pub fn fact(&self) -> String {
        match self {
            Self::Content { fact, .. } => fact.clone(),
            Self::System { action, cause, .. } => format!("cannot {action}: {cause}"),
            Self::Program { program, .. } => format!("the program `{program}`, which reads it, was not found"),
        }
    }

    /// Something wrong with what a file holds.
    pub fn content(file: &Path, at: At, fact: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Content { file: file.to_owned(), at: Box::new(at), fact: fact.into(), hint: hint.into() }
    }

    pub(crate) fn reading(file: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        |cause| Self::System { file: file.to_owned(), action: "read", cause }
    }

    pub(crate) fn writing(file: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        |cause| Self::System { file: file.to_owned(), action: "write", cause }
    }

    /// The file that is at fault.
    pub fn file(&self) -> &Path {
        match self {
            Self::System { file, .. } | Self::Content { file, .. } | Self::Program { file, .. } => file,
        }
    }
}

/// The text of a file; an error names the file.
pub(crate) fn read_text(file: &Path) -> Result<String, IoError> {
    let bytes = std::fs::read(file).map_err(IoError::reading(file))?;
    String::from_utf8(bytes)
        .map_err(|_| IoError::content(file, At::FILE, "is not a text file (UTF-8)", "check that it is the right file"))
}

/// What is wrong with a file of JSON, with the line. Some programs write `NaN` and `Infinity`, which JSON has not: they are
/// named, since "expected value" leaves the user searching.
pub(crate) fn not_json(file: &Path, text: &str, cause: &serde_json::Error, what: &str, hint: &str) -> IoError {
    let line = text.lines().nth(cause.line().saturating_sub(1)).unwrap_or_default();
    let token = ["NaN", "Infinity"].into_iter().find(|token| line.contains(token));
    match token.filter(|_| cause.is_syntax()) {
        Some(token) => {
            let fact = format!("holds the non-finite number {token}");
            IoError::content(file, At::line(cause.line()), fact, "correct the number, or leave the entry out")
        }
        None => IoError::content(file, At::line(cause.line()), format!("is not {what}: {cause}"), hint),
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::io::Error;

    use super::is_shortage;

    #[test]
    fn what_the_system_lacks_is_told_from_what_a_file_lacks() {
        // ENOMEM, ENFILE, EMFILE; ENOENT, EIO, EACCES, ENOSPC.
        assert!([12, 23, 24].map(Error::from_raw_os_error).iter().all(is_shortage));
        assert!(![2, 5, 13, 28].map(Error::from_raw_os_error).iter().any(is_shortage));
    }
}
