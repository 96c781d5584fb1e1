//! Evidence from a take on disk: everything that can be read is, and what cannot is said, all at once.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::Arc,
};

use glam::{DVec2, DVec3};
use strandflow_core::FrameRange;
use strandflow_engine::{
    EngineError, Manifest, Take,
    footage::numbered_images,
    sources::{most_common, read_rig},
};
use strandflow_io::{IoError, SourceInfo, TakeSource, ViewInput};

use crate::{Evidence, Finding, calibration::MARKERS_NEEDED, evidence::ViewEvidence, labels::Label};

/// The evidence of a take whose files may be wrong in any way.
///
/// # Errors
/// The manifest is not there or not readable; everything else is among [`Evidence::trouble`].
pub fn of_folder(root: &Path) -> Result<Evidence, EngineError> {
    let manifest = Manifest::read(root)?;
    let mut trouble = Vec::new();
    let rig = read_rig(root, &manifest).map_err(|error| trouble.push(of_calibration(&error))).ok();
    let mut views = Vec::new();
    for stated in &manifest.views {
        let camera = rig.as_ref().and_then(|rig| rig.cameras.get(views.len()));
        let size = camera.map(|camera| (camera.width, camera.height));
        let mut view = ViewEvidence {
            name: stated.name.clone(),
            held_out: manifest.held_out.contains(&stated.name),
            info: None,
            source: None,
            plate: None,
            hair: None,
            subjects: given(&manifest, root, &stated.name, &mut trouble),
        };
        let input = ViewInput::of(&root.join(&stated.source));
        match TakeSource::open(&[(stated.name.clone(), input.clone())]) {
            Ok(source) => {
                view.info = source.infos().first().copied();
                view.source = Some(source);
            }
            Err(error) => trouble.push(of_io("footage", &stated.name, &error)),
        }
        trouble.extend(
            view.info
                .zip(size)
                .and_then(|(info, size)| wrong_size("footage", &stated.name, (info.width, info.height), size)),
        );
        match strandflow_io::read_rgb(&root.join(&stated.plate)) {
            Ok(plate) => {
                // A plate of the footage's size shares its fault, and that is said.
                let (shape, like) = ((plate.width, plate.height), view.info.map(|info| (info.width, info.height)));
                let size = size.filter(|_| like != Some(shape));
                trouble.extend(size.and_then(|size| wrong_size("clean plate", &stated.name, shape, size)));
                view.plate = Some(Arc::new(plate));
            }
            Err(error) => trouble.push(of_io("clean plate", &stated.name, &error)),
        }
        views.push(view);
    }
    let frames = frames_of(&manifest, &views, &mut trouble);
    trouble.extend(of_rates(&manifest, &views));
    for view in &mut views {
        let folder = root.join(&manifest.labels.hair_masks).join(&view.name);
        read_hair(view, &folder, frames.start, &mut trouble);
    }
    let (labelled, labels) = read_labels(&root.join(&manifest.labels.markers), &views, frames, &mut trouble);
    let mut evidence = Evidence {
        root: root.to_owned(),
        mended: rig.clone().unwrap_or_default(),
        rig,
        distrusted: Vec::new(),
        mended_roughly: Vec::new(),
        fps: manifest.fps,
        gravity: DVec3::from_array(manifest.gravity),
        settings: manifest.settings.clone(),
        views,
        labelled,
        labels,
        frames,
        trouble,
        followed: Vec::new(),
        out_of_time: Vec::new(),
        sampled: Vec::new(),
        hull: None,
    };
    evidence.trouble.extend(refused(&evidence));
    Ok(evidence)
}

/// The evidence of a take that could be opened, for the checks that decode no image.
///
/// # Errors
/// Labels or first hair masks cannot be read.
pub fn of_take(take: &Take) -> Result<Evidence, EngineError> {
    let frames = take.frames();
    let rig = take.rig().clone();
    let names = rig.cameras.iter().enumerate();
    let view = |(at, camera): (usize, &strandflow_core::Camera)| {
        let info = SourceInfo { width: camera.width, height: camera.height, frame_count: frames.end, fps: None };
        let held_out = take.views().held_out().contains(&at);
        let hair = take.given_hair(at, frames.start)?;
        Ok(ViewEvidence {
            name: camera.name.clone(),
            held_out,
            info: Some(info),
            source: None,
            plate: None,
            hair,
            subjects: BTreeMap::new(),
        })
    };
    let views = names.map(view).collect::<Result<Vec<_>, EngineError>>()?;
    let labels = take.sources().labels(&rig)?;
    let points =
        |views: BTreeMap<usize, [f64; 2]>| views.into_iter().map(|(view, at)| (view, DVec2::from_array(at))).collect();
    Ok(Evidence {
        root: take.root().to_owned(),
        mended: rig.clone(),
        rig: Some(rig),
        distrusted: Vec::new(),
        mended_roughly: Vec::new(),
        fps: take.manifest().fps,
        gravity: take.gravity(),
        settings: take.manifest().settings.clone(),
        views,
        labelled: labels.frame,
        labels: labels.markers.into_iter().map(|(id, views)| Label { id, views: points(views) }).collect(),
        frames,
        trouble: Vec::new(),
        followed: Vec::new(),
        out_of_time: Vec::new(),
        sampled: Vec::new(),
        hull: None,
    })
}

