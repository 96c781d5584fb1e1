//! Broken calibrations: cut at every byte, with bytes changed, with absurd numbers and counts, nested without end. A reader
//! answers soon, with a rig or an error that names the file, and takes no memory for what a file only claims.
#![expect(clippy::unwrap_used, reason = "a failing unwrap is a failing test")]

use std::{
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use strandflow_io::{ReadOptions, read_calibration_with};

/// The longest that one file may take, on a machine that does much else too. The slowest takes a tenth of a second alone; work
/// that grows with the square of a file's length would take many minutes.
const SLOWEST: Duration = Duration::from_secs(30);
/// Buffers and a copy of the largest file in tree form; a count that was believed would be gigabytes.
const MOST_MB: f64 = 200.0;

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data")
}

/// Every fixture: the path that is read, and the files below it.
fn fixtures() -> Vec<(PathBuf, Vec<PathBuf>)> {
    let mut all = Vec::new();
    for folder in [data(), data().join("dialects")] {
        let mut entries: Vec<PathBuf> = std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()).collect();
        entries.sort();
        for path in entries {
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            if path.is_file() && name != "expected.json" {
                all.push((path.clone(), vec![path]));
            } else if path.is_dir() && name != "dialects" {
                let mut files: Vec<PathBuf> = std::fs::read_dir(&path).unwrap().map(|e| e.unwrap().path()).collect();
                files.sort();
                all.push((path, files));
            }
        }
    }
    all
}

fn copy(path: &Path, files: &[PathBuf], to: &Path) -> PathBuf {
    let place = to.join(path.file_name().unwrap());
    for file in files {
        let target = place.join(file.strip_prefix(path).unwrap());
        let target = if file == path { place.clone() } else { target };
        std::fs::create_dir_all(target.parent().unwrap()).unwrap();
        std::fs::copy(file, target).unwrap();
    }
    place
}

/// Reads what is at `place`; an error must name a file there.
fn read(place: &Path, what: &str) {
    let sizes = ["a", "b"].map(|name| (name.to_owned(), [640, 480])).into();
    let options = ReadOptions { guess_unit: true, sizes, ..ReadOptions::default() };
    let start = Instant::now();
    let read = read_calibration_with(place, &options);
    assert!(start.elapsed() < SLOWEST, "{} {what}: {:?}", place.display(), start.elapsed());
    match read {
        Ok(calibration) => {
            for camera in &calibration.rig.cameras {
                let pose = camera.camera_from_world;
                let is_sound = pose.rotation.is_finite()
                    && camera.focal.iter().chain(&camera.principal).all(|x| x.is_finite())
                    && camera.distortion.is_finite();
                assert!(is_sound, "{} {what}: {camera:?}", place.display());
            }
        }
        Err(error) => {
            let named = place.file_name().unwrap().to_string_lossy().into_owned();
            assert!(error.to_string().contains(&*named), "{what}: {error}");
            assert!(!error.hint().is_empty(), "{what}: {error}");
        }
    }
}

/// Numbers by a fixed rule, so that a failure comes back (a linear congruence, Knuth's constants).
struct Dice(u64);

impl Dice {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % limit.max(1)
    }
}

/// A folder in memory where there is one: the files are written a hundred thousand times.
fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap()
}

/// Runs `change` on copies of every file of every fixture, and reads.
fn for_every_file(mut change: impl FnMut(&[u8], &mut dyn FnMut(&str, &[u8]))) {
    let dir = folder();
    for (path, files) in fixtures() {
        let place = copy(&path, &files, dir.path());
        for file in &files {
            let target = if *file == path { place.clone() } else { place.join(file.strip_prefix(&path).unwrap()) };
            let bytes = std::fs::read(file).unwrap();
            change(&bytes, &mut |what, changed| {
                std::fs::write(&target, changed).unwrap();
                read(&place, what);
            });
            std::fs::write(&target, &bytes).unwrap();
        }
    }
}

#[test]
fn the_fixtures_are_there() {
    assert!(fixtures().len() > 25, "{}", fixtures().len());
}

#[test]
fn files_cut_at_any_byte() {
    for_every_file(|bytes, read| {
        for length in 0..bytes.len() {
            read(&format!("cut to {length}"), &bytes[..length]);
        }
    });
}

