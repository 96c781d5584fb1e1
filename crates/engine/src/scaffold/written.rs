//! The manifest of a new take, with comments.

use std::path::{Path, PathBuf};

use super::{calibrated::Calibrated, extras::Labels, footage::View, world::World};

/// Everything that was found beside the calibration.
pub(super) struct Found<'a> {
    pub capture: &'a Path,
    pub views: &'a [View],
    pub plates: &'a [PathBuf],
    pub labels: &'a Labels,
    pub world: &'a World,
}

pub(super) fn text(found: &Found<'_>, calibrated: &Calibrated, held_out: &[String], said: &[String]) -> String {
    let quoted = |path: &Path| toml::Value::String(path.display().to_string()).to_string();
    let Found { world, labels, .. } = found;
    let mut text = format!(
        "# The take of {}. Lengths are millimetres, times seconds. Paths are absolute or relative to this file.\n\
         # What `strandflow new` found and guessed:\n",
        found.capture.display()
    );
    for line in said {
        text += &format!("#   {}\n", line.replace('\n', " "));
    }
    text += &format!(
        "\n# Frames per second.\nfps = {:?}\n\
         # Gravity in world coordinates [mm/s²].\ngravity = {:?}\n\
         # Frames to work on, first..one past the last; all frames of the sources without it.\n",
        world.fps,
        world.gravity.to_array(),
    );
    text += &world.frames.as_ref().map_or("# frames = \"0..30\"\n".into(), |frames| format!("frames = {frames:?}\n"));
    text += "# `robust` (measures best) or `paper` (the letter of the paper).\nmode = \"robust\"\n\
             # Seed of everything that is drawn by chance.\nseed = 1\n\
             # Views that take no part in the reconstruction, so that `evaluate` can judge the strands by them.\n";
    text += &match held_out {
        [] => "# held_out = [\"cam03\"]\n".to_owned(),
        names => format!("held_out = {}\n", toml::Value::from(names.to_vec())),
    };
    text += &format!("\n[calibration]\nfile = {}\n", quoted(&calibrated.file));
    if let Some(mm) = calibrated.unit_mm {
        text += &format!("# Millimetres a unit of the calibration.\nunit_mm = {mm:?}\n");
    }
    text += &format!(
        "\n[labels]\n# Labels of the markers: at least five in one frame, any one.\nmarkers = {}\n\
         # Hair masks VIEW/FRAME.png: the first frame's; further ones hold for the frames nearest to them.\nhair_masks = {}\n\
         # Subject masks VIEW/FRAME.png that replace computed ones.\n",
        quoted(&labels.markers),
        quoted(&labels.hair_masks),
    );
    text += &match &labels.subject_masks {
        Some(folder) => format!("subject_masks = {}\n", quoted(folder)),
        None => "# subject_masks = \"corrections/subject_masks\"\n".into(),
    };
    text += "\n# Views, in the order of per-view arrays: a video or a folder of images, and the view without the subject.\n";
    for (view, plate) in found.views.iter().zip(found.plates) {
        let name = toml::Value::String(view.name.clone());
        text += &format!("[[views]]\nname = {name}\nsource = {}\nplate = {}\n\n", quoted(&view.source), quoted(plate));
    }
    text + "# Settings that differ from the defaults, one table a stage; `resolved.toml` shows all after a run.\n\
            # [settings.hull]\n# voxel_mm = 2.0\n"
}