/// The subject masks given for a view.
fn given(manifest: &Manifest, root: &Path, view: &str, trouble: &mut Vec<Finding>) -> BTreeMap<usize, PathBuf> {
    let Some(folder) = &manifest.labels.subject_masks else { return BTreeMap::new() };
    numbered_images(&root.join(folder).join(view)).unwrap_or_else(|error| {
        let finding = Finding::cannot("unreadable", format!("view {view}"), error.to_string());
        trouble.push(finding.suffers("masks: nothing runs").hint(error.hint()));
        BTreeMap::new()
    })
}

/// What a run would refuse that nothing here has found.
fn refused(evidence: &Evidence) -> Option<Finding> {
    let few = evidence.labels.iter().filter(|label| label.views.len() >= 2).count() < MARKERS_NEEDED;
    if few || evidence.trouble.iter().any(|finding| finding.verdict == crate::Verdict::CannotWork) {
        return None;
    }
    let error = Take::open(&evidence.root).err()?;
    Some(Finding::cannot("refused", "take", error.to_string()).suffers("masks: nothing runs").hint(error.hint()))
}

fn of_calibration(error: &EngineError) -> Finding {
    Finding::cannot("calibration-unreadable", "calibration", error.to_string())
        .suffers("masks: nothing runs")
        .hint(error.hint())
}

fn of_io(what: &str, view: &str, error: &IoError) -> Finding {
    let fact = format!("the {what} cannot be used: {error}");
    Finding::cannot("unreadable", format!("view {view}"), fact).suffers("masks: nothing runs").hint(error.hint())
}

fn wrong_size(what: &str, view: &str, (w, h): (usize, usize), (cw, ch): (usize, usize)) -> Option<Finding> {
    if (w, h) == (cw, ch) {
        return None;
    }
    let fact = format!("the {what} is {w}×{h}, the camera is calibrated for {cw}×{ch}");
    let (sx, sy) = (w as f64 / cw as f64, h as f64 / ch as f64);
    let hint = if (sx - sy).abs() < 0.01 * sx {
        format!("all of it is scaled by {sx:.3}: scale fx, fy, cx, cy by that, or give footage of the calibrated size")
    } else if (w, h) == (ch, cw) {
        "width and height are exchanged: one of them is turned by 90°".into()
    } else {
        "the footage was cut or scaled unevenly: give it as it was when calibrated, or calibrate for it".into()
    };
    Some(Finding::cannot("image-size", format!("view {view}"), fact).suffers("masks: nothing runs").hint(hint))
}

/// The frames that all views have; says where they differ.
fn frames_of(manifest: &Manifest, views: &[ViewEvidence], trouble: &mut Vec<Finding>) -> FrameRange {
    let counts: Vec<usize> = views.iter().filter_map(|view| Some(view.info?.frame_count)).collect();
    let shortest = counts.iter().copied().min().unwrap_or(0);
    let stated = manifest.frames.as_ref().and_then(|text| text.parse::<FrameRange>().ok());
    let wanted = stated.map_or_else(|| most_common(&counts), |range| range.end);
    for view in views {
        let Some(count) = view.info.map(|info| info.frame_count) else { continue };
        if count < wanted || (stated.is_none() && count != wanted) {
            let fact = match stated {
                Some(range) => format!("has {count} frames, the manifest asks for {range}"),
                None => format!("has {count} frames, the others {wanted}"),
            };
            let finding = Finding::cannot("frame-count", format!("view {}", view.name), fact)
                .suffers("masks: nothing runs")
                .hint("did the camera lose frames, or start or stop at another time? Cut the clips to the same moments; `frames = \"A..B\"` in the manifest takes a part");
            trouble.push(finding);
        }
    }
    let start = stated.map_or(0, |range| range.start);
    FrameRange { start, end: wanted.min(shortest).max(start) }
}

