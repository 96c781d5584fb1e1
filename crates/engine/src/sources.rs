//! The user's files: where they are, and that they fit the rig.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::Arc,
};

use strandflow_core::{FrameRange, ImageSource, Mask, RgbImage, Rig};
use strandflow_io::{IoError, LabelledMarker, MarkerLabels, TakeSource, ViewInput};

use crate::{
    EngineError, Manifest, Views,
    footage::{ViewFiles, numbered_images},
};

/// A labelled marker: its number, and its image points by view index.
pub type NumberedMarker = (u32, BTreeMap<usize, [f64; 2]>);

/// The markers of a take, as a person labelled them.
#[derive(Clone, Debug, PartialEq)]
pub struct TakeLabels {
    /// The frame that tracks begin from: the first in which five markers are labelled in two views or more.
    pub frame: usize,
    /// All markers by rising number, with their labels in that frame; those that begin in another one have none there.
    pub markers: Vec<NumberedMarker>,
    /// Labels in other frames of the take.
    pub corrections: BTreeMap<usize, Vec<NumberedMarker>>,
}

/// Markers, each in two views or more, that the labels of one frame must have.
pub const MARKERS_NEEDED: usize = 5;

impl From<IoError> for EngineError {
    fn from(error: IoError) -> Self {
        if error.is_shortage() {
            return Self::disk(error.file(), error.fact());
        }
        Self::Input { subject: error.place(), fact: error.fact(), hint: error.hint() }
    }
}

/// Reads the calibration and picks the cameras of the views, in their order.
///
/// # Errors
/// `Input` where it cannot be read or a view has no camera.
pub fn read_rig(root: &Path, manifest: &Manifest) -> Result<Rig, EngineError> {
    let path = root.join(&manifest.calibration.file);
    let calibration = strandflow_io::read_calibration(&path, manifest.calibration.unit_mm)?;
    let names: Vec<String> = manifest.views.iter().map(|view| view.name.clone()).collect();
    Ok(strandflow_io::rig_for_views(&path, &calibration.rig, &names)?)
}

/// The files of a take, found.
pub struct Sources {
    images: TakeSource,
    files: Vec<ViewFiles>,
    names: Vec<String>,
    plates: Vec<PathBuf>,
    labels: PathBuf,
    hairs: Vec<BTreeMap<usize, PathBuf>>,
    subjects: Vec<BTreeMap<usize, PathBuf>>,
    frames: FrameRange,
}

impl Sources {
    /// Finds all files that the manifest names.
    ///
    /// # Errors
    /// `Input` where one is missing, a clip has another length or size than the others, or masks are of no view.
    pub fn open(root: &Path, manifest: &Manifest, rig: &Rig, views: &Views) -> Result<Self, EngineError> {
        let names: Vec<String> = manifest.views.iter().map(|view| view.name.clone()).collect();
        let inputs: Vec<(String, ViewInput)> =
            manifest.views.iter().map(|view| (view.name.clone(), ViewInput::of(&root.join(&view.source)))).collect();
        let files = inputs.iter().map(|(name, input)| ViewFiles::open(name, input)).collect::<Result<Vec<_>, _>>()?;
        let images = TakeSource::open(&inputs)?;
        let frames = frames_of(manifest, &images, &files, rig)?;
        let plates: Vec<PathBuf> = manifest.views.iter().map(|view| root.join(&view.plate)).collect();
        for (view, plate) in names.iter().zip(&plates) {
            must_exist(plate, view, "clean plate", "check the path in the manifest")?;
        }
        let labels = root.join(&manifest.labels.markers);
        let hint = "label markers with `strandflow annotate TAKE`, or check the path in the manifest";
        must_exist(&labels, "all", "file of marker labels", hint)?;
        let hairs = masks_in(&root.join(&manifest.labels.hair_masks), &names)?;
        let subjects = match &manifest.labels.subject_masks {
            Some(folder) => masks_in(&root.join(folder), &names)?,
            None => vec![BTreeMap::new(); names.len()],
        };
        let sources = Self { images, files, names, plates, labels, hairs, subjects, frames };
        // Labels are read again by the stage; looked at now, so that hours of masks do not come before the error.
        sources.labels(views.rig())?;
        sources.must_begin_with_hair(frames.start)?;
        Ok(sources)
    }

    /// All frames of the take.
    pub fn frames(&self) -> FrameRange {
        self.frames
    }

    /// All images.
    pub fn images(&self) -> &dyn ImageSource {
        &self.images
    }

    /// The file that holds a frame of a view.
    ///
    /// # Errors
    /// `Input` where the frame is missing.
    pub fn image_file(&self, view: usize, frame: usize) -> Result<PathBuf, EngineError> {
        Ok(self.files[view].file(frame)?.to_owned())
    }

    /// The file of a clean plate.
    pub fn plate_file(&self, view: usize) -> &Path {
        &self.plates[view]
    }

