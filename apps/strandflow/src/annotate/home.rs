//! Where the user's files live. What is written stays within the take: labels and masks that the manifest names elsewhere are
//! copied into `user/` before the first change, and the manifest names the copies from then on.

use std::{
    fs,
    hash::{DefaultHasher, Hasher},
    io::ErrorKind,
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
};

use strandflow_engine::{
    EngineError, Manifest, disk,
    footage::numbered_images,
    manifest::{Labels, MANIFEST},
};
use strandflow_view::{
    Refusal,
    desk::{ABSENT, MaskKind},
};

use super::manifest_text::with_labels;

const LABELS: &str = "user/marker_labels.json";
const HAIR: &str = "user/hair_masks";
const SUBJECT: &str = "user/subject_masks";

/// The files, one change at a time.
pub struct Home {
    /// Without links and without `..`.
    root: PathBuf,
    files: Mutex<Files>,
}

/// Where they are.
pub struct Files {
    root: PathBuf,
    /// Marker labels.
    pub labels: PathBuf,
    hair: PathBuf,
    subject: Option<PathBuf>,
}

impl Home {
    /// Of a take.
    pub fn open(root: &Path, manifest: &Manifest) -> Result<Self, EngineError> {
        let root = root.canonicalize().map_err(|error| EngineError::disk(root, error))?;
        let files = Mutex::new(Files::of(&root, &manifest.labels));
        Ok(Self { root, files })
    }

    /// The files as they are.
    pub fn files(&self) -> MutexGuard<'_, Files> {
        self.files.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The files, all within the take. Where `may` refuses the change, nothing is copied for it.
    pub fn for_writing(
        &self,
        may: impl FnOnce(&Files) -> Result<(), Refusal>,
    ) -> Result<MutexGuard<'_, Files>, Refusal> {
        let mut files = self.files();
        may(&files)?;
        if !files.are_within() {
            *files = self.bring_in(&files).map_err(|error| not_written(&error))?;
        }
        Ok(files)
    }

    /// Copies what is elsewhere, then changes the manifest. Killed in between, it begins again.
    fn bring_in(&self, old: &Files) -> Result<Files, EngineError> {
        let path = self.root.join(MANIFEST);
        let text = disk::read_text(&path)?;
        let mut manifest = Manifest::parse(&text, &path.display().to_string())?;
        let labels = Labels { markers: LABELS.into(), hair_masks: HAIR.into(), subject_masks: Some(SUBJECT.into()) };
        let new = Files::of(&self.root, &labels);
        if !new.are_within() {
            let subject = self.root.join("user").display().to_string();
            let hint = "make it a folder of the take, not a link to another place";
            return Err(EngineError::input(subject, "leads out of the take", hint));
        }
        copy(&old.labels, &new.labels)?;
        for kind in [MaskKind::Hair, MaskKind::Subject] {
            let Some(to) = new.masks(kind) else { continue };
            fs::create_dir_all(to).map_err(|error| EngineError::disk(to, error))?;
            let Some(from) = old.masks(kind) else { continue };
            for view in &manifest.views {
                for file in numbered_images(&from.join(&view.name))?.into_values() {
                    copy(&file, &to.join(&view.name).join(file.file_name().unwrap_or_default()))?;
                }
            }
        }
        let changed = with_labels(&text, &[("markers", LABELS), ("hair_masks", HAIR), ("subject_masks", SUBJECT)]);
        manifest.labels = labels;
        if Manifest::parse(&changed, MANIFEST).ok() != Some(manifest) {
            let fact = "[labels] names files outside the take, and could not be changed";
            let hint = format!(
                "write markers = \"{LABELS}\", hair_masks = \"{HAIR}\" and subject_masks = \"{SUBJECT}\" into [labels]; \
                 the files are copied there already"
            );
            return Err(EngineError::input(path.display().to_string(), fact, hint));
        }
        disk::write_atomic(&path, changed.as_bytes())?;
        Ok(new)
    }
}

impl Files {
    fn of(root: &Path, labels: &Labels) -> Self {
        Self {
            root: root.to_owned(),
            labels: root.join(&labels.markers),
            hair: root.join(&labels.hair_masks),
            subject: labels.subject_masks.as_ref().map(|folder| root.join(folder)),
        }
    }

    fn are_within(&self) -> bool {
        let all = [Some(&self.labels), Some(&self.hair), self.subject.as_ref()];
        all.into_iter().all(|path| path.is_some_and(|path| is_within(&self.root, path)))
    }

    /// The folder of masks, where there may be one.
    pub fn masks(&self, kind: MaskKind) -> Option<&Path> {
        match kind {
            MaskKind::Hair => Some(&self.hair),
            MaskKind::Subject => self.subject.as_deref(),
        }
    }

