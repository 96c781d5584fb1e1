//! A take's captured motion, read from its results alone: neither footage nor calibration is looked for.

use std::path::Path;

use glam::{DVec3, Vec3};
use strandflow_core::{FrameRange, Occupancy, RigidTransform, SparseVoxels};
use strandflow_dynamics::Params;
use strandflow_stages::scalp::Scalp;

use crate::{EngineError, Manifest, Plan, store::Store, take::RESULTS};

/// The head's motion and the velocity field of a take.
pub struct Performance {
    store: Store,
    manifest: Manifest,
    /// The take's first frame, with which the poses begin.
    begins: usize,
    frames: FrameRange,
}

impl Performance {
    /// Opens the results of a take.
    ///
    /// # Errors
    /// `Input` where the manifest is wrong or the take has no velocity field.
    pub fn open(root: &Path) -> Result<Self, EngineError> {
        let manifest = Manifest::read(root)?;
        let folder = root.join(RESULTS);
        let frames = Plan::of_last_run(root).map(|plan| plan.frames);
        let (true, Some(frames)) = (folder.is_dir(), frames) else {
            return Err(nothing_to_drive(root, "there is no finished run"));
        };
        let stated = manifest.frames.as_deref().and_then(|text| text.parse::<FrameRange>().ok());
        let begins = stated.map_or(0, |range| range.start);
        let performance = Self { store: Store::open(&folder)?, manifest, begins, frames };
        let lacking = (frames.start..frames.end).find(|frame| performance.record_of(*frame).is_none());
        match lacking {
            Some(frame) => Err(nothing_to_drive(root, &format!("frame {frame} has no velocity field"))),
            None => Ok(performance),
        }
    }

    /// The results.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// The captured frames that have a field.
    pub fn frames(&self) -> FrameRange {
        self.frames
    }

    /// Gravity \[mm/s²\], world.
    pub fn gravity(&self) -> DVec3 {
        DVec3::from_array(self.manifest.gravity)
    }

    /// Frames a second.
    pub fn fps(&self) -> f64 {
        self.manifest.fps
    }

    /// The scalp and its roots, head space.
    ///
    /// # Errors
    /// `Store`; the same below.
    pub fn scalp(&self) -> Result<Scalp, EngineError> {
        self.store.read_scalp()
    }

    /// World from head in a captured frame.
    ///
    /// # Errors
    /// `Store`.
    pub fn pose(&self, frame: usize) -> Result<RigidTransform, EngineError> {
        self.store.read_pose(frame.saturating_sub(self.begins))
    }

    /// Velocities in a captured frame \[mm/s\].
    ///
    /// # Errors
    /// `Store`.
    pub fn field(&self, frame: usize) -> Result<SparseVoxels<Vec3>, EngineError> {
        self.store.read_flow(frame)
    }

    /// Visual hull in a captured frame.
    ///
    /// # Errors
    /// `Store`.
    pub fn hull(&self, frame: usize) -> Result<Occupancy, EngineError> {
        self.store.read_hull(frame)
    }

    /// The strands of a stage in a captured frame, world \[mm\], root first: the points up to the first missing one.
    ///
    /// # Errors
    /// `Store`.
    pub fn strands(&self, stage: &str, frame: usize) -> Result<Vec<Vec<DVec3>>, EngineError> {
        let strands = self.store.shape(&format!("{stage}/points"))?[1];
        let sequence = self.store.read_sequence_part(stage, FrameRange { start: frame, end: frame + 1 }, 0..strands)?;
        let strand = |n: usize| {
            let points = sequence.strand(0, n).iter().map(|p| p.as_dvec3());
            points.take_while(|p| p.is_finite()).collect()
        };
        Ok((0..strands).map(strand).collect())
    }

    /// Fitted spring parameters of the captured strands, in the order of the roots; those of strands that no fit explains are the
    /// defaults.
    ///
    /// # Errors
    /// `Store`.
    pub fn fitted(&self) -> Result<Vec<Params>, EngineError> {
        let rows: Vec<f32> = self.store.read_all("fit/parameters")?;
        let params = |row: &[f32]| {
            let mut values = [0.0; 9];
            values.iter_mut().zip(row).for_each(|(value, from)| *value = f64::from(*from));
            let usable = values.iter().all(|v| v.is_finite()) && values[..4].iter().all(|k| *k > 0.0);
            if usable { Params::from_array(values) } else { Params::default() }
        };
        Ok(rows.chunks_exact(9).map(params).collect())
    }

    /// What the field of a frame rests on and is; `None` where it is not there.
    pub(crate) fn record_of(&self, frame: usize) -> Option<crate::store::Record> {
        self.store.record(&crate::Item::Frame(frame).key("flow/flow"))
    }
}

fn nothing_to_drive(root: &Path, fact: &str) -> EngineError {
    EngineError::input(root.display().to_string(), fact, "run the take first: `strandflow run TAKE`")
}