    /// A clean plate.
    ///
    /// # Errors
    /// `Input` where it cannot be read or has another size than the camera.
    pub fn plate(&self, view: usize, rig: &Rig) -> Result<Arc<RgbImage>, EngineError> {
        let image = strandflow_io::read_rgb(&self.plates[view]).map_err(|error| self.of_view(error, view))?;
        self.must_fit((image.width, image.height), &self.plates[view], view, rig)?;
        Ok(Arc::new(image))
    }

    /// The file of marker labels.
    pub fn labels_file(&self) -> &Path {
        &self.labels
    }

    /// The labels of the take's frames, by view index in `rig`. Labels of frames that the take leaves out are of no use, and
    /// of no harm.
    ///
    /// # Errors
    /// `Input` where the file cannot be read, no frame of the take has five markers labelled in two views of `rig`, or a point
    /// is outside its view.
    pub fn labels(&self, rig: &Rig) -> Result<TakeLabels, EngineError> {
        let labels = strandflow_io::read_marker_labels(&self.labels)?;
        let takes_part = |view: &str| rig.view_named(view).is_some();
        let frame = labels
            .first_with(MARKERS_NEEDED, |frame| self.frames.contains(frame), takes_part)
            .map_err(|most| self.too_few_labels(&labels, most))?;
        let mut corrections = BTreeMap::new();
        for (frame, markers) in labels.by_frame().into_iter().filter(|(frame, _)| self.frames.contains(*frame)) {
            corrections.insert(frame, self.in_views(markers.to_vec(), frame, rig)?);
        }
        let mut all: BTreeMap<u32, BTreeMap<usize, [f64; 2]>> =
            labels.markers.iter().map(|marker| (marker.id, BTreeMap::new())).collect();
        all.extend(corrections.values().flatten().map(|(id, _)| (*id, BTreeMap::new())));
        all.extend(corrections.remove(&frame).into_iter().flatten());
        Ok(TakeLabels { frame, markers: all.into_iter().collect(), corrections })
    }

    /// Of labels of which no frame of the take has enough; `most` is the one with the most markers, and how many.
    fn too_few_labels(&self, labels: &MarkerLabels, most: (usize, usize)) -> EngineError {
        let (name, (frame, usable)) = (self.labels.display().to_string(), most);
        let outside = labels.first_with(MARKERS_NEEDED, |frame| !self.frames.contains(frame), |_| true);
        if let Ok(outside) = outside {
            let fact = format!("the markers are labelled in frame {outside}, the take has the frames {}", self.frames);
            let hint = "label five markers in a frame of the take (any one will do), or let `frames` of the manifest reach there";
            return EngineError::input(name, fact, hint);
        }
        let fact = format!(
            "frame {frame}: {usable} markers are labelled in two or more views, at least {MARKERS_NEEDED} are needed in one frame"
        );
        EngineError::input(
            name,
            fact,
            "label more markers there, each in every view that sees it: `strandflow annotate TAKE`",
        )
    }

    /// Markers by the index of the view, each within its image.
    fn in_views(
        &self,
        markers: Vec<LabelledMarker>,
        frame: usize,
        rig: &Rig,
    ) -> Result<Vec<NumberedMarker>, EngineError> {
        let name = self.labels.display();
        let mut found = Vec::new();
        for marker in markers {
            let mut views = BTreeMap::new();
            for (view, point) in marker.views {
                // Labels of views that the take leaves out are of no use, and of no harm.
                let Some(at) = rig.view_named(&view) else { continue };
                let camera = &rig.cameras[at];
                if !in_image(point, [camera.width, camera.height]) {
                    let size = format!("{}×{}", camera.width, camera.height);
                    let fact = format!("marker {} is at {point:?}, outside the image of {size} pixels", marker.id);
                    let hint =
                        "label it where the view shows it, in pixels of the footage; leave out views that do not";
                    return Err(EngineError::input(format!("{name}, view {view}, frame {frame}"), fact, hint));
                }
                views.insert(at, point);
            }
            found.push((marker.id, views));
        }
        Ok(found)
    }

    fn must_begin_with_hair(&self, first: usize) -> Result<(), EngineError> {
        match (0..self.names.len()).find(|&view| self.hair_file(view, first).is_none()) {
            None => Ok(()),
            Some(view) => Err(EngineError::input(
                format!("view {}, frame {first}", self.names[view]),
                "there is no hair mask of the take's first frame",
                format!(
                    "paint one with `strandflow annotate TAKE`, or save it as {}/{first:06}.png in the folder of hair masks",
                    self.names[view]
                ),
            )),
        }
    }

    /// All hair masks that the user gave of a view, by frame.
    pub fn hair_files(&self, view: usize) -> &BTreeMap<usize, PathBuf> {
        &self.hairs[view]
    }

    /// The hair mask the user gave for a frame.
    pub fn hair_file(&self, view: usize, frame: usize) -> Option<PathBuf> {
        self.hairs[view].get(&frame).cloned()
    }

    /// The subject mask the user gave for a frame.
    pub fn subject_file(&self, view: usize, frame: usize) -> Option<PathBuf> {
        self.subjects[view].get(&frame).cloned()
    }

