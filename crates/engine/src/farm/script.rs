//! What a task runs, as a shell reads it.

use std::path::Path;

use crate::{EngineError, Plan};

/// The command of all tasks of a run, but for the phase and the items.
#[derive(Clone, Debug)]
pub struct Work {
    /// This program.
    pub program: String,
    /// The take, from the root of the file system.
    pub take: String,
    /// Frames, mode, threads.
    pub more: Vec<String>,
}

impl Work {
    /// The work of a plan on a take, by so many threads a task.
    ///
    /// # Errors
    /// `Input` for a path that is not text; `Disk` where the take or this program cannot be found.
    pub fn new(take: &Path, plan: &Plan, threads: usize) -> Result<Self, EngineError> {
        let whole = |path: &Path| path.canonicalize().map_err(|error| EngineError::disk(path, error));
        let program = std::env::current_exe().map_err(|error| EngineError::disk(Path::new("strandflow"), error))?;
        let mode = format!("{:?}", plan.mode).to_lowercase();
        let frames = plan.frames.to_string();
        let more = ["--frames", &frames, "--mode", &mode, "--threads", &threads.to_string()].map(str::to_owned);
        Ok(Self { program: text(&whole(&program)?)?, take: text(&whole(take)?)?, more: more.to_vec() })
    }

    /// The words of the command that does some phases, all but the items.
    pub fn words(&self, phases: &[&str]) -> Vec<String> {
        let (from, to) = (phases.first().copied().unwrap_or_default(), phases.last().copied().unwrap_or_default());
        let words = [&self.program, "run", &self.take, "--from", from, "--to", to].map(str::to_owned);
        words.into_iter().chain(self.more.clone()).collect()
    }

    /// The same for a POSIX shell.
    pub fn in_shell(&self, phases: &[&str]) -> String {
        self.words(phases).iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ")
    }
}

fn text(path: &Path) -> Result<String, EngineError> {
    path.to_str().map(str::to_owned).ok_or_else(|| {
        let hint = "give take and program names of Unicode characters: schedulers take text";
        EngineError::input(path.display().to_string(), "the path is not text", hint)
    })
}

/// A word as a POSIX shell reads it back: between single quotes nothing has a meaning but their end.
pub fn quoted(word: &str) -> String {
    format!("'{}'", word.replace('\'', r"'\''"))
}

/// `stage/phase` as a part of file and job names.
pub fn name_of(phase: &str) -> String {
    phase.replace('/', ".")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_shell_reads_back_what_was_quoted() {
        for word in ["a b", "it's", "$HOME `id` \"x\" \\", "-n", "a\nb;touch c", "*?[x]{y}~!#&|<>()", ""] {
            let said = std::process::Command::new("sh").arg("-c").arg(format!("printf %s {}", quoted(word))).output();
            assert_eq!(String::from_utf8(said.unwrap().stdout).unwrap(), word);
        }
    }
}