/// Clips whose rate is not the manifest's.
fn of_rates(manifest: &Manifest, views: &[ViewEvidence]) -> Option<Finding> {
    let other = |view: &&ViewEvidence| {
        let fps = view.info.and_then(|info| info.fps);
        fps.is_some_and(|fps| (fps - manifest.fps).abs() > 0.01 * manifest.fps)
    };
    let others: Vec<&ViewEvidence> = views.iter().filter(other).collect();
    let rate = others.first()?.info?.fps?;
    let names: Vec<&str> = others.iter().map(|view| view.name.as_str()).collect();
    let place = if others.len() == views.len() { "all views".into() } else { format!("view {}", names.join(" and ")) };
    let fact = format!("the clips say {rate:.2} frames a second, the manifest {}", manifest.fps);
    let hint = "right where the clips are slow motion; else correct `fps` in the manifest";
    Some(Finding::look("frame-rate", place, fact).suffers("fit: stiffness goes with the square of the rate").hint(hint))
}

fn read_hair(view: &mut ViewEvidence, folder: &Path, first: usize, trouble: &mut Vec<Finding>) {
    let files = numbered_images(folder).unwrap_or_default();
    let place = format!("view {}, frame {first}", view.name);
    let Some(file) = files.get(&first) else {
        let fact = format!("there is no hair mask of the take's first frame in {}", folder.display());
        let hint = format!("paint one and save it as {}/{first:06}.png in the folder of hair masks", view.name);
        trouble.push(Finding::cannot("no-hair-mask", place, fact).suffers("masks: nothing runs").hint(hint));
        return;
    };
    match strandflow_io::read_mask(file) {
        Ok(mask) => {
            let size = view.info.map(|info| (info.width, info.height));
            trouble.extend(size.and_then(|size| mask_size(&view.name, (mask.width, mask.height), size)));
            view.hair = Some(mask);
        }
        Err(error) => trouble.push(of_io("hair mask", &view.name, &error)),
    }
}

fn mask_size(view: &str, (w, h): (usize, usize), (iw, ih): (usize, usize)) -> Option<Finding> {
    let fact = format!("the hair mask is {w}×{h}, the footage {iw}×{ih}");
    let finding = Finding::cannot("mask-size", format!("view {view}"), fact).suffers("masks: nothing runs");
    ((w, h) != (iw, ih)).then(|| finding.hint("save masks at the size of the footage"))
}

/// The frame that tracks begin from, and its labels. Where no frame of the take has enough, those of the one with the most.
fn read_labels(
    file: &Path,
    views: &[ViewEvidence],
    frames: FrameRange,
    trouble: &mut Vec<Finding>,
) -> (usize, Vec<Label>) {
    let cannot = |fault, fact: String, hint: &str| {
        Finding::cannot(fault, "labels", fact).suffers("pose: no head pose in any frame").hint(hint)
    };
    let labels = match strandflow_io::read_marker_labels(file) {
        Ok(labels) => labels,
        Err(error) => {
            trouble.push(cannot("labels-unreadable", error.to_string(), &error.hint()));
            return (frames.start, Vec::new());
        }
    };
    let place = |name: &str| views.iter().position(|view| view.name == name);
    let with = |inside: bool| {
        let takes_part = |view: &str| place(view).is_some_and(|view| !views[view].held_out);
        labels.first_with(MARKERS_NEEDED, |frame| frames.contains(frame) == inside, takes_part)
    };
    let labelled = match (with(true), with(false)) {
        (Ok(frame), _) => frame,
        (Err(_), Ok(outside)) => {
            let fact = format!("the markers are labelled in frame {outside}, the take has the frames {frames}");
            let hint =
                "label them in a frame of the take (any one will do), or let `frames` of the manifest reach there";
            trouble.push(cannot("labels-frame", fact, hint));
            outside
        }
        (Err((most, _)), Err(_)) => most,
    };
    let mut found = Vec::new();
    let markers = labels.by_frame().remove(&labelled).unwrap_or_default();
    for marker in markers {
        let mut label = Label { id: marker.id, views: Default::default() };
        for (name, &at) in &marker.views {
            let Some(view) = place(name) else { continue };
            let at = DVec2::from_array(at);
            if let Some(info) = views[view].info
                && !(at.x >= 0.0 && at.y >= 0.0 && at.x <= info.width as f64 && at.y <= info.height as f64)
            {
                let fact = format!(
                    "marker {} is labelled at ({:.0}, {:.0}) in view {name}, outside the image of {}×{}",
                    marker.id, at.x, at.y, info.width, info.height
                );
                trouble.push(cannot(
                    "label-outside",
                    fact,
                    "label it where the view shows it, in pixels of the footage",
                ));
                continue;
            }
            label.views.insert(view, at);
        }
        found.push(label);
    }
    (labelled, found)
}
