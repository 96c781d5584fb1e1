//! Takes of strangers: what is read and written must lie within the take.

use std::{
    fs::DirEntry,
    path::{Path, PathBuf},
};

use crate::{EngineError, Manifest};

/// Looks at every path that the manifest of a take names, and at every symbolic link below the take, before any is followed: all
/// must lead to the take's folder or into it.
///
/// # Errors
/// `Input` with the field or link, and where it leads; or the manifest cannot be read.
pub fn must_be_confined(root: &Path) -> Result<(), EngineError> {
    let manifest = Manifest::read(root)?;
    let take = root.canonicalize().map_err(|error| EngineError::disk(root, error))?;
    let refuse = |what: String, outside: &Path| {
        let fact = format!("{} lies outside the take", outside.display());
        let hint = "copy it into the take, or leave --confined away if you trust who made the take";
        Err(EngineError::input(what, fact, hint))
    };
    let fields = named(&manifest).into_iter().map(|(field, path)| (field, take.join(path)));
    if let Some((field, path)) = { fields }.find(|(_, path)| leads_out(&take, path)) {
        return refuse(field, &path);
    }
    match link_out(&take, &take) {
        Some(link) => refuse("symbolic link".into(), &link),
        None => Ok(()),
    }
}

/// All paths in a manifest, with the fields that hold them.
fn named(manifest: &Manifest) -> Vec<(String, &str)> {
    let mut named: Vec<(String, &str)> = vec![("calibration.file".into(), &manifest.calibration.file)];
    for view in &manifest.views {
        named.push((format!("view {}, source", view.name), &view.source));
        named.push((format!("view {}, plate", view.name), &view.plate));
    }
    let labels = &manifest.labels;
    named.push(("labels.markers".into(), &labels.markers));
    named.push(("labels.hair_masks".into(), &labels.hair_masks));
    named.extend(labels.subject_masks.iter().map(|path| ("labels.subject_masks".into(), path.as_str())));
    named
}

/// Whether a path lies elsewhere than in the take. Where nothing is there, its nearest folder that is there tells.
fn leads_out(take: &Path, path: &Path) -> bool {
    let there = path.ancestors().find_map(|path| path.canonicalize().ok());
    !there.is_some_and(|there| there.starts_with(take))
}

/// A symbolic link below a folder that leads out of the take, or nowhere. Links are not followed: what they lead to within the
/// take is looked at in its place.
fn link_out(take: &Path, folder: &Path) -> Option<PathBuf> {
    let entries: Vec<DirEntry> = std::fs::read_dir(folder).into_iter().flatten().flatten().collect();
    let is = |entry: &DirEntry, kind: fn(&std::fs::FileType) -> bool| entry.file_type().is_ok_and(|of| kind(&of));
    let leads_in = |path: &Path| path.canonicalize().is_ok_and(|there| there.starts_with(take));
    let links = entries.iter().filter(|entry| is(entry, std::fs::FileType::is_symlink)).map(DirEntry::path);
    let folders = entries.iter().filter(|entry| is(entry, std::fs::FileType::is_dir)).map(DirEntry::path);
    { links }.find(|link| !leads_in(link)).or_else(|| { folders }.find_map(|folder| link_out(take, &folder)))
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn what_lies_elsewhere_is_found_also_behind_links() {
        let root = tempfile::tempdir().unwrap();
        let (take, elsewhere) = (root.path().join("take"), root.path().join("elsewhere"));
        std::fs::create_dir_all(take.join("images/cam0")).unwrap();
        std::fs::create_dir_all(&elsewhere).unwrap();
        let take = take.canonicalize().unwrap();
        for (path, out) in [
            ("images", false),
            ("missing/file", false),
            ("../elsewhere", true),
            ("images/../../elsewhere/none", true),
            ("/etc/passwd", true),
        ] {
            assert_eq!(leads_out(&take, &take.join(path)), out, "{path}");
        }
        symlink("../..", take.join("images/cam0/round")).unwrap();
        assert_eq!(link_out(&take, &take), None, "it stays inside");
        let link = take.join("images/cam0/000000.png");
        symlink(&elsewhere, &link).unwrap();
        assert_eq!(link_out(&take, &take), Some(link));
    }
}
