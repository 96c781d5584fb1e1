//! A take as far as it is there: without footage its results can be read, without results its footage.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use strandflow_core::{FrameRange, Rig};
use strandflow_engine::{EngineError, Manifest, Plan, manifest::View, sources::read_rig, store::Store, take::RESULTS};
use strandflow_io::{TakeSource, ViewInput};
use strandflow_view::{Refusal, describe::Note};

use super::truth::TruthFrames;
use crate::failure::Failed;

/// What is served. Changes nothing on disk; looks at results anew with every request, so that a run can be watched.
pub struct Source {
    root: PathBuf,
    manifest: Manifest,
    rig: Option<Rig>,
    /// By view; none where its files cannot be opened.
    footage: Vec<Option<TakeSource>>,
    truth: Option<TruthFrames>,
    notes: Vec<Note>,
}

impl Source {
    /// Opens a take and, where it is given, the truth of its capture.
    ///
    /// # Errors
    /// Bad input where there is no manifest, it cannot be read, or the truth cannot.
    pub fn open(root: &Path, truth: Option<&Path>) -> Result<Self, Failed> {
        let manifest = Manifest::read(root)?;
        let truth = truth.map(TruthFrames::open).transpose()?;
        let note = |error: EngineError| Note { fact: error.to_string(), hint: error.hint() };
        let rig = read_rig(root, &manifest).map_err(note);
        let open = |view: &View| {
            let input = ViewInput::of(&root.join(&view.source));
            TakeSource::open(&[(view.name.clone(), input)]).map_err(|error| note(error.into()))
        };
        // A video is looked at by a program of its own.
        let footage: Vec<Result<TakeSource, Note>> = manifest.views.par_iter().map(open).collect();
        let missing = rig.as_ref().err().into_iter().chain(footage.iter().filter_map(|view| view.as_ref().err()));
        let notes = missing.cloned().collect();
        let (rig, footage) = (rig.ok(), footage.into_iter().map(Result::ok).collect());
        Ok(Self { root: root.to_owned(), manifest, rig, footage, truth, notes })
    }

    /// The folder's name.
    pub fn name(&self) -> String {
        let whole = self.root.canonicalize().unwrap_or_else(|_| self.root.clone());
        whole.file_name().unwrap_or(whole.as_os_str()).to_string_lossy().into_owned()
    }

    /// What the user stated.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The cameras, where the calibration can be read.
    pub fn rig(&self) -> Option<&Rig> {
        self.rig.as_ref()
    }

    /// The files of a view, where they can be opened.
    pub fn footage(&self, view: usize) -> Option<&TakeSource> {
        self.footage.get(view)?.as_ref()
    }

    /// The truth, where it was given.
    pub fn truth(&self) -> Option<&TruthFrames> {
        self.truth.as_ref()
    }

    /// What was missing when the take was opened.
    pub fn notes(&self) -> &[Note] {
        &self.notes
    }

    /// The plan of the last run.
    pub fn plan(&self) -> Option<Plan> {
        Plan::of_last_run(&self.root)
    }

    /// The results, where there are any.
    ///
    /// # Errors
    /// There are none yet.
    pub fn store(&self) -> Result<Store, Refusal> {
        let folder = self.root.join(RESULTS);
        // Opening a store makes its folder; here nothing is made.
        if !folder.is_dir() {
            return Err(Refusal::missing("the take has no results yet", self.run_hint()));
        }
        Store::open(&folder).map_err(broken)
    }

    /// Frames of the last run; else of the manifest, of the footage, or none.
    pub fn frames(&self) -> FrameRange {
        let stated = || self.manifest.frames.as_deref().and_then(|text| text.parse::<FrameRange>().ok());
        let filmed = || {
            let counts = self.footage.iter().flatten().map(TakeSource::frame_count);
            FrameRange { start: 0, end: counts.min().unwrap_or(0) }
        };
        self.plan().map(|plan| plan.frames).or_else(stated).unwrap_or_else(filmed)
    }

    /// The take's first frame, with which the poses begin.
    pub fn begins(&self) -> usize {
        let stated = self.manifest.frames.as_deref().and_then(|text| text.parse::<FrameRange>().ok());
        self.plan().map(|plan| plan.lead.start).or(stated.map(|range| range.start)).unwrap_or(0)
    }

    /// What makes what is missing.
    pub fn run_hint(&self) -> String {
        format!("run `strandflow run {}`", self.root.display())
    }
}

/// An error of the results on its way to the browser.
pub fn broken(error: EngineError) -> Refusal {
    match error {
        EngineError::Missing { .. } => Refusal::missing(error.to_string(), error.hint()),
        _ => Refusal::broken(error.to_string(), error.hint()),
    }
}