#[test]
fn files_with_changed_moved_and_repeated_bytes() {
    let mut dice = Dice(1);
    for_every_file(|bytes, read| {
        for turn in 0..150 {
            let mut changed = bytes.to_vec();
            for _ in 0..=dice.below(6) {
                let (at, kind) = (dice.below(changed.len()), dice.below(4));
                let length = dice.below(40).min(changed.len() - at);
                match kind {
                    0 => changed[at] ^= 1 << dice.below(8),
                    1 => changed[at] = dice.below(256) as u8,
                    2 => drop(changed.drain(at..at + length)),
                    _ => {
                        let piece = changed[at..at + length].to_vec();
                        let to = dice.below(changed.len());
                        changed.splice(to..to, piece);
                    }
                }
                if changed.is_empty() {
                    changed.push(0);
                }
            }
            read(&format!("turn {turn}"), &changed);
        }
    });
}

#[test]
fn numbers_and_counts_beyond_reason() {
    for_every_file(|bytes, read| {
        let Ok(text) = std::str::from_utf8(bytes) else {
            // Binary: every eight bytes, at every place, as a count or number that cannot be.
            for at in 0..bytes.len() {
                for value in [[0xff; 8], [0, 0, 0, 0, 0, 0, 0, 0x7f], [0, 0, 0, 0x40, 0, 0, 0, 0], [0; 8]] {
                    let mut changed = bytes.to_vec();
                    let end = (at + 8).min(changed.len());
                    changed[at..end].copy_from_slice(&value[..end - at]);
                    read(&format!("{value:?} at {at}"), &changed);
                }
            }
            return;
        };
        // Text: the numbers, one after the other.
        let is_part = |c: char| c.is_ascii_digit() || ".-+eE".contains(c);
        let mut at = 0;
        while let Some(start) = text[at..].find(|c: char| c.is_ascii_digit()).map(|found| at + found) {
            let end = text[start..].find(|c| !is_part(c)).map_or(text.len(), |found| start + found);
            for number in ["1e308", "-1e308", "99999999999999999999", "-1", "0", "NaN", "1e-320"] {
                let changed = format!("{}{number}{}", &text[..start], &text[end..]);
                read(&format!("{number} at {start}"), changed.as_bytes());
            }
            at = end;
        }
    });
}

#[test]
fn long_and_deep_files_are_refused_without_filling_memory() {
    let dir = folder();
    let deep = |open: &str| open.repeat(200_000);
    let stairs: String = (0..3000).map(|depth| format!("{}a:\n", " ".repeat(depth))).collect();
    let many: String = (0..20_000).map(|i| format!("K_{i}: [1,0,0,0,1,0,0,0,1]\n")).collect();
    let wide = format!("[{}", "1,\n".repeat(1_000_000));
    let cases = [
        ("a.json", deep("[")),
        ("a.json", deep("{\"a\":")),
        ("a.json", format!("{{\"frames\": {}", deep("["))),
        ("a.json", format!("{{\"cameras\": [{}1]}}", "1,".repeat(2_000_000))),
        ("a.xml", deep("<a>")),
        ("a.xml", format!("<opencv_storage>{}", deep("<a>"))),
        ("a.xml", format!("<opencv_storage>{}</opencv_storage>", "<a>1</a>".repeat(200_000))),
        ("a.xml", format!("<document><chunk><cameras>{}</cameras></chunk></document>", "<camera/>".repeat(200_000))),
        ("a.xml", "<".repeat(1_000_000)),
        ("a.xml", "<a b='".repeat(200_000)),
        ("a.yml", stairs),
        ("a.yml", many),
        ("a.yml", format!("K: {wide}")),
        ("a.yml", "- ".repeat(500_000)),
        ("a.yml", "a: [1\n".repeat(300_000)),
        ("a.toml", format!("a = {}", deep("["))),
        ("a.toml", deep("[[a.b]]\n")),
        ("a.txt", "K ".repeat(2_000_000)),
        ("a.txt", "camera a\n".repeat(500_000)),
        ("a.txt", format!("99999999999\n{}", "a 1\n".repeat(300_000))),
    ];
    for (i, (name, text)) in cases.into_iter().enumerate() {
        let path = dir.path().join(name);
        std::fs::write(&path, text).unwrap();
        read(&path, &format!("case {i}"));
    }
    let disk = tempfile::tempdir().unwrap();
    let sparse = disk.path().join("a.json");
    std::fs::File::create(&sparse).unwrap().set_len(1 << 40).unwrap();
    read(&sparse, "a terabyte of nothing");
    for part in ["cameras.txt", "images.txt"] {
        std::fs::File::create(disk.path().join(part)).unwrap().set_len(1 << 40).unwrap();
    }
    read(disk.path(), "a model of terabytes of nothing");
    if let Some(peak) = peak_mb() {
        assert!(peak < MOST_MB, "{peak} MB");
    }
}

/// Largest resident memory \[MB\]; `None` where the system does not tell.
fn peak_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let kilobytes = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?.split_whitespace().next()?;
    Some(kilobytes.parse::<f64>().ok()? / 1024.0)
}
