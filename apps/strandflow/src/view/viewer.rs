//! The answers of a take.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, PoisonError},
};

use glam::Vec3;
use rayon::prelude::*;
use strandflow_core::TriMesh;
use strandflow_eval::{lengths::present_length, statistics::evenly};
use strandflow_geometry::project::project;
use strandflow_view::{
    Answers, PerStrand, Picture, Refusal, Selection,
    describe::{StrandHistory, Take},
};

use super::{about, attributes, chosen::Chosen, history, layers, parts::Parts, sets::Set, source::Source};

/// Frames from which the usual length of a strand is taken.
const FRAMES_FOR_LENGTH: usize = 16;

/// Usual lengths \[mm\] of a set's strands, and the number of frames that there were then.
type UsualLengths = (usize, Arc<Vec<f32>>);

/// A take being looked at.
pub struct Viewer {
    source: Source,
    parts: Parts,
    lengths: Mutex<HashMap<String, UsualLengths>>,
}

impl Viewer {
    /// Of a take.
    pub fn new(source: Source) -> Self {
        Self { source, parts: Parts::default(), lengths: Mutex::default() }
    }

    /// The take.
    pub fn source(&self) -> &Source {
        &self.source
    }

    /// What reads strands.
    pub fn read(&self) -> (&Source, &Parts) {
        (&self.source, &self.parts)
    }

    /// Chosen strands of a frame.
    ///
    /// # Errors
    /// As [`Chosen::read`].
    pub fn chosen(&self, set: &Set, frame: usize, selection: &Selection) -> Result<Chosen, Refusal> {
        Chosen::read(self.read(), set, frame, selection)
    }

    /// Median length \[mm\] of each strand over a few frames, evenly chosen of those that are there; NaN where none has it.
    /// Made once, and again when there are more frames.
    ///
    /// # Errors
    /// A frame cannot be read.
    pub fn usual_lengths(&self, set: &Set) -> Result<Arc<Vec<f32>>, Refusal> {
        let done = set.done(&self.source);
        // Held meanwhile: requests for the same set wait instead of reading the same frames.
        let mut known = self.lengths.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((count, lengths)) = known.get(&set.id)
            && (*count, lengths.len()) == (done.len(), set.strands)
        {
            return Ok(lengths.clone());
        }
        let frames: Vec<usize> = evenly(done.len(), FRAMES_FOR_LENGTH).into_iter().map(|i| done[i]).collect();
        let mut of_strand: Vec<Vec<f32>> = vec![Vec::with_capacity(frames.len()); set.strands];
        for frame in frames {
            let chosen = self.chosen(set, frame, &Selection::default())?;
            of_strand.par_iter_mut().enumerate().for_each(|(strand, lengths)| {
                lengths.extend(present_length(chosen.strand(strand)).map(|length| length as f32));
            });
        }
        let median = |mut lengths: Vec<f32>| {
            lengths.sort_by(f32::total_cmp);
            lengths.get(lengths.len() / 2).copied().unwrap_or(f32::NAN)
        };
        let lengths: Arc<Vec<f32>> = Arc::new(of_strand.into_par_iter().map(median).collect());
        known.insert(set.id.clone(), (done.len(), lengths.clone()));
        Ok(lengths)
    }

    fn set(&self, id: &str) -> Result<Set, Refusal> {
        Set::find(&self.source, id)
    }
}

impl Answers for Viewer {
    fn take(&self) -> Result<Take, Refusal> {
        Ok(about::take(self))
    }

    fn strands(&self, set: &str, frame: usize, selection: &Selection) -> Result<PerStrand<Vec3>, Refusal> {
        Ok(self.chosen(&self.set(set)?, frame, selection)?.positions())
    }

    fn attribute(&self, set: &str, name: &str, frame: usize, selection: &Selection) -> Result<PerStrand<f32>, Refusal> {
        attributes::values(self, &self.set(set)?, name, frame, selection)
    }

    fn project(
        &self,
        set: &str,
        view: &str,
        frame: usize,
        selection: &Selection,
    ) -> Result<PerStrand<[f32; 2]>, Refusal> {
        let (_, camera) = layers::camera(&self.source, view)?;
        let PerStrand { points, values } = self.strands(set, frame, selection)?;
        let pixel = |point: &Vec3| match project(camera, point.as_dvec3()) {
            Some(pixel) if point.is_finite() => pixel.as_vec2().to_array(),
            _ => [f32::NAN; 2],
        };
        Ok(PerStrand { points, values: values.par_iter().map(pixel).collect() })
    }

    fn strand(&self, set: &str, index: usize) -> Result<StrandHistory, Refusal> {
        history::of(self, &self.set(set)?, index)
    }

    fn image(&self, view: &str, frame: usize) -> Result<Picture, Refusal> {
        layers::image(&self.source, view, frame)
    }

    fn mask(&self, view: &str, frame: usize) -> Result<Picture, Refusal> {
        layers::mask(&self.source, view, frame)
    }

    fn orientation(&self, view: &str, frame: usize) -> Result<Picture, Refusal> {
        layers::orientation(&self.source, view, frame)
    }

    fn head(&self) -> Result<TriMesh, Refusal> {
        layers::head(&self.source)
    }

    fn hull(&self, frame: usize) -> Result<TriMesh, Refusal> {
        layers::hull(&self.source, frame)
    }

    fn lines(&self, frame: usize, most: Option<usize>) -> Result<Vec<[f32; 7]>, Refusal> {
        layers::lines(&self.source, frame, most)
    }

    fn arrows(&self, frame: usize, most: Option<usize>) -> Result<Vec<[f32; 6]>, Refusal> {
        layers::arrows(&self.source, frame, most)
    }
}