    pub(crate) fn given_mask(
        &self,
        file: Option<PathBuf>,
        view: usize,
        frame: usize,
        rig: &Rig,
    ) -> Result<Option<Mask>, EngineError> {
        let Some(file) = file else { return Ok(None) };
        let in_frame = |error: EngineError| error.about(&format!("frame {frame}"));
        let mask = strandflow_io::read_mask(&file).map_err(|error| in_frame(self.of_view(error, view)))?;
        self.must_fit((mask.width, mask.height), &file, view, rig).map_err(in_frame)?;
        Ok(Some(mask))
    }

    /// The error of a view's file, with the view.
    fn of_view(&self, error: IoError, view: usize) -> EngineError {
        EngineError::from(error).about(&format!("view {}", self.names[view]))
    }

    fn must_fit(&self, (w, h): (usize, usize), file: &Path, view: usize, rig: &Rig) -> Result<(), EngineError> {
        let camera = &rig.cameras[view];
        if (w, h) == (camera.width, camera.height) {
            return Ok(());
        }
        let fact = format!("is {w}×{h}, the camera is calibrated for {}×{}", camera.width, camera.height);
        Err(EngineError::input(
            format!("{}, view {}", file.display(), self.names[view]),
            fact,
            "give an image of the calibrated size, or calibrate for this one",
        ))
    }
}

/// The frames of the take: the manifest's, or all. Without frames in the manifest every clip must have the same length.
fn frames_of(
    manifest: &Manifest,
    images: &TakeSource,
    files: &[ViewFiles],
    rig: &Rig,
) -> Result<FrameRange, EngineError> {
    let infos = images.infos();
    let stated = match &manifest.frames {
        Some(text) => {
            let range = text.parse::<FrameRange>();
            Some(range.map_err(|fact| EngineError::input("frames", fact, "write frames = \"A..B\""))?)
        }
        None => None,
    };
    let counts: Vec<usize> = infos.iter().map(|info| info.frame_count).collect();
    let frames = stated.unwrap_or(FrameRange { start: 0, end: most_common(&counts) });
    for (v, info) in infos.iter().enumerate() {
        let place =
            |frame: usize| format!("{}, view {}, frame {frame}", files[v].path().display(), rig.cameras[v].name);
        let camera = &rig.cameras[v];
        if (info.width, info.height) != (camera.width, camera.height) {
            let fact = format!(
                "is {}×{}, the camera is calibrated for {}×{}",
                info.width, info.height, camera.width, camera.height
            );
            let hint = "give the footage in the calibrated size, or calibrate for this one";
            return Err(EngineError::input(place(frames.start), fact, hint));
        }
        if info.frame_count < frames.end || (stated.is_none() && info.frame_count != frames.end) {
            let (first, others) =
                (files[v].first_number(), files.iter().map(ViewFiles::first_number).min().unwrap_or(0));
            if first > others {
                // Frame 0 is the lowest number of a folder: without its first images a view would be out of step.
                let fact = format!("the images begin at number {first}, those of other views at {others}");
                let hint = "copy the missing first images into the folder, or number the images of all views alike";
                return Err(EngineError::input(place(0), fact, hint));
            }
            let fact = format!("has {} frames, the take {}", info.frame_count, frames.end);
            let hint =
                "cut the clips to equal length, or give the frames that all have in the manifest: frames = \"A..B\"";
            return Err(EngineError::input(place(info.frame_count.min(frames.end)), fact, hint));
        }
        (frames.start..frames.end).try_for_each(|frame| files[v].file(frame).map(|_| ()))?;
    }
    Ok(frames)
}

/// The number that most have, the largest of several: the clip that differs is at fault, not the first in the list.
pub fn most_common(counts: &[usize]) -> usize {
    let times = |n: usize| counts.iter().filter(|count| **count == n).count();
    counts.iter().copied().max_by_key(|&n| (times(n), n)).unwrap_or(0)
}

fn in_image(point: [f64; 2], size: [usize; 2]) -> bool {
    point.iter().zip(size).all(|(x, side)| (0.0..=side as f64).contains(x))
}

fn must_exist(path: &Path, view: &str, what: &str, hint: &str) -> Result<(), EngineError> {
    if path.is_file() {
        return Ok(());
    }
    let subject = format!("{}, view {view}", path.display());
    Err(EngineError::input(subject, format!("the {what} is not there"), hint))
}

/// Masks of a folder `VIEW/FRAME.png`, by frame, one map a view.
fn masks_in(folder: &Path, names: &[String]) -> Result<Vec<BTreeMap<usize, PathBuf>>, EngineError> {
    if !folder.is_dir() {
        let subject = folder.display().to_string();
        let hint = "paint masks with `strandflow annotate TAKE`, or check the path in the manifest";
        return Err(EngineError::input(subject, "the folder of masks is not there", hint));
    }
    names.iter().map(|name| numbered_images(&folder.join(name))).collect()
}
