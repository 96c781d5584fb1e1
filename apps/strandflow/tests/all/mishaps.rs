//! Whatever befalls a run: `status` tells the truth after it, the next run completes, the bytes are those of an undisturbed one,
//! and what was made again is what was hit. `cargo xtask faults` prints the table; docs/faults.md has it.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

use std::{
    collections::BTreeSet,
    io::Write,
    path::{Path, PathBuf},
    process::{Command, Output, Stdio},
    time::{Duration, Instant},
};

use serde_json::Value;

use crate::common::{assert_same, bytes_below, stderr, strandflow, synthetic, text};

/// A capture, a take of it that was run undisturbed, and how long that took.
struct Undisturbed {
    /// Removed at the end.
    _root: tempfile::TempDir,
    capture: PathBuf,
    take: PathBuf,
    lasted: Duration,
    items: usize,
}

impl Undisturbed {
    fn make() -> Self {
        let root = tempfile::tempdir().unwrap();
        let capture = root.path().join("capture");
        synthetic::capture(&capture);
        let take = synthetic::take_of(&capture, "undisturbed", &[]);
        let start = Instant::now();
        let run = run(&take, &[]);
        assert!(run.status.success(), "{}", stderr(&run));
        let items = done(&run).len();
        Self { _root: root, capture, take, lasted: start.elapsed(), items }
    }

    /// A take that was never run.
    fn take(&self, name: &str) -> PathBuf {
        synthetic::take_of(&self.capture, name, &[])
    }

    /// A take with all results.
    fn finished(&self, name: &str) -> PathBuf {
        let take = self.take(name);
        for (file, bytes) in bytes_below(&self.take) {
            let to = take.join(file);
            std::fs::create_dir_all(to.parent().unwrap()).unwrap();
            std::fs::write(to, bytes).unwrap();
        }
        take
    }

    /// Completes a take; asserts the bytes, and returns the items made. `known`: those that were finished before, none of
    /// which is made again but those of `hit`.
    fn complete(
        &self,
        take: &Path,
        known: &BTreeSet<String>,
        hit: &BTreeSet<String>,
        more: &[&str],
    ) -> BTreeSet<String> {
        let run = run(take, more);
        assert!(run.status.success(), "{}", stderr(&run));
        let made = done(&run);
        let again: BTreeSet<_> = made.intersection(known).cloned().collect();
        assert!(again.is_subset(hit), "made again without need: {:?}", again.difference(hit));
        assert_same(&self.take, take);
        assert_all_done(take);
        made
    }

    /// All items of the take.
    fn all(&self) -> BTreeSet<String> {
        finished(&self.take)
    }
}

/// A run of two threads; `more`: further arguments.
fn run(take: &Path, more: &[&str]) -> Output {
    strandflow(&[&["run", text(take), "--threads", "2", "--json"], more].concat())
}

/// Keys of the items that a run made.
fn done(output: &Output) -> BTreeSet<String> {
    let lines = String::from_utf8_lossy(&output.stdout).into_owned();
    let events = lines.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let done = events.filter(|event| event["event"] == "item" && event["outcome"] == "done");
    done.map(|event| event["item"].as_str().unwrap().to_owned()).collect()
}

/// Keys of the items that have records.
fn finished(take: &Path) -> BTreeSet<String> {
    let files = bytes_below(&take.join("results.zarr")).into_keys();
    let key = |file: PathBuf| {
        let file = file.strip_prefix(".items").ok()?.to_str()?.to_owned();
        file.strip_suffix(".json").map(str::to_owned)
    };
    files.filter_map(key).collect()
}

/// The phases as `status` tells them, having read all results.
fn status(take: &Path) -> Vec<Value> {
    let status = strandflow(&["status", text(take), "--json", "--verify"]);
    assert!(status.status.success(), "{}", stderr(&status));
    serde_json::from_slice(&status.stdout).unwrap()
}

fn assert_all_done(take: &Path) {
    assert!(status(take).iter().all(|phase| phase["done"] == phase["items"] && phase["failed"] == 0));
}

/// Asserts that what is said to be done is what has a record, and that its files are whole; returns it.
fn assert_true_status(take: &Path) -> BTreeSet<String> {
    let finished = finished(take);
    for phase in status(take) {
        let name = phase["phase"].as_str().unwrap();
        let of_phase = finished.iter().filter(|key| key.starts_with(&format!("{name}/"))).count();
        let told = phase["done"].as_u64().unwrap() + phase["stale"].as_u64().unwrap();
        assert!(phase["items"] == 0 || told == of_phase as u64, "{phase}");
        assert!(!phase["reasons"].to_string().contains("damaged"), "{phase}");
    }
    finished
}

