//! The strands that a request chooses, in one frame.

use std::{collections::BTreeMap, sync::Arc};

use glam::Vec3;
use rayon::prelude::*;
use strandflow_view::{PerStrand, Refusal, Selection};

use super::{
    along::{Place, places},
    parts::{Part, Parts},
    sets::Set,
    source::Source,
};

/// Chosen strands of a frame, read.
pub struct Chosen {
    /// Their numbers.
    pub numbers: Vec<usize>,
    /// Points a strand of the answer.
    pub points: usize,
    resampled: bool,
    parts: BTreeMap<usize, Arc<Part>>,
    set: Set,
}

impl Chosen {
    /// Reads the blocks that hold them.
    ///
    /// # Errors
    /// The frame is not there, or strands are asked for that are not.
    pub fn read(
        (source, parts): (&Source, &Parts),
        set: &Set,
        frame: usize,
        selection: &Selection,
    ) -> Result<Self, Refusal> {
        set.must_have(source, frame)?;
        let numbers = selection.numbers(set.strands)?;
        let points = selection.points_of(set.points, numbers.len())?;
        let mut chosen =
            Self { numbers, points, resampled: selection.points.is_some(), parts: BTreeMap::new(), set: set.clone() };
        chosen.parts = chosen.blocks_of((source, parts), frame)?;
        if !chosen.resampled {
            chosen.points = chosen.longest();
        }
        Ok(chosen)
    }

    /// The same blocks in another frame; `None` where that is not there.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn beside(
        &self,
        read: (&Source, &Parts),
        frame: Option<usize>,
    ) -> Result<Option<BTreeMap<usize, Arc<Part>>>, Refusal> {
        let frame = frame.filter(|frame| self.set.has(read.0, *frame));
        frame.map(|frame| self.blocks_of(read, frame)).transpose()
    }

    /// Points up to the last one that any of the strands has, at least two: arrays are as wide as the longest strand could have
    /// been, which after `grow` is more than twice of what there is.
    fn longest(&self) -> usize {
        let points =
            |strand: &usize| self.strand(*strand).iter().rposition(|p| p.is_finite()).map_or(0, |last| last + 1);
        self.numbers.par_iter().map(points).max().unwrap_or(0).max(2).min(self.set.points)
    }

    fn blocks_of(
        &self,
        (source, parts): (&Source, &Parts),
        frame: usize,
    ) -> Result<BTreeMap<usize, Arc<Part>>, Refusal> {
        let mut blocks: Vec<usize> = self.numbers.iter().map(|&n| Parts::block_of(&self.set, n)).collect();
        blocks.dedup();
        let read = |block: usize| Ok((block, parts.part(source, &self.set, frame, block)?));
        blocks.into_par_iter().map(read).collect()
    }

    /// The set.
    pub fn set(&self) -> &Set {
        &self.set
    }

    /// The block that holds a strand, of those of another frame.
    pub fn part_in<'a>(&self, blocks: &'a BTreeMap<usize, Arc<Part>>, strand: usize) -> &'a Part {
        &blocks[&Parts::block_of(&self.set, strand)]
    }

    /// A strand's points.
    pub fn strand(&self, strand: usize) -> &[Vec3] {
        let part = self.part(strand);
        &part.points[part.range(strand)]
    }

    /// The block that holds a strand.
    pub fn part(&self, strand: usize) -> &Part {
        self.part_in(&self.parts, strand)
    }

    /// Fills `points` values of each strand by `fill`, in parallel; `missing` where it says nothing.
    pub fn each<T: Copy + Send + Sync>(
        &self,
        points: usize,
        missing: T,
        fill: impl Fn(usize, &mut [T]) + Sync,
    ) -> PerStrand<T> {
        let mut values = vec![missing; self.numbers.len() * points];
        let rows = values.par_chunks_mut(points.max(1)).zip(self.numbers.par_iter());
        rows.for_each(|(row, strand)| fill(*strand, row));
        PerStrand { points, values }
    }

    /// One value a point: `own` makes those of a strand's own points, `mix` takes one at a place between them.
    pub fn at_points<T: Copy + Send + Sync>(
        &self,
        missing: T,
        own: impl Fn(usize) -> Vec<T> + Sync,
        mix: impl Fn(&Place, &[T]) -> T + Sync,
    ) -> PerStrand<T> {
        self.each(self.points, missing, |strand, row| {
            if !self.resampled {
                row.copy_from_slice(&own(strand)[..row.len()]);
            } else if let Some(places) = places(self.strand(strand), row.len()) {
                let own = own(strand);
                row.iter_mut().zip(&places).for_each(|(to, place)| *to = mix(place, &own));
            }
        })
    }

    /// Positions, world \[mm\]; NaN where missing.
    pub fn positions(&self) -> PerStrand<Vec3> {
        self.at_points(Vec3::NAN, |strand| self.strand(strand).to_vec(), |place, points| place.point(points))
    }
}
