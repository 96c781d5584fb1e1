//! Hair and subject masks: those that a person gave, else those of stage `masks`.

use std::{collections::BTreeMap, path::PathBuf};

use strandflow_core::Mask;
use strandflow_engine::{EngineError, Item, footage::numbered_images};
use strandflow_io::{mask_png, read_mask};
use strandflow_view::{
    Refusal,
    desk::{ABSENT, MaskFound, MaskKind, Origin},
};

use super::home::{Files, Home, must_be_current, not_written, read};
use crate::view::source::{Source, broken};

/// A view by its index, name and image size.
#[derive(Clone, Copy)]
pub struct Place<'a> {
    /// Index in the rig.
    pub index: usize,
    /// Name.
    pub view: &'a str,
    /// Image size \[px\].
    pub size: (usize, usize),
    /// Frame.
    pub frame: usize,
}

/// Frames with given masks, by view.
pub fn given(home: &Home, kind: MaskKind, views: &[String]) -> Result<BTreeMap<String, Vec<usize>>, Refusal> {
    let files = home.files();
    let frames = |view: &String| {
        let folder = files.masks(kind).map(|folder| folder.join(view));
        let found = folder.map_or_else(|| Ok(BTreeMap::new()), |folder| numbered_images(&folder));
        Ok((view.clone(), found.map_err(|error| not_written(&error))?.into_keys().collect()))
    };
    views.iter().map(frames).collect()
}

/// A mask as it is.
pub fn get(home: &Home, source: &Source, kind: MaskKind, place: Place) -> Result<MaskFound, Refusal> {
    if let Some(file) = file_of(&home.files(), kind, place)? {
        let mask = read_mask(&file).map_err(|error| Refusal::broken(error.to_string(), error.hint()))?;
        if (mask.width, mask.height) != place.size {
            let fact = format!("{} is {}×{}", file.display(), mask.width, mask.height);
            return Err(Refusal::broken(fact, format!("the view is {}×{}: replace it", place.size.0, place.size.1)));
        }
        return Ok(MaskFound { version: read(&file)?.0, origin: Origin::Given, mask });
    }
    let (version, key) = (ABSENT.into(), Item::ViewFrame(place.index, place.frame).key("masks/masks"));
    // A take that was not run has no store, which is no fault.
    let Some(store) = source.store().ok().filter(|store| store.record(&key).is_some()) else {
        let mask = Mask::filled(place.size.0, place.size.1, 0);
        return Ok(MaskFound { version, origin: Origin::None, mask });
    };
    let masks = store.read_masks(place.index, place.frame, place.size).map_err(broken)?;
    let mask = if kind == MaskKind::Hair { masks.hair } else { masks.subject };
    Ok(MaskFound { version, origin: Origin::Computed, mask })
}

/// A new mask of the view's size, or none.
pub fn put(home: &Home, kind: MaskKind, place: Place, made_from: &str, mask: Option<&Mask>) -> Result<String, Refusal> {
    let files = home.for_writing(|files| {
        let there = file_of(files, kind, place)?;
        let current = there.as_deref().map_or_else(|| Ok(ABSENT.to_owned()), |file| Ok(read(file)?.0))?;
        must_be_current(&format!("the mask of view {}, frame {}", place.view, place.frame), made_from, &current)
    })?;
    let there = file_of(&files, kind, place)?;
    let Some(folder) = files.masks(kind) else { return Ok(ABSENT.into()) };
    let path = folder.join(place.view).join(format!("{:06}.png", place.frame));
    if let Some(mask) = mask {
        let png = mask_png(mask).map_err(|error| Refusal::bad(error.to_string(), "send a mask of the view's size"))?;
        files.write(&path, &png)?;
    }
    // A frame may have one mask only, whatever its name was.
    if let Some(old) = there.filter(|there| mask.is_none() || *there != path) {
        files.remove(&old)?;
    }
    Ok(read(&path)?.0)
}

fn file_of(files: &Files, kind: MaskKind, place: Place) -> Result<Option<PathBuf>, Refusal> {
    let Some(folder) = files.masks(kind) else { return Ok(None) };
    let given = numbered_images(&folder.join(place.view)).map_err(|error: EngineError| not_written(&error))?;
    Ok(given.get(&place.frame).cloned())
}
