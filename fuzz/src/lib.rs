//! What the fuzz targets share: a folder in memory, seeds from the fixtures of the tests, and an allocator that ends the run
//! where a reader asks for memory by what a file only claims.

use std::{
    alloc::{GlobalAlloc, Layout, System},
    fs,
    path::{Path, PathBuf},
};

use strandflow_io::{IoError, ReadOptions, read_calibration_with};

/// No single buffer for a file of some kilobytes is as large \[bytes\].
const LARGEST: usize = 64 << 20;

/// The system's allocator, which gives nothing larger than 64 MiB: the process aborts, and libFuzzer keeps the input.
pub struct Bounded;

// SAFETY: every request goes to the system's allocator, or is refused by null as the contract allows.
unsafe impl GlobalAlloc for Bounded {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if layout.size() > LARGEST { std::ptr::null_mut() } else { unsafe { System.alloc(layout) } }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        if layout.size() > LARGEST { std::ptr::null_mut() } else { unsafe { System.alloc_zeroed(layout) } }
    }

    unsafe fn realloc(&self, old: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        if size > LARGEST { std::ptr::null_mut() } else { unsafe { System.realloc(old, layout, size) } }
    }

    unsafe fn dealloc(&self, old: *mut u8, layout: Layout) {
        unsafe { System.dealloc(old, layout) }
    }
}

#[global_allocator]
static MEMORY: Bounded = Bounded;

/// A folder of this process alone: where `STRANDFLOW_FUZZ_FOLDER` says, and who says it removes it; otherwise in memory, where
/// the system has such a place. Folders of processes that are no more are removed.
pub fn folder() -> PathBuf {
    let given = std::env::var_os("STRANDFLOW_FUZZ_FOLDER").map(PathBuf::from);
    let folder = given.unwrap_or_else(|| {
        let shared = Path::new("/dev/shm");
        let root = if shared.is_dir() { shared.to_owned() } else { std::env::temp_dir() };
        left_behind(&root).iter().for_each(|folder| drop(fs::remove_dir_all(folder)));
        root.join(format!("{NAME}{}", std::process::id()))
    });
    fs::create_dir_all(&folder).expect("a folder for the files that are read");
    folder
}

/// What the names of these folders begin with; the number of the process follows.
const NAME: &str = "strandflow-fuzz-";

/// Folders of processes that are no more, where the system tells which there are.
fn left_behind(root: &Path) -> Vec<PathBuf> {
    let processes = Path::new("/proc");
    if !processes.join("self").exists() {
        return Vec::new();
    }
    let of = |folder: &PathBuf| folder.file_name()?.to_str()?.strip_prefix(NAME)?.parse::<u32>().ok();
    let entries = fs::read_dir(root).into_iter().flatten().flatten().map(|entry| entry.path());
    entries.filter(|folder| of(folder).is_some_and(|process| !processes.join(process.to_string()).exists())).collect()
}

/// An error must say which file, and what to do.
pub fn told<T>(path: &Path, read: Result<T, IoError>) -> Option<T> {
    match read {
        Ok(value) => Some(value),
        Err(error) => {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            assert!(error.to_string().contains(&name), "{error} does not name {name}");
            assert!(!error.hint().is_empty(), "{error} has no hint");
            None
        }
    }
}

/// Reads a calibration; what comes out must be numbers.
pub fn calibration(path: &Path) {
    let sizes = ["a", "b"].map(|name| (name.to_owned(), [640, 480])).into();
    let options = ReadOptions { guess_unit: true, sizes, ..ReadOptions::default() };
    let Some(read) = told(path, read_calibration_with(path, &options)) else { return };
    for camera in &read.rig.cameras {
        let pose = camera.camera_from_world;
        let numbers = camera.focal.iter().chain(&camera.principal).all(|x| x.is_finite());
        assert!(numbers && pose.rotation.is_finite() && camera.distortion.is_finite(), "{camera:?}");
    }
}

