//! A take on disk, opened: manifest, rig, images, results.

use std::path::{Path, PathBuf};

use glam::DVec3;
use strandflow_core::{FrameRange, ImageSource, Mask, RgbImage, Rig};
use strandflow_stages::Mode;

use crate::{
    EngineError, Manifest, Plan, disk, item::BLOCK_STRANDS, needs::Identities, rooms::field::HeadShape,
    rooms::masks::Looks, rooms::pose::KnownMotion, sources::Sources, store::Store, views::Views,
};

/// Name of the results store within a take.
pub const RESULTS: &str = "results.zarr";
/// Name of the log of runs within a take: one line of JSON an event.
pub const RUN_LOG: &str = "run.log";
/// Folder within a take of what belongs to a farm: scripts, jobs, output and logs of tasks.
pub const FARM: &str = "farm";
/// Folder within a take of the logs that tasks of a farm write instead, one a node.
pub const TASK_LOGS: &str = "farm/logs";
/// Folder within a take of what those tasks say.
pub const TASK_OUTPUT: &str = "farm/output";
/// Name of the resolved plan within a take.
pub const RESOLVED: &str = "resolved.toml";

/// A take on disk.
pub struct Take {
    root: PathBuf,
    manifest: Manifest,
    rig: Rig,
    views: Views,
    store: Store,
    sources: Sources,
    identities: Identities,
    looks: Looks,
    head: HeadShape,
    head_motion: KnownMotion,
}

impl Take {
    /// Opens a take: reads and checks manifest and calibration; looks for every file, but decodes no image.
    ///
    /// # Errors
    /// `Input` for anything that the user has to put right.
    pub fn open(root: &Path) -> Result<Self, EngineError> {
        let manifest = Manifest::read(root)?;
        let rig = crate::sources::read_rig(root, &manifest)?;
        let views = Views::of(&manifest, &rig)?;
        let sources = Sources::open(root, &manifest, &rig, &views)?;
        let store = Store::open(&root.join(RESULTS))?;
        let (identities, looks) = (Identities::default(), Looks::default());
        Ok(Self {
            root: root.to_owned(),
            manifest,
            rig,
            views,
            store,
            sources,
            identities,
            looks,
            head: HeadShape::default(),
            head_motion: KnownMotion::default(),
        })
    }

    /// The take's folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// What the user stated.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The cameras, in the order of the views.
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Which views take part, and which are held out.
    pub fn views(&self) -> &Views {
        &self.views
    }

    /// The results.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// The scalp as a distance.
    pub(crate) fn head_shape(&self) -> &HeadShape {
        &self.head
    }

    /// The head's motion, as it was read last.
    pub(crate) fn head_motion(&self) -> &KnownMotion {
        &self.head_motion
    }

    /// Gravity \[mm/s²\], world.
    pub fn gravity(&self) -> DVec3 {
        DVec3::from_array(self.manifest.gravity)
    }

    /// Frame interval \[s\].
    pub fn frame_secs(&self) -> f64 {
        1.0 / self.manifest.fps
    }

    /// All frames of the take.
    pub fn frames(&self) -> FrameRange {
        self.sources.frames()
    }

    /// The plan of a run with what the command line asks for.
    ///
    /// # Errors
    /// `Input` where the frames are not in the take.
    pub fn plan(&self, mode: Option<Mode>, frames: Option<FrameRange>) -> Result<Plan, EngineError> {
        Plan::new(&self.manifest, self.frames(), mode, frames)
    }

    /// The plan of the last run; the manifest's where there was none.
    ///
    /// # Errors
    /// `Input` where `resolved.toml` is not readable and the manifest gives no plan.
    pub fn last_plan(&self) -> Result<Plan, EngineError> {
        let plan = self.plan(None, None)?;
        let Some(last) = Plan::of_last_run(&self.root) else { return Ok(plan) };
        let inside = last.frames.start >= plan.frames.start && last.frames.end <= plan.frames.end;
        self.plan(Some(last.mode), inside.then_some(last.frames))
    }

    /// Writes the plan beside the results, unless it stands there already: the tasks of a farm need not write it anew.
    ///
    /// # Errors
    /// `Disk`.
    pub fn write_resolved(&self, plan: &Plan) -> Result<(), EngineError> {
        let path = self.root.join(RESOLVED);
        let text = toml::to_string_pretty(plan).map_err(|error| EngineError::disk(&path, error))?;
        let text = format!("# Written by `strandflow run`: all settings as they were used.\n{text}");
        if disk::read_text(&path).is_ok_and(|present| present == text) {
            return Ok(());
        }
        self.store.put(&path, text.as_bytes())
    }

    /// All images.
    pub fn images(&self) -> &dyn ImageSource {
        self.sources.images()
    }

    /// The view without the subject.
    ///
    /// # Errors
    /// `Input` where it cannot be read or has another size than the camera.
    pub fn plate(&self, view: usize) -> Result<std::sync::Arc<RgbImage>, EngineError> {
        self.sources.plate(view, &self.rig)
    }

    /// The user's files.
    pub fn sources(&self) -> &Sources {
        &self.sources
    }

    /// The hair mask that the user gave for a frame, if any.
    ///
    /// # Errors
    /// `Input` where it cannot be read or has another size than the camera.
    pub fn given_hair(&self, view: usize, frame: usize) -> Result<Option<Mask>, EngineError> {
        self.sources.given_mask(self.sources.hair_file(view, frame), view, frame, &self.rig)
    }

    /// The subject mask that the user gave for a frame, if any.
    ///
    /// # Errors
    /// As [`Take::given_hair`].
    pub fn given_subject(&self, view: usize, frame: usize) -> Result<Option<Mask>, EngineError> {
        self.sources.given_mask(self.sources.subject_file(view, frame), view, frame, &self.rig)
    }

    pub(crate) fn looks(&self) -> &Looks {
        &self.looks
    }

    pub(crate) fn identities(&self) -> &Identities {
        &self.identities
    }

    /// N, the strands of the take, known once `scalp` is done.
    ///
    /// # Errors
    /// `Missing` before that.
    pub fn strand_count(&self) -> Result<usize, EngineError> {
        let missing = |_| EngineError::Missing { item: "scalp/scalp/take".into() };
        self.store
            .finished("scalp/scalp/take")?
            .ok_or_else(|| EngineError::Missing { item: "scalp/scalp/take".into() })?;
        Ok(self.store.shape("scalp/roots").map_err(missing)?[0])
    }

    /// Blocks of strands.
    ///
    /// # Errors
    /// As [`Take::strand_count`].
    pub fn block_count(&self) -> Result<usize, EngineError> {
        Ok(self.strand_count()?.div_ceil(BLOCK_STRANDS))
    }
}
