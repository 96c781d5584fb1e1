//! The arrays of an animation: written frame by frame with a record each, read back the same way.

use std::{collections::BTreeMap, ops::Range};

use glam::Vec3;
use strandflow_core::{Provenance, RigidTransform, StrandSequence};
use strandflow_dynamics::driven::DrivenState;
use strandflow_io::{At, IoError, strands::StrandFrames};
use strandflow_stages::animate::FrameCheck;

use crate::{
    EngineError,
    item::BLOCK_STRANDS,
    store::{Store, Writer},
};

/// An animation's arrays.
pub(super) struct Folder<'a> {
    store: &'a Store,
    name: String,
    counts: Vec<u16>,
    width: usize,
}

impl<'a> Folder<'a> {
    pub fn new(store: &'a Store, name: &str, counts: &[usize]) -> Self {
        let counts: Vec<u16> = counts.iter().map(|&n| n.min(u16::MAX.into()) as u16).collect();
        let width = counts.iter().copied().max().unwrap_or(0).into();
        Self { store, name: name.to_owned(), counts, width }
    }

    fn array(&self, array: &str) -> String {
        format!("animate/{}/{array}", self.name)
    }

    fn item(&self, k: usize) -> String {
        format!("animate/{}/{k:06}", self.name)
    }

    /// How many first frames are finished and of these inputs, and the state after the last of them.
    pub fn resumed(
        &self,
        inputs: &BTreeMap<String, String>,
        frames: usize,
    ) -> Result<(usize, DrivenState), EngineError> {
        let same = |k: usize| self.store.record(&self.item(k)).is_some_and(|record| record.inputs == *inputs);
        let done = (0..frames).take_while(|k| same(*k)).count();
        let fits = self.store.shape(&self.array("points")).is_ok_and(|s| s[1..] == [self.counts.len(), self.width, 3]);
        if done == 0 || !fits {
            return Ok((0, DrivenState::default()));
        }
        // The array may have been made for fewer frames.
        self.shape(frames)?;
        let part = |array: &str| read_frame(self.store, &self.array(array), done - 1, &self.counts, self.width);
        Ok((done, DrivenState { points: part("points")?, velocities: part("velocities")? }))
    }

    /// Makes the arrays anew.
    pub fn begin(&self, frames: usize) -> Result<(), EngineError> {
        self.store.forget_phase(&format!("animate/{}", self.name))?;
        self.store.remove(&format!("animate/{}", self.name))?;
        self.shape(frames)?;
        let mut writer = Writer::new(self.store);
        writer.whole(&self.array("counts"), &[self.counts.len()], &self.counts)
    }

    fn shape(&self, frames: usize) -> Result<(), EngineError> {
        let longest = self.store.shape(&self.array("points")).map_or(0, |shape| shape[0]).max(frames);
        let (shape, chunk) = ([longest, self.counts.len(), self.width, 3], [1, BLOCK_STRANDS, self.width, 3]);
        for array in ["points", "velocities"] {
            self.store.ensure(&self.array(array), &shape, &chunk, serde_json::Value::Null)?;
        }
        self.store.ensure(&self.array("world_from_head"), &[longest, 4, 4], &[1, 4, 4], serde_json::Value::Null)?;
        self.store.ensure(&self.array("check"), &[longest, 4], &[1, 4], serde_json::Value::Null)
    }

    /// Writes a frame and declares it finished.
    pub fn write(
        &self,
        k: usize,
        (state, pose): (&DrivenState, &RigidTransform),
        inputs: &BTreeMap<String, String>,
        check: &FrameCheck,
    ) -> Result<(), EngineError> {
        self.store.forget(&self.item(k))?;
        let mut writer = Writer::new(self.store);
        writer.chunk(&self.array("world_from_head"), &[k, 0, 0], pose.to_rows().as_flattened())?;
        for (array, values) in [("points", &state.points), ("velocities", &state.velocities)] {
            let mut at = 0;
            for (block, counts) in self.counts.chunks(BLOCK_STRANDS).enumerate() {
                let mut chunk = vec![f32::NAN; BLOCK_STRANDS * self.width * 3];
                for (strand, &count) in counts.iter().enumerate() {
                    let rows = chunk[strand * self.width * 3..].chunks_exact_mut(3);
                    rows.zip(&values[at..at + usize::from(count)])
                        .for_each(|(row, v)| row.copy_from_slice(&v.to_array()));
                    at += usize::from(count);
                }
                writer.chunk(&self.array(array), &[k, block, 0, 0], &chunk)?;
            }
        }
        writer.chunk(&self.array("check"), &[k, 0], &check.to_array())?;
        writer.finish(&self.item(k), inputs.clone(), Vec::new()).map(|_| ())
    }

