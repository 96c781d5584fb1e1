//! Animated Alembic (Ogawa): curves of constant topology with Unreal's groom schema 1.4, frames written as they arrive.
//!
//! | object | holds |
//! |---|---|
//! | `/hair` | a transform that does nothing; user properties `groom_version_major` 1, `groom_version_minor` 4, `groom_tool` |
//! | `/hair/strands/strands` | linear curves, root first; `groom_guide` 0 |
//! | `/hair/guides/guides` | where guides are given: their curves again; `groom_guide` 1 |
//!
//! Both are of group 0 (`groom_group_id`): Unreal's importer puts every curve with `groom_guide` 1 among the guides of its
//! group, whatever object it is in. `groom_id` is the strand's number in the take; ids of guides go on after the largest of
//! the strands, with the number in `strand`. With guides every strand names its own thrice in `groom_closest_guides`, with
//! weights 1, 0, 0 (`groom_guide_weights`). `groom_width` stands beside the curves' own `width`, since importers fall back to
//! a centimetre without it. `provenance` and `confidence` are per point and frame.
//!
//! The file states neither unit nor axes; they are those of the options' [`Space`](crate::Space).
//!
//! References: Alembic's documentation of Ogawa and AbcGeom (alembic.io); Epic Games, "Alembic for Grooms Specification".

use std::{io::BufWriter, path::Path};

use crate::{
    Groom, IoError,
    error::At,
    groom::from_file,
    guides::Guides,
    scene::{Scene, SceneOptions},
    strands::StrandFrames,
    whole_file::{Unfinished, write_whole},
};

mod archive;
mod curves;
mod groom;
mod ogawa;
mod property;
mod reader;

/// Writes strands, and guides beside them where given, as Alembic. Memory: a few frames.
///
/// # Errors
/// No strand takes part, the frames are not evenly spaced, a frame cannot be read, or the file cannot be written; the file is
/// then as it was before.
pub fn write_alembic(
    path: &Path,
    strands: &dyn StrandFrames,
    guides: Option<&Guides>,
    options: &SceneOptions,
) -> Result<(), IoError> {
    let scene = Scene::new(path, strands, &SceneOptions { velocities: false, ..*options })?;
    let timing = archive::Timing::of(scene.curves.frames(), options.fps).ok_or_else(|| {
        let hint = "export a range of frames without gaps";
        IoError::content(path, At::FILE, "cannot hold frames that are not evenly spaced", hint)
    })?;
    write_whole(path, |out| write_to(out, &scene, guides, &timing))
}

fn write_to(
    out: &mut BufWriter<std::fs::File>,
    scene: &Scene,
    guides: Option<&Guides>,
    timing: &archive::Timing,
) -> Result<(), Unfinished> {
    let mut file = ogawa::Ogawa::begin(out)?;
    let mut objects = curves::CurveObject::of(scene, guides);
    for t in 0..scene.curves.frames().len() {
        let sample = scene.sample(t)?;
        for object in &mut objects {
            object.put_frame(&mut file, &sample, scene.width())?;
        }
    }
    let mut children = Vec::new();
    for object in objects {
        children.push(object.finish(&mut file, scene)?);
    }
    Ok(archive::finish(file, children, timing)?)
}

/// Reads the curves of any writer: control points of the first samples, in units of the file.
pub(crate) fn read_curves(path: &Path) -> Result<Groom, IoError> {
    from_file(path, "export the groom as Alembic curves (Ogawa) again", groom::groom)
}

#[cfg(test)]
#[path = "alembic/tests.rs"]
mod tests;

#[cfg(test)]
#[path = "alembic/read_tests.rs"]
mod read_tests;
