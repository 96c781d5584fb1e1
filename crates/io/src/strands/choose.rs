//! Fewer strands, spread evenly over the scalp.

use strandflow_core::StrandSequence;

use super::{Interchange, StrandFrames};
use crate::IoError;

/// Some strands of a source; the others are absent, so that every strand keeps its number.
pub struct ChosenStrands<'a> {
    source: &'a dyn StrandFrames,
    counts: Vec<u16>,
}

impl<'a> ChosenStrands<'a> {
    /// These strands.
    pub fn new(source: &'a dyn StrandFrames, strands: &[u32]) -> Self {
        let mut counts = vec![0; source.counts().len()];
        for &strand in strands {
            counts[strand as usize] = source.counts()[strand as usize];
        }
        Self { source, counts }
    }

    /// At most `count` strands whose roots lie as far apart as can be: the strand nearest to the middle of the roots, then
    /// over and over the one whose root in the first frame is farthest from all chosen. The same strands every time, and a
    /// smaller count is part of a larger one. All where there are no more.
    ///
    /// # Errors
    /// A frame cannot be read.
    pub fn evenly(source: &'a dyn StrandFrames, count: usize) -> Result<Self, IoError> {
        let all = Interchange::new(source)?;
        let roots: Vec<f32> = all.roots(0)?.iter().flat_map(|root| [root.x, root.y, root.z, 0.0]).collect();
        let chosen: Vec<u32> = farthest::<4>(&roots, 4, count).into_iter().map(|at| all.strands[at]).collect();
        Ok(Self::new(source, &chosen))
    }
}

impl StrandFrames for ChosenStrands<'_> {
    fn frames(&self) -> &[u32] {
        self.source.frames()
    }

    fn counts(&self) -> &[u16] {
        &self.counts
    }

    fn point_count(&self) -> usize {
        self.source.point_count()
    }

    fn frame(&self, t: usize) -> Result<StrandSequence, IoError> {
        Ok(StrandSequence { counts: self.counts.clone(), ..self.source.frame(t)? })
    }
}

/// At most `count` rows of `features` that lie far apart: the one nearest to the mean, then over and over the one farthest from
/// all chosen; of equals the first. A row is `width` numbers, a multiple of `LANES`.
pub(crate) fn farthest<const LANES: usize>(features: &[f32], width: usize, count: usize) -> Vec<usize> {
    let rows: Vec<&[f32]> = features.chunks_exact(width).collect();
    let count = count.min(rows.len());
    if count == 0 {
        return Vec::new();
    }
    let mut mean = vec![0.0; width];
    for row in &rows {
        mean.iter_mut().zip(*row).for_each(|(sum, x)| *sum += x / rows.len() as f32);
    }
    let mut chosen = vec![least(rows.iter().map(|row| squared_distance::<LANES>(row, &mean)))];
    let mut apart = vec![f32::INFINITY; rows.len()];
    while chosen.len() < count {
        let last = rows[chosen[chosen.len() - 1]];
        apart.iter_mut().zip(&rows).for_each(|(d, row)| *d = d.min(squared_distance::<LANES>(row, last)));
        // A chosen row is at distance 0; it is not chosen again while another equals it.
        chosen.iter().for_each(|&at| apart[at] = -1.0);
        chosen.push(least(apart.iter().map(|d| -d)));
    }
    chosen
}

/// The first of the smallest; 0 without values.
pub(crate) fn least(values: impl Iterator<Item = f32>) -> usize {
    values.enumerate().fold((0, f32::INFINITY), |best, (at, x)| if x < best.1 { (at, x) } else { best }).0
}

/// Squared distance of two rows; `LANES` sums side by side, so that it vectorises.
pub(crate) fn squared_distance<const LANES: usize>(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0; LANES];
    for (a, b) in a.chunks_exact(LANES).zip(b.chunks_exact(LANES)) {
        for lane in 0..LANES {
            sums[lane] += (a[lane] - b[lane]).powi(2);
        }
    }
    sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use strandflow_core::Provenance;

    use super::*;
    use crate::strands::sample;

    /// 20 × 20 strands of two points on a square, 1 mm apart.
    fn square() -> StrandSequence {
        let mut sequence = StrandSequence::missing(vec![0], vec![2; 400], 2);
        for n in 0..400 {
            for (p, at) in sequence.range(0, n).enumerate() {
                sequence.points[at] = Vec3::new((n % 20) as f32, (n / 20) as f32, -(p as f32));
                sequence.provenance[at] = Provenance::Observed;
            }
        }
        sequence
    }

    #[test]
    fn chosen_strands_are_even_and_keep_their_numbers() {
        let sequence = square();
        let chosen = ChosenStrands::evenly(&sequence, 25).unwrap();
        let interchange = Interchange::new(&chosen).unwrap();
        let roots = interchange.roots(0).unwrap();
        assert_eq!(roots.len(), 25);
        // 25 of 400 on 19 × 19 mm: a square grid of them would be 4.75 mm apart, the best packing 5.1.
        let gap = |a: &Vec3| roots.iter().filter(|b| *b != a).map(|b| a.distance(*b)).fold(f32::INFINITY, f32::min);
        assert!(roots.iter().all(|root| gap(root) >= 2.8), "{:?}", roots.iter().map(gap).collect::<Vec<_>>());
        let far = |n: usize| {
            let at = Vec3::new((n % 20) as f32, (n / 20) as f32, 0.0);
            roots.iter().map(|root| root.distance(at)).fold(f32::INFINITY, f32::min)
        };
        assert!((0..400).all(|n| far(n) <= 4.0), "no part of the scalp is left bare");
        for (&strand, root) in interchange.strands.iter().zip(&roots) {
            assert_eq!(*root, sequence.strand(0, strand as usize)[0]);
        }
        let again = ChosenStrands::evenly(&sequence, 25).unwrap();
        assert_eq!(chosen.counts(), again.counts());
    }

    #[test]
    fn more_than_there_are_is_all() {
        let sequence = sample();
        let chosen = ChosenStrands::evenly(&sequence, 100).unwrap();
        assert_eq!(chosen.counts(), sequence.counts());
        let empty = StrandSequence::missing(vec![0], vec![0, 0], 3);
        assert_eq!(ChosenStrands::evenly(&empty, 5).unwrap().counts(), [0, 0]);
    }
}
