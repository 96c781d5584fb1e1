//! What was refused goes to the terminal and to the take's log.

use std::{
    fs::OpenOptions,
    io::Write,
    path::PathBuf,
    sync::atomic::{AtomicUsize, Ordering},
    time::{SystemTime, UNIX_EPOCH},
};

/// Refusals that are told: whoever keeps trying cannot fill the disk.
const MOST: usize = 1000;

/// Tells of refusals.
pub struct Refusals {
    log: PathBuf,
    told: AtomicUsize,
}

impl Refusals {
    /// Into a log of lines of JSON.
    pub fn into_log(log: PathBuf) -> Self {
        Self { log, told: AtomicUsize::new(0) }
    }

    /// One request that was refused.
    pub fn tell(&self, request: &str, status: u16, why: &str) {
        match self.told.fetch_add(1, Ordering::Relaxed) {
            MOST => eprintln!("refused: more than {MOST} requests; further ones are not told"),
            told if told < MOST => {
                // What others sent must not steer the terminal.
                let (request, why) = (request.escape_debug(), why.escape_debug());
                eprintln!("refused: {request}: {status} {why}");
                let unix_secs = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64());
                let line = serde_json::json!({
                    "event": "request_refused", "request": request.to_string(), "status": status, "why": why.to_string(),
                    "unix_secs": unix_secs,
                });
                // A log that cannot be written must not stop the work.
                let _ = OpenOptions::new()
                    .create(true)
                    .append(true)
                    .open(&self.log)
                    .and_then(|mut f| writeln!(f, "{line}"));
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_is_cut_off() {
        let dir = tempfile::tempdir().unwrap();
        let refusals = Refusals::into_log(dir.path().join("run.log"));
        (0..MOST + 5).for_each(|i| refusals.tell("PUT /api/labels", 400, &format!("wrong\n{i}")));
        let log = std::fs::read_to_string(dir.path().join("run.log")).unwrap();
        assert_eq!(log.lines().count(), MOST);
        let first: serde_json::Value = serde_json::from_str(log.lines().next().unwrap()).unwrap();
        assert_eq!((&first["status"], &first["why"]), (&400.into(), &"wrong\\n0".into()));
    }
}
