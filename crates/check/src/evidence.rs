//! What the checks look at.

use std::{collections::BTreeMap, path::PathBuf, sync::Arc};

use glam::DVec3;
use strandflow_core::{FrameRange, ImageSource, Mask, Occupancy, RgbImage, Rig, SourceError};
use strandflow_engine::Settings;
use strandflow_io::{SourceInfo, TakeSource};

use crate::{Finding, Verdict, follow::Followed, labels::Label};

/// What one view brings. What could not be read is `None`, and said among [`Evidence::trouble`].
pub struct ViewEvidence {
    /// Its name.
    pub name: String,
    /// Whether it is held out.
    pub held_out: bool,
    /// Size, length and rate of its footage.
    pub info: Option<SourceInfo>,
    /// Its footage.
    pub source: Option<TakeSource>,
    /// The view without the subject.
    pub plate: Option<Arc<RgbImage>>,
    /// The hair mask given for the first frame.
    pub hair: Option<Mask>,
    /// Files of subject masks given by frame.
    pub subjects: BTreeMap<usize, PathBuf>,
}

impl ViewEvidence {
    /// The subject mask given for a frame, where it can be read.
    pub fn given_subject(&self, frame: usize) -> Option<Mask> {
        strandflow_io::read_mask(self.subjects.get(&frame)?).ok()
    }
}

/// The subject mask of a view and frame.
pub struct Sampled {
    /// The view.
    pub view: usize,
    /// The frame.
    pub frame: usize,
    /// Its subject mask.
    pub subject: Mask,
}

/// Everything the checks look at, and what the earlier ones leave for the later.
pub struct Evidence {
    /// The take's folder.
    pub root: PathBuf,
    /// The cameras as given; `None` where the calibration could not be read.
    pub rig: Option<Rig>,
    /// The cameras as far as `calibration` could mend them.
    pub mended: Rig,
    /// Views whose calibration is wrong and could not be mended: later checks leave them out.
    pub distrusted: Vec<usize>,
    /// Views whose calibration could be mended in part: it shows what was wrong, and pixels are left.
    pub mended_roughly: Vec<usize>,
    /// Frames per second.
    pub fps: f64,
    /// Gravity \[mm/s²\].
    pub gravity: DVec3,
    /// The settings of the stages.
    pub settings: Settings,
    /// The views, in the order of the rig.
    pub views: Vec<ViewEvidence>,
    /// The frame that tracks begin from: the first with enough labels.
    pub labelled: usize,
    /// The markers labelled there.
    pub labels: Vec<Label>,
    /// Frames that all views have.
    pub frames: FrameRange,
    /// What was wrong with the files.
    pub trouble: Vec<Finding>,
    /// Markers followed in every view over the frames that `time` looks at.
    pub followed: Vec<Followed>,
    /// Views that `time` found out of step.
    pub out_of_time: Vec<usize>,
    /// Subject masks of a few frames, made by `masks`.
    pub sampled: Vec<Sampled>,
    /// The hull of the first frame in coarse voxels, on a grid that holds those of all, made by `hull`.
    pub hull: Option<Occupancy>,
}

/// How far from its ball's centre a label may lie, in radii of the marker: `pose` moves labels by as much.
const LABEL_RADII: f64 = 0.6;

impl Evidence {
    /// The name of a view.
    pub fn name(&self, view: usize) -> &str {
        &self.views[view].name
    }

    /// Names of views, `cam02 and cam05`.
    pub fn names(&self, views: &[usize]) -> String {
        views.iter().map(|&view| self.name(view)).collect::<Vec<_>>().join(" and ")
    }

    /// A finding about views; where all of them are held out a run goes through, for no stage from `hull` on looks at them.
    pub fn unless_held_out(&self, views: &[usize], mut finding: Finding) -> Finding {
        if views.iter().all(|&view| self.views[view].held_out) {
            finding.verdict = Verdict::LookAtThis;
            finding.suffers = "evaluate: the view that judges is wrong";
        }
        finding
    }

    /// How far labels may lie from where the views that agree have their marker \[px\]. Stage `pose` measures the ball around
    /// a label, which people click anywhere on it.
    pub fn label_tolerance(&self) -> f64 {
        let pose = &self.settings.pose;
        pose.inlier_px.max(LABEL_RADII * pose.marker_radius_px)
    }

    /// Whether the footage of a view has the size its camera is calibrated for.
    pub fn fits(&self, view: usize) -> bool {
        let camera = self.mended.cameras.get(view);
        camera.zip(self.views[view].info).is_some_and(|(c, i)| (c.width, c.height) == (i.width, i.height))
    }

    /// The image of a view and frame, where there is one.
    pub fn image(&self, view: usize, frame: usize) -> Option<Arc<RgbImage>> {
        let seen: Result<_, SourceError> = self.views[view].source.as_ref()?.image(0, frame);
        seen.ok()
    }
}