    /// What the first frames were found to be.
    pub fn checks(&self, frames: usize) -> Result<Vec<FrameCheck>, EngineError> {
        if frames == 0 {
            return Ok(Vec::new());
        }
        let rows: Vec<f64> = self.store.read(&self.array("check"), &[0..frames, 0..4])?;
        Ok(rows.chunks_exact(4).map(|row| FrameCheck::from_array([row[0], row[1], row[2], row[3]])).collect())
    }
}

/// One frame of an array of vectors, strand after strand without the padding.
fn read_frame(store: &Store, path: &str, k: usize, counts: &[u16], width: usize) -> Result<Vec<Vec3>, EngineError> {
    let values: Vec<f32> = store.read(path, &[k..k + 1, 0..counts.len(), 0..width, 0..3])?;
    let rows = counts.iter().enumerate().flat_map(|(n, &count)| n * width..n * width + usize::from(count));
    Ok(rows.map(|i| Vec3::from_slice(&values[3 * i..])).collect())
}

/// A finished animation, read frame by frame.
pub struct AnimationStrands<'a> {
    store: &'a Store,
    name: String,
    numbers: Vec<u32>,
    counts: Vec<u16>,
    width: usize,
}

/// Which animations a store holds, by name.
pub fn animations(store: &Store) -> Vec<String> {
    let entries = std::fs::read_dir(store.root().join("animate")).into_iter().flatten().flatten();
    let folders = entries.filter(|entry| entry.path().is_dir());
    let mut names: Vec<String> = folders.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

impl<'a> AnimationStrands<'a> {
    /// The finished frames of an animation.
    ///
    /// # Errors
    /// `Input` where there is no such animation; `Store`.
    pub fn open(store: &'a Store, name: &str) -> Result<Self, EngineError> {
        let done = (0..).take_while(|k| store.record(&format!("animate/{name}/{k:06}")).is_some()).count();
        if done == 0 {
            let names = animations(store).join(", ");
            let hint =
                if names.is_empty() { "make one: `strandflow animate`".into() } else { format!("there are: {names}") };
            return Err(EngineError::input(format!("animation {name}"), "is not there", hint));
        }
        let counts = store.read_all(&format!("animate/{name}/counts"))?;
        let width = store.shape(&format!("animate/{name}/points"))?[2];
        Ok(Self { store, name: name.to_owned(), numbers: (0..done as u32).collect(), counts, width })
    }
}

impl AnimationStrands<'_> {
    /// World from head in the `t`-th frame.
    ///
    /// # Errors
    /// `Store`.
    pub fn world_from_head(&self, t: usize) -> Result<RigidTransform, EngineError> {
        world_from_head(self.store, &self.name, t)
    }
}

/// World from head in the `t`-th frame of an animation.
///
/// # Errors
/// `Store`.
pub fn world_from_head(store: &Store, name: &str, t: usize) -> Result<RigidTransform, EngineError> {
    let rows: Vec<f64> = store.read(&format!("animate/{name}/world_from_head"), &[t..t + 1, 0..4, 0..4])?;
    Ok(crate::read::transform_from_slice(&rows))
}

impl StrandFrames for AnimationStrands<'_> {
    fn frames(&self) -> &[u32] {
        &self.numbers
    }

    fn counts(&self) -> &[u16] {
        &self.counts
    }

    fn point_count(&self) -> usize {
        self.width
    }

    fn frame(&self, t: usize) -> Result<StrandSequence, IoError> {
        let path = format!("animate/{}/points", self.name);
        let read =
            |range: Range<usize>| self.store.read::<f32>(&path, &[range, 0..self.counts.len(), 0..self.width, 0..3]);
        let values = read(t..t + 1).map_err(|error| {
            let at = At { frame: Some(t), ..At::FILE };
            IoError::content(self.store.root(), at, error.to_string(), error.hint())
        })?;
        let mut sequence = StrandSequence::missing(vec![self.numbers[t]], self.counts.clone(), self.width);
        for (i, point) in values.chunks_exact(3).map(Vec3::from_slice).enumerate() {
            if point.is_finite() {
                sequence.points[i] = point;
                (sequence.provenance[i], sequence.confidence[i]) = (Provenance::Simulated, 1.0);
            }
        }
        Ok(sequence)
    }
}