/// One line of the table, for whoever asks for it by `STRANDFLOW_FAULTS`.
pub fn tell(fault: &str, times: usize, made_again: usize, told: &str) {
    let Some(file) = std::env::var_os("STRANDFLOW_FAULTS") else { return };
    let mut file = std::fs::OpenOptions::new().create(true).append(true).open(file).unwrap();
    writeln!(file, "| {fault} | {times} | 0 | {made_again} | {told} |").unwrap();
}

/// Numbers that look random, the same in every run.
pub struct Dice(pub u64);

impl Dice {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    pub fn below(&mut self, end: usize) -> usize {
        (self.next() % end as u64) as usize
    }

    pub fn share(&mut self) -> f64 {
        (self.next() % 10_000) as f64 / 10_000.0
    }
}

/// How many kills are asked for.
pub fn kills() -> usize {
    std::env::var("STRANDFLOW_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(8)
}

/// Kills, each at a random moment of what is left of a run.
#[test]
fn a_kill_at_any_moment_costs_only_what_was_in_work() {
    let kills = kills();
    let whole = Undisturbed::make();
    let mut dice = Dice(0x5eed_cafe);
    let (mut take, mut takes, mut known, mut killed, mut phases) =
        (whole.take("kill0"), 1, BTreeSet::new(), 0, BTreeSet::new());
    while killed < kills {
        let left = 1.0 - known.len() as f64 / whole.items as f64;
        let args = ["run", text(&take), "--threads", if killed % 2 == 0 { "2" } else { "1" }, "--json"];
        let mut child =
            Command::new(env!("CARGO_BIN_EXE_strandflow")).args(args).stdout(Stdio::piped()).spawn().unwrap();
        std::thread::sleep(whole.lasted.mul_f64((dice.share() * left).max(0.01)));
        let ended = child.try_wait().unwrap().is_some();
        child.kill().unwrap();
        let made = done(&child.wait_with_output().unwrap());
        assert!(made.is_disjoint(&known), "made again: {:?}", made.intersection(&known));
        let now = assert_true_status(&take);
        assert!(known.is_subset(&now) && made.is_subset(&now), "lost: {:?}", made.difference(&now));
        phases.extend(now.difference(&known).map(|key| key.split('/').next().unwrap().to_owned()));
        known = now;
        killed += usize::from(!ended);
        if ended || left < 0.1 {
            whole.complete(&take, &known, &BTreeSet::new(), &[]);
            (take, takes, known) = (whole.take(&format!("kill{takes}")), takes + 1, BTreeSet::new());
        }
    }
    whole.complete(&take, &known, &BTreeSet::new(), &[]);
    tell(
        "process killed at a random moment",
        kills,
        0,
        &format!("{takes} takes, work in {} stages between", phases.len()),
    );
}

type Act = fn(&Path, &mut Dice);

/// Chunks of all kinds are cut short, altered by one bit, or removed: seen, told, and only these are made again.
#[test]
fn damaged_chunks_are_seen_and_only_they_are_made_again() {
    let whole = Undisturbed::make();
    let all = whole.all();
    let mut dice = Dice(0xbad_c0de);
    let take = whole.finished("damaged");
    let files = chunks(&take);
    let kinds: [(&str, Act); 3] =
        [("chunk cut short", cut), ("one bit flipped in a chunk", flip), ("chunk removed", remove)];
    for (fault, act) in kinds {
        let mut hit = BTreeSet::new();
        for _ in 0..5 {
            let (file, owner) = &files[dice.below(files.len())];
            if hit.insert(owner.clone()) {
                act(file, &mut dice);
            }
        }
        let told: u64 = status(&take).iter().flat_map(damaged_in).sum();
        assert_eq!(told, hit.len() as u64, "{fault}: status tells of what was hit");
        let made = whole.complete(&take, &all, &hit, &["--verify"]);
        assert_eq!(made, hit, "{fault}");
        tell(fault, hit.len(), made.len(), "`status --verify` names them, `run --verify` makes them again");
    }

    // Nobody asked for a look at all results: a stage that reads a damaged one sees it, and it is made again.
    let read = [
        ("fit/fit/block0001", "fit/points"),
        ("hull/hull/000002", "hull/occupancy"),
        ("pose/pose/take", "world_from_head"),
    ];
    let hit: BTreeSet<String> = read.iter().map(|(key, _)| (*key).to_owned()).collect();
    let mut lost = hit.clone();
    for (key, array) in read {
        let of_array = |(file, owner): &&(PathBuf, String)| owner == key && text(file).contains(array);
        flip(&files.iter().find(of_array).unwrap().0, &mut dice);
    }
    for key in
        all.iter().filter(|key| key.starts_with("flow/") || key.starts_with("blend/") || key.starts_with("lift/"))
    {
        std::fs::remove_file(take.join(format!("results.zarr/.items/{key}.json"))).unwrap();
        lost.insert(key.clone());
    }
    let made = whole.complete(&take, &all, &lost, &[]);
    assert_eq!(made, lost);
    let log = std::fs::read_to_string(take.join("run.log")).unwrap();
    assert!(log.contains("is not as it was written") && log.contains("made again"));
    tell(
        "bit flipped in what later items read",
        hit.len(),
        hit.len(),
        "seen by its checksum when read, made again in the same run",
    );
}

/// Chunk files with the items that wrote them.
fn chunks(take: &Path) -> Vec<(PathBuf, String)> {
    let results = take.join("results.zarr");
    let mut found = Vec::new();
    for key in finished(take) {
        let sums = std::fs::read_to_string(results.join(format!(".items/{key}.sums"))).unwrap();
        let files = sums.lines().map(|line| line.split_once(' ').unwrap().1).filter(|file| file.contains("/c"));
        found.extend(files.map(|file| (results.join(file), key.clone())));
    }
    assert!(found.len() > 200);
    found
}

fn cut(file: &Path, dice: &mut Dice) {
    let bytes = std::fs::read(file).unwrap();
    std::fs::write(file, &bytes[..dice.below(bytes.len())]).unwrap();
}

fn flip(file: &Path, dice: &mut Dice) {
    let mut bytes = std::fs::read(file).unwrap();
    let bit = dice.below(bytes.len() * 8);
    bytes[bit / 8] ^= 1 << (bit % 8);
    std::fs::write(file, bytes).unwrap();
}

fn remove(file: &Path, _: &mut Dice) {
    std::fs::remove_file(file).unwrap();
}

/// How many items of a phase are told to be damaged.
fn damaged_in(phase: &Value) -> Vec<u64> {
    let reasons = phase["reasons"].as_object().unwrap();
    reasons
        .iter()
        .filter(|(reason, _)| reason.starts_with("damaged: "))
        .map(|(_, count)| count.as_u64().unwrap())
        .collect()
}

/// Records and the arrays' own files are cut short.
#[test]
fn broken_records_cost_their_items() {
    let whole = Undisturbed::make();
    let take = whole.finished("records");
    let all = whole.all();
    let hit: BTreeSet<String> =
        ["masks/masks/view01/000002", "smooth/frames/000001", "fit/fit/block0000"].map(str::to_owned).into();
    for key in &hit {
        cut(&take.join(format!("results.zarr/.items/{key}.json")), &mut Dice(7));
    }
    let made = whole.complete(&take, &all, &hit, &[]);
    tell("record cut short", hit.len(), made.len(), "counts as none");

    let before = finished(&take);
    cut(&take.join("results.zarr/prune/points/zarr.json"), &mut Dice(5));
    let of_array: BTreeSet<String> = before.iter().filter(|key| key.starts_with("prune/")).cloned().collect();
    let made = whole.complete(&take, &all, &of_array, &[]);
    tell("description of an array cut short", 1, made.len(), "the chunks of that array's phase are made again");
}

/// Settings and a mask are changed between runs that are killed, and changed back.
#[test]
fn changes_between_runs_and_back_end_with_the_same_bytes() {
    let whole = Undisturbed::make();
    let take = whole.finished("changed");
    let manifest = take.join("strandflow.toml");
    let text_before = std::fs::read_to_string(&manifest).unwrap();
    std::fs::write(
        &manifest,
        text_before.replace("root_count = 600", "root_count = 1100") + "[settings.grow]\nfollow = 0.0\n",
    )
    .unwrap();
    assert!(status(&take).iter().any(|phase| phase["stale"].as_u64() > Some(0)));
    let other = run(&take, &["--to", "smooth"]);
    assert!(other.status.success(), "{}", stderr(&other));
    let mask = whole.capture.join("user/hair_masks/cam01/000002.png");
    std::fs::copy(whole.capture.join("user/hair_masks/cam01/000000.png"), &mask).unwrap();
    assert!(run(&take, &["--to", "orient"]).status.success());
    std::fs::remove_file(mask).unwrap();
    std::fs::write(&manifest, text_before).unwrap();
    let made = whole.complete(&take, &BTreeSet::new(), &BTreeSet::new(), &[]);
    tell("settings and a mask changed, and back", 1, made.len(), "what rests on them");
}

/// Two runs of one take at once, both from the start.
#[test]
fn two_runs_of_one_take_do_not_disturb_one_another() {
    let whole = Undisturbed::make();
    for round in 0..2 {
        let take = whole.take(&format!("two{round}"));
        let runs = [2, 1].map(|threads| {
            let args = ["run", text(&take), "--threads", &format!("{threads}")].map(str::to_owned);
            Command::new(env!("CARGO_BIN_EXE_strandflow")).args(args).stderr(Stdio::null()).spawn().unwrap()
        });
        let codes = runs.map(|mut run| run.wait().unwrap().code());
        assert!(codes.iter().all(|code| code.is_some_and(|code| code <= 2)), "{codes:?}");
        let known = assert_true_status(&take);
        whole.complete(&take, &known, &BTreeSet::new(), &[]);
    }
    tell(
        "two processes on one take",
        2,
        0,
        "either may find that something is missing that the other is making; the next run completes",
    );
}

/// A shell's limits: too few file handles, too little memory.
#[cfg(unix)]
#[test]
fn exhausted_handles_and_memory_cost_nothing() {
    let whole = Undisturbed::make();
    for (fault, limit, told) in [
        ("no file handle left", "ulimit -n 5", "named, exit code 1"),
        ("no memory left", "ulimit -v 60000", "the process is ended"),
    ] {
        let take = whole.take(limit);
        assert!(run(&take, &["--to", "pose"]).status.success());
        let known = assert_true_status(&take);
        let script = format!("{limit}; exec \"$0\" \"$@\"");
        let args = ["-c", &script, env!("CARGO_BIN_EXE_strandflow"), "run", text(&take), "--threads", "2"];
        let limited = Command::new("sh").args(args).output().unwrap();
        assert!(!limited.status.success(), "{fault}: {}", stderr(&limited));
        let now = assert_true_status(&take);
        assert!(known.is_subset(&now));
        whole.complete(&take, &now, &BTreeSet::new(), &[]);
        tell(fault, 1, 0, told);
    }
}

/// A disk that is full, then one that cannot be written to, at several moments.
#[cfg(target_os = "linux")]
#[test]
fn a_full_or_read_only_disk_costs_nothing() {
    let whole = Undisturbed::make();
    let size: usize =
        bytes_below(&whole.take.join("results.zarr")).values().map(|bytes| bytes.len().next_multiple_of(4096)).sum();
    let take = whole.take("disk");
    let Some(disk) = Disk::mount(&take.join("results.zarr"), size / 8) else { return };
    for eighths in [2, 3, 5, 7] {
        let full = run(&take, &[]);
        assert_eq!(full.status.code(), Some(1), "{}", stderr(&full));
        assert!(stderr(&full).contains("disk"), "{}", stderr(&full));
        let known = assert_true_status(&take);
        disk.remount("ro");
        let refused = run(&take, &[]);
        assert_eq!(refused.status.code(), Some(1), "{}", stderr(&refused));
        assert_eq!(assert_true_status(&take), known);
        disk.remount(&format!("rw,size={}", size * eighths / 8));
    }
    disk.remount(&format!("size={}", size * 4));
    let known = assert_true_status(&take);
    whole.complete(&take, &known, &BTreeSet::new(), &[]);
    tell("disk full", 4, 0, "named, exit code 1");
    tell("store read-only", 4, 0, "named, exit code 1");
}

/// A small disk in memory, until it is dropped.
#[cfg(target_os = "linux")]
struct Disk(PathBuf);

#[cfg(target_os = "linux")]
impl Disk {
    fn mount(at: &Path, bytes: usize) -> Option<Self> {
        std::fs::create_dir_all(at).unwrap();
        let mount =
            Command::new("mount").args(["-t", "tmpfs", "-o", &format!("size={bytes}"), "tmpfs", text(at)]).output();
        if mount.is_ok_and(|output| output.status.success()) {
            return Some(Self(at.to_owned()));
        }
        let must = ["CI", "STRANDFLOW_REQUIRE"].iter().any(|name| std::env::var_os(name).is_some());
        assert!(!must, "a full disk cannot be tested without the right to mount one");
        eprintln!("skipped: no right to mount a disk");
        None
    }

    fn remount(&self, options: &str) {
        let options = format!("remount,{options}");
        assert!(Command::new("mount").args(["-o", &options, text(&self.0)]).status().unwrap().success());
    }
}

#[cfg(target_os = "linux")]
impl Drop for Disk {
    fn drop(&mut self) {
        // The folder goes with the test's own.
        let _ = Command::new("umount").arg("--lazy").arg(&self.0).status();
    }
}