    /// A file or folder for sketches.
    pub fn sketches(&self, name: &str) -> PathBuf {
        self.root.join("user").join(name)
    }

    /// Writes a file of the take, whole or not at all; a link that leads out of the take is not followed.
    pub fn write(&self, path: &Path, bytes: &[u8]) -> Result<(), Refusal> {
        self.must_be_within(path)?;
        disk::write_atomic(path, bytes).map_err(|error| not_written(&error))
    }

    /// Removes a file of the take that may not be there.
    pub fn remove(&self, path: &Path) -> Result<(), Refusal> {
        self.must_be_within(path)?;
        disk::remove_file(path).map_err(|error| not_written(&error))
    }

    fn must_be_within(&self, path: &Path) -> Result<(), Refusal> {
        let hint = "make it a folder of the take, not a link to another place";
        let fact = || format!("{} leads out of the take", path.display());
        is_within(&self.root, path).then_some(()).ok_or_else(|| Refusal::broken(fact(), hint))
    }
}

/// Whether a path leads into a folder, links followed. Neither has to exist.
fn is_within(root: &Path, path: &Path) -> bool {
    let plain = !path.components().any(|part| part == std::path::Component::ParentDir);
    // The nearest folder above that is there decides.
    plain && path.ancestors().find_map(|above| above.canonicalize().ok()).is_some_and(|real| real.starts_with(root))
}

/// Copies a file that may not be there. Another one in its place stays and is told.
fn copy(from: &Path, to: &Path) -> Result<(), EngineError> {
    let bytes = match fs::read(from) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        read => read.map_err(|error| EngineError::disk(from, error))?,
    };
    match fs::read(to) {
        Ok(there) if there == bytes => Ok(()),
        Ok(_) => {
            let fact = format!("is there, and is another file than {}, which the manifest names", from.display());
            let hint = "move one of them away, or name the one that counts in [labels] of the manifest";
            Err(EngineError::input(to.display().to_string(), fact, hint))
        }
        Err(_) => disk::write_atomic(to, &bytes),
    }
}

/// A failure to write on its way to the browser.
pub fn not_written(error: &EngineError) -> Refusal {
    Refusal::broken(error.to_string(), error.hint())
}

/// The bytes of a file with their version; none where it is not there.
pub fn read(path: &Path) -> Result<(String, Option<Vec<u8>>), Refusal> {
    match fs::read(path) {
        Ok(bytes) => Ok((version(&bytes), Some(bytes))),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok((ABSENT.into(), None)),
        Err(error) => Err(not_written(&EngineError::disk(path, error))),
    }
}

/// The version of bytes.
pub fn version(bytes: &[u8]) -> String {
    let mut hasher = DefaultHasher::new();
    hasher.write(bytes);
    format!("{:016x}", hasher.finish())
}

/// Refuses a change that was made from another version than the one that is there.
pub fn must_be_current(what: &str, made_from: &str, there: &str) -> Result<(), Refusal> {
    let fact = || format!("{what} changed meanwhile, in another window or on disk");
    (made_from == there).then_some(()).ok_or_else(|| Refusal::changed(fact(), "look at it again, then change it"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn links_and_dots_lead_out() {
        let dir = tempfile::tempdir().unwrap();
        let (root, other) = (dir.path().join("take"), dir.path().join("other"));
        fs::create_dir_all(root.join("user")).unwrap();
        fs::create_dir_all(&other).unwrap();
        std::os::unix::fs::symlink(&other, root.join("user/hair_masks")).unwrap();
        let root = root.canonicalize().unwrap();
        for (path, within) in [
            ("user/new/deep.png", true),
            ("user/../user/a.png", false),
            ("user/hair_masks/cam00/000000.png", false),
            ("../other/a.png", false),
            ("/etc/passwd", false),
        ] {
            assert_eq!(is_within(&root, &root.join(path)), within, "{path}");
        }
    }

    #[test]
    fn another_file_in_the_place_of_a_copy_stays() {
        let dir = tempfile::tempdir().unwrap();
        let (from, to) = (dir.path().join("a"), dir.path().join("b"));
        copy(&from, &to).unwrap();
        assert!(!to.exists());
        fs::write(&from, "labels").unwrap();
        copy(&from, &to).unwrap();
        copy(&from, &to).unwrap();
        fs::write(&to, "others").unwrap();
        assert!(copy(&from, &to).unwrap_err().to_string().contains("is another file than"));
        assert_eq!(fs::read(&to).unwrap(), b"others");
    }
}