/// Fixtures of the tests of `strandflow-io`.
fn fixtures() -> Vec<PathBuf> {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates/io/tests/data");
    let entries = |folder: &Path| fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut all: Vec<PathBuf> = entries(&data).chain(entries(&data.join("dialects"))).collect();
    all.retain(|path| !path.ends_with("dialects") && !path.ends_with("expected.json"));
    all.sort();
    all
}

/// Fixtures that are one file: their bytes.
pub fn single_files() -> Vec<Vec<u8>> {
    fixtures().into_iter().filter(|path| path.is_file()).filter_map(|path| fs::read(path).ok()).collect()
}

/// Fixtures that are folders, as [`unpack`] takes them.
pub fn folders() -> Vec<Vec<u8>> {
    let pack = |folder: PathBuf| {
        let mut files: Vec<PathBuf> = fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
        files.sort();
        let mut packed = Vec::new();
        for file in files {
            let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            packed.extend_from_slice(MARK);
            packed.extend(name.bytes());
            packed.push(b'\n');
            packed.extend(fs::read(&file).unwrap_or_default());
        }
        packed
    };
    fixtures().into_iter().filter(|path| path.is_dir()).map(pack).collect()
}

/// Before the name of each file of a folder.
const MARK: &[u8] = b"\n=8<= ";

/// The files of a packed folder: name and bytes. Names that are no plain names are left out.
pub fn unpack(packed: &[u8]) -> Vec<(String, &[u8])> {
    let mut files = Vec::new();
    let mut rest = packed;
    while let Some(at) = rest.windows(MARK.len()).position(|part| part == MARK) {
        rest = &rest[at + MARK.len()..];
        let end = rest.windows(MARK.len()).position(|part| part == MARK).unwrap_or(rest.len());
        let Some(line) = rest[..end].iter().position(|b| *b == b'\n') else { continue };
        let name = String::from_utf8_lossy(&rest[..line]).into_owned();
        let plain = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '.' || c == '_');
        if plain && name.len() < 40 && !name.trim_matches('.').is_empty() {
            files.push((name, &rest[line + 1..end]));
        }
    }
    files
}

/// Where `STRANDFLOW_FUZZ_SEEDS` names a folder: writes the seeds there, and ends the process.
pub fn seeds(make: impl FnOnce() -> Vec<Vec<u8>>) {
    let Some(folder) = std::env::var_os("STRANDFLOW_FUZZ_SEEDS").map(PathBuf::from) else { return };
    fs::create_dir_all(&folder).expect("the folder of seeds");
    for (n, bytes) in make().into_iter().enumerate() {
        fs::write(folder.join(format!("seed{n:03}")), bytes).expect("a seed");
    }
    std::process::exit(0);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packed_folder_is_unpacked_and_names_that_lead_elsewhere_are_left_out() {
        let packed = b"\n=8<= cameras.txt\n1 PINHOLE\n=8<= ../a\nx\n=8<= ..\ny\n=8<= b.bin\n\x00";
        let files: Vec<(String, &[u8])> =
            vec![("cameras.txt".into(), b"1 PINHOLE".as_slice()), ("b.bin".into(), b"\x00".as_slice())];
        assert_eq!(unpack(packed), files);
        assert!(folders().iter().all(|folder| !unpack(folder).is_empty()) && !folders().is_empty());
    }

    #[test]
    fn folders_of_processes_that_are_no_more_are_told() {
        if !Path::new("/proc/self").exists() {
            return;
        }
        let root = std::env::temp_dir().join(format!("strandflow-fuzz-test-{}", std::process::id()));
        let [ours, gone] = [std::process::id(), u32::MAX].map(|process| root.join(format!("{NAME}{process}")));
        [&ours, &gone].iter().for_each(|folder| fs::create_dir_all(folder).expect("a folder"));
        let found = left_behind(&root);
        fs::remove_dir_all(&root).expect("the folder can be removed");
        assert_eq!(found, [gone]);
    }
}
