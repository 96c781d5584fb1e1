//! A manifest for a capture folder, with comments; nothing is copied.

use std::path::{Path, PathBuf};

use crate::{EngineError, disk, manifest::MANIFEST};

/// Makes a take for a capture folder laid out as `docs/capture.md` says.
///
/// # Errors
/// `Input` where the take exists already or the capture lacks something.
pub fn new_take(take: &Path, capture: &Path, held_out: &[String]) -> Result<PathBuf, EngineError> {
    let manifest = take.join(MANIFEST);
    if manifest.exists() {
        let hint = "give another folder, or correct the manifest that is there";
        return Err(EngineError::input(manifest.display().to_string(), "the take exists already", hint));
    }
    let capture = capture.canonicalize().map_err(|error| {
        EngineError::input(capture.display().to_string(), error.to_string(), "give the folder of the capture")
    })?;
    let found = look(&capture)?;
    if let Some(name) = held_out.iter().find(|name| !found.views.iter().any(|view| view.0 == **name)) {
        let names: Vec<&str> = found.views.iter().map(|view| view.0.as_str()).collect();
        let fact = format!("--hold-out {name}: there is no such view");
        return Err(EngineError::input(capture.display().to_string(), fact, format!("views: {}", names.join(", "))));
    }
    disk::write_atomic(&manifest, text(&capture, &found, held_out).as_bytes())?;
    Ok(manifest)
}

/// What a capture folder holds.
struct Found {
    views: Vec<(String, PathBuf, PathBuf)>,
    calibration: PathBuf,
    unit_mm: Option<f64>,
    gravity: [f64; 3],
    fps: f64,
    labels: PathBuf,
    hair_masks: PathBuf,
    subject_masks: Option<PathBuf>,
    assumed: Vec<String>,
}

fn look(capture: &Path) -> Result<Found, EngineError> {
    let lacks = |what: &str, hint: &str| EngineError::input(capture.display().to_string(), what.to_owned(), hint);
    let candidates =
        ["calibration.toml", "calibration.json", "calibration.yml", "calibration.yaml", "calibration.xml", "colmap"];
    let calibration = candidates.iter().map(|name| capture.join(name)).find(|path| path.exists());
    let hint = "put calibration.json, .toml, .yml, .xml or a colmap/ folder into the capture";
    let calibration = calibration.ok_or_else(|| lacks("there is no calibration", hint))?;
    let needs_unit = !calibration.extension().is_some_and(|e| e == "toml" || e == "json");
    let unit_mm = needs_unit.then_some(1000.0);
    let read = strandflow_io::read_calibration(&calibration, unit_mm)?;
    let mut assumed = read.notes.clone();
    if needs_unit {
        assumed.push("the calibration does not state its unit: taken as metres (calibration.unit_mm = 1000)".into());
    }
    let gravity = read.gravity.map_or_else(
        || {
            assumed.push("the calibration does not state gravity: taken as -z".into());
            [0.0, 0.0, -9810.0]
        },
        |g| g.to_array(),
    );
    let fps = read.fps.unwrap_or_else(|| {
        assumed.push("the calibration does not state frames per second: taken as 100".into());
        100.0
    });
    let views = views_of(capture)?;
    let labels = capture.join("user/marker_labels.json");
    let hair_masks = capture.join("user/hair_masks");
    let subject_masks = Some(capture.join("user/subject_masks")).filter(|folder| folder.is_dir());
    Ok(Found { views, calibration, unit_mm, gravity, fps, labels, hair_masks, subject_masks, assumed })
}

/// Views by name: `video/NAME.*` or `images/NAME/`, with `clean/NAME.*`.
fn views_of(capture: &Path) -> Result<Vec<(String, PathBuf, PathBuf)>, EngineError> {
    let list = |folder: &Path| -> Vec<PathBuf> {
        let mut entries: Vec<PathBuf> =
            std::fs::read_dir(folder).map(|dir| dir.flatten().map(|e| e.path()).collect()).unwrap_or_default();
        entries.sort();
        entries.retain(|path| path.file_name().is_some_and(|n| !n.to_string_lossy().starts_with('.')));
        entries
    };
    let stem = |path: &Path| path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let mut sources = list(&capture.join("video"));
    if sources.is_empty() {
        sources = list(&capture.join("images")).into_iter().filter(|path| path.is_dir()).collect();
    }
    if sources.is_empty() {
        let hint = "put clips into video/NAME.mp4 or images into images/NAME/000000.png";
        return Err(EngineError::input(capture.display().to_string(), "there are no views", hint));
    }
    let plates = list(&capture.join("clean"));
    sources
        .into_iter()
        .map(|source| {
            let name = stem(&source);
            let plate = plates.iter().find(|plate| stem(plate) == name).cloned().ok_or_else(|| {
                let hint = format!("put the view without the subject into clean/{name}.png");
                EngineError::input(format!("{}, view {name}", capture.display()), "there is no clean plate", hint)
            })?;
            Ok((name, source, plate))
        })
        .collect()
}

fn text(capture: &Path, found: &Found, held_out: &[String]) -> String {
    let quoted = |path: &Path| toml::Value::String(path.display().to_string()).to_string();
    let mut text = format!(
        "# The take of {}. Lengths are millimetres, times seconds. Paths are absolute or relative to this file.\n\n\
         # Frames per second.\nfps = {:?}\n\
         # Gravity in world coordinates [mm/s²].\ngravity = {:?}\n\
         # Frames to work on, first..one past the last; all frames of the sources without it.\n# frames = \"0..30\"\n\
         # `robust` (measures best) or `paper` (the letter of the paper).\nmode = \"robust\"\n\
         # Seed of everything that is drawn by chance.\nseed = 1\n\
         # Views that take no part in the reconstruction, so that `evaluate` can judge the strands by them.\n",
        capture.display(),
        found.fps,
        found.gravity,
    );
    text += &match held_out {
        [] => "# held_out = [\"cam03\"]\n".to_owned(),
        names => format!("held_out = {}\n", toml::Value::from(names.to_vec())),
    };
    for note in &found.assumed {
        text += &format!("# Assumed: {note}\n");
    }
    text += &format!("\n[calibration]\nfile = {}\n", quoted(&found.calibration));
    if let Some(mm) = found.unit_mm {
        text += &format!("# Millimetres a unit of the calibration.\nunit_mm = {mm:?}\n");
    }
    text += &format!(
        "\n[labels]\n# Markers labelled in the first frame.\nmarkers = {}\n\
         # Hair masks VIEW/FRAME.png: the first frame's; further ones hold for the frames nearest to them.\nhair_masks = {}\n\
         # Subject masks VIEW/FRAME.png that replace computed ones.\n",
        quoted(&found.labels),
        quoted(&found.hair_masks),
    );
    text += &match &found.subject_masks {
        Some(folder) => format!("subject_masks = {}\n", quoted(folder)),
        None => "# subject_masks = \"corrections/subject_masks\"\n".into(),
    };
    text += "\n# Views, in the order of per-view arrays: a video or a folder of images, and the view without the subject.\n";
    for (name, source, plate) in &found.views {
        let name = toml::Value::String(name.clone());
        text += &format!("[[views]]\nname = {name}\nsource = {}\nplate = {}\n\n", quoted(source), quoted(plate));
    }
    text + "# Settings that differ from the defaults, one table a stage; `resolved.toml` shows all after a run.\n\
            # [settings.hull]\n# voxel_mm = 2.0\n"
}
