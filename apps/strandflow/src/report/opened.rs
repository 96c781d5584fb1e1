//! A take opened as far as it goes: without footage its results can still be read, without results its manifest.

use std::path::{Path, PathBuf};

use strandflow_core::{FrameRange, Rig};
use strandflow_engine::{EngineError, Item, Manifest, Plan, Take, sources::read_rig, store::Store, take::RESULTS};

use crate::failure::Failed;

/// What there is of a take.
pub struct Opened {
    root: PathBuf,
    manifest: Manifest,
    last_run: Option<Plan>,
    store: Option<Store>,
    rig: Option<Rig>,
    whole: Result<Take, EngineError>,
}

impl Opened {
    /// Opens a take; changes nothing in it.
    ///
    /// # Errors
    /// Bad input where there is no manifest or it cannot be read.
    pub fn open(root: &Path) -> Result<Self, Failed> {
        let manifest = Manifest::read(root)?;
        let last_run = Plan::of_last_run(root);
        let folder = root.join(RESULTS);
        // Opening a store or a whole take would make the folder.
        let store = folder.is_dir().then(|| Store::open(&folder)).transpose()?;
        let whole = match store {
            Some(_) => Take::open(root),
            None => Err(EngineError::Missing { item: RESULTS.into() }),
        };
        let rig = read_rig(root, &manifest).ok();
        Ok(Self { root: root.to_owned(), manifest, last_run, store, rig, whole })
    }

    /// The take's folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The folder's name.
    pub fn name(&self) -> String {
        super::last_part(&self.root)
    }

    /// What the user stated.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The plan of the last run.
    pub fn last_run(&self) -> Option<&Plan> {
        self.last_run.as_ref()
    }

    /// The frames of the last run.
    pub fn frames(&self) -> Option<FrameRange> {
        self.last_run.as_ref().map(|plan| plan.frames)
    }

    /// The results, where there are any.
    pub fn store(&self) -> Option<&Store> {
        self.store.as_ref()
    }

    /// The cameras, where the calibration can be read.
    pub fn rig(&self) -> Option<&Rig> {
        self.rig.as_ref()
    }

    /// The take with its footage, or why it cannot be opened.
    pub fn whole(&self) -> Result<&Take, &EngineError> {
        self.whole.as_ref()
    }

    /// Whether a frame of a stage of strands is there.
    pub fn has_strands(&self, stage: &str, frame: usize) -> bool {
        let Some(store) = &self.store else { return false };
        match stage {
            "smooth" => !store.items_of("smooth/trim").is_empty(),
            "fit" => store.record(&Item::Block(0).key("fit/fit")).is_some(),
            _ => store.record(&Item::Frame(frame).key("blend/blend")).is_some(),
        }
    }

    /// The last stage of strands that a frame has.
    pub fn last_strands(&self, frame: usize) -> Option<&'static str> {
        ["blend", "fit", "smooth"].into_iter().find(|stage| self.has_strands(stage, frame))
    }
}
