//! Data on stdout.

use std::io::{ErrorKind, Result, Write};

/// Writes text. A reader that has gone (`| head`) is no failure: it has what it wanted.
pub fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        done => done,
    }
}
