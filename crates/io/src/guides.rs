//! Guides: a few strands that stand for those around them.

use glam::Vec3;
use strandflow_geometry::polyline::at_parameter;

use crate::{
    IoError,
    strands::{
        Interchange, StrandFrames,
        choose::{least, squared_distance},
    },
};

/// Guides and whom they stand for.
///
/// Strands are clustered by where they are over time: positions at five places along the strand, root to tip, in up to eight
/// frames. The cluster centres begin at strands spread over all (k-means++ with a fixed sequence for chance) and move to the
/// means of their strands (Lloyd's method); the guide is the strand nearest to the mean. The same strands give the same guides.
///
/// Reference: Arthur & Vassilvitskii 2007.
#[derive(Clone, Debug)]
pub struct Guides {
    /// The strands that are guides, rising.
    pub strands: Vec<u32>,
    /// Strands that are led, rising, and each one's guide as a position in `strands`.
    led: Vec<(u32, u32)>,
    /// By guide, at the five places: root mean square distance of its strands, across it \[mm\].
    pub spread: Vec<[f32; PLACES]>,
}

/// Places along a strand: fewer miss the bend of a long strand, more only repeat their neighbours.
pub const PLACES: usize = 5;
/// Frames looked at: a swing that takes the whole take is met at its ends and between.
const FRAMES: usize = 8;
/// Numbers of a frame: three a place, and one of padding so that sums fill vectors.
const LANES: usize = 16;
/// Rounds of Lloyd's method: the first few move most; those after the tenth move under one strand in a hundred.
const ROUNDS: usize = 10;

impl Guides {
    /// At most `count` guides; where there are no more strands, each leads itself. Memory: 512 bytes a strand.
    ///
    /// # Errors
    /// A frame cannot be read.
    pub fn of(strands: &dyn StrandFrames, count: usize) -> Result<Self, IoError> {
        let curves = Interchange::new(strands)?;
        let features = features(&curves)?;
        let rows: Vec<&[f32]> = features.values.chunks_exact(features.width.max(1)).collect();
        let (mut guide_of, centres) = cluster(&rows, count);

        // The strand of each cluster that is nearest to its centre; clusters that lost all their strands have none.
        let mut nearest: Vec<Option<(usize, f32)>> = vec![None; centres.len()];
        for (curve, &cluster) in guide_of.iter().enumerate() {
            let away = squared_distance::<LANES>(rows[curve], &centres[cluster]);
            if nearest[cluster].is_none_or(|(_, least)| away < least) {
                nearest[cluster] = Some((curve, away));
            }
        }
        let mut medoids: Vec<(usize, usize)> = nearest
            .iter()
            .enumerate()
            .filter_map(|(cluster, found)| found.map(|(curve, _)| (curve, cluster)))
            .collect();
        medoids.sort_unstable();
        let mut place = vec![0; centres.len()];
        medoids.iter().enumerate().for_each(|(at, &(_, cluster))| place[cluster] = at);
        guide_of.iter_mut().for_each(|cluster| *cluster = place[*cluster]);

        let curves_of_guides: Vec<usize> = medoids.iter().map(|&(curve, _)| curve).collect();
        Ok(Self {
            strands: curves_of_guides.iter().map(|&curve| curves.strands[curve]).collect(),
            spread: spread(&rows, &guide_of, &curves_of_guides),
            led: curves.strands.iter().zip(guide_of).map(|(&strand, guide)| (strand, guide as u32)).collect(),
        })
    }

    /// The guide of a strand, as a position in `strands`; `None` where the strand takes no part.
    pub fn guide_of(&self, strand: u32) -> Option<usize> {
        let at = self.led.binary_search_by_key(&strand, |led| led.0).ok()?;
        Some(self.led[at].1 as usize)
    }
}

/// What strands are told apart by, one row a strand.
struct Features {
    width: usize,
    values: Vec<f32>,
}

fn features(curves: &Interchange) -> Result<Features, IoError> {
    let count = curves.frames().len();
    let looked_at = count.min(FRAMES);
    let width = looked_at * LANES;
    let mut values = vec![0.0; width * curves.strands.len()];
    for look in 0..looked_at {
        let t = if looked_at > 1 { look * (count - 1) / (looked_at - 1) } else { 0 };
        let frame = curves.frame(t)?;
        for (curve, range) in curves.ranges().into_iter().enumerate() {
            let points = &frame.points[range];
            let row = &mut values[curve * width + look * LANES..];
            for place in 0..PLACES {
                let parameter = (points.len() - 1) as f32 * place as f32 / (PLACES - 1) as f32;
                row[place * 3..place * 3 + 3].copy_from_slice(&at_parameter(points, parameter).to_array());
            }
        }
    }
    Ok(Features { width, values })
}

/// Rows to begin with: drawn by the squared distance from those drawn before, which follows density and yet leaves nothing
/// far off out. (The farthest rows would be the odd ones out: clusters of one strand.) Of a few drawn the one stays that
/// leaves the smallest sum, so that two rows of one tuft are seldom drawn while another tuft has none.
fn seeds(rows: &[&[f32]], count: usize) -> Vec<usize> {
    let tries = 2 + (count as f64).ln() as usize;
    let mut seeds = Vec::new();
    let mut chance = GoldenSteps(0.0);
    let mut apart = vec![f64::MAX / rows.len().max(1) as f64; rows.len()];
    // Where the sum is 0, all rows are drawn, or equal to one that is.
    while seeds.len() < count && apart.iter().any(|d| *d > 0.0) {
        let closer = |seed: usize| -> Vec<f64> {
            let away = rows.iter().map(|row| f64::from(squared_distance::<LANES>(row, rows[seed])));
            away.zip(&apart).map(|(away, d)| away.min(*d)).collect()
        };
        let drawn: Vec<usize> = (0..tries).map(|_| draw(&apart, chance.step())).collect();
        let left: Vec<Vec<f64>> = drawn.iter().map(|&seed| closer(seed)).collect();
        let best = least(left.iter().map(|left| left.iter().sum::<f64>() as f32));
        seeds.push(drawn[best]);
        apart = left.into_iter().nth(best).unwrap_or_default();
    }
    seeds
}

/// Multiples of the golden ratio's fraction fall evenly into the unit interval, and are the same every time.
struct GoldenSteps(f64);

impl GoldenSteps {
    fn step(&mut self) -> f64 {
        self.0 = (self.0 + 0.618_033_988_749_894_9).fract();
        self.0
    }
}

/// The item at a part of the weights' sum; one of weight.
fn draw(weights: &[f64], part: f64) -> usize {
    let largest = weights.iter().copied().fold(0.0, f64::max);
    // Scaled, so that the sum of the largest numbers is one too.
    let mut left = part * weights.iter().map(|w| w / largest).sum::<f64>();
    let at = weights.iter().position(|w| {
        left -= w / largest;
        *w > 0.0 && left < 0.0
    });
    at.or_else(|| weights.iter().rposition(|w| *w > 0.0)).unwrap_or(0)
}

/// The cluster of each row, and the clusters' centres.
fn cluster(rows: &[&[f32]], count: usize) -> (Vec<usize>, Vec<Vec<f32>>) {
    let mut centres: Vec<Vec<f32>> = seeds(rows, count.max(1)).iter().map(|&seed| rows[seed].to_vec()).collect();
    let nearest = |row: &&[f32], centres: &[Vec<f32>]| least(centres.iter().map(|c| squared_distance::<LANES>(row, c)));
    let mut cluster_of: Vec<usize> = rows.iter().map(|row| nearest(row, &centres)).collect();
    for _ in 0..ROUNDS {
        let mut members = vec![0usize; centres.len()];
        cluster_of.iter().for_each(|&cluster| members[cluster] += 1);
        for (centre, _) in centres.iter_mut().zip(&members).filter(|(_, members)| **members > 0) {
            centre.fill(0.0);
        }
        for (row, &cluster) in rows.iter().zip(&cluster_of) {
            let share = 1.0 / members[cluster] as f32;
            centres[cluster].iter_mut().zip(*row).for_each(|(sum, x)| *sum += x * share);
        }
        let moved: Vec<usize> = rows.iter().map(|row| nearest(row, &centres)).collect();
        if moved == cluster_of {
            break;
        }
        cluster_of = moved;
    }
    (cluster_of, centres)
}

/// Root mean square distance of the strands of each guide from it, at each place and across it.
fn spread(rows: &[&[f32]], guide_of: &[usize], guides: &[usize]) -> Vec<[f32; PLACES]> {
    let place = |row: &[f32], look: usize, place: usize| Vec3::from_slice(&row[look * LANES + place * 3..]);
    let mut sums = vec![[0.0f32; PLACES]; guides.len()];
    let mut counts = vec![0usize; guides.len()];
    for (row, &guide) in rows.iter().zip(guide_of) {
        let own = rows[guides[guide]];
        for look in 0..row.len() / LANES {
            for (at, sum) in sums[guide].iter_mut().enumerate() {
                let (before, after) =
                    (place(own, look, at.saturating_sub(1)), place(own, look, (at + 1).min(PLACES - 1)));
                let away = place(row, look, at) - place(own, look, at);
                *sum += away.reject_from_normalized((after - before).normalize_or(Vec3::Z)).length_squared();
            }
            counts[guide] += 1;
        }
    }
    let mean = |(sums, count): ([f32; PLACES], usize)| sums.map(|sum| (sum / count.max(1) as f32).sqrt());
    sums.into_iter().zip(counts).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use strandflow_core::{Provenance, StrandSequence};

    use super::*;
    use crate::strands::sample;

    /// Three tufts of 7 strands, 50 mm apart, ±1 mm wide; the third and a fourth share their roots and part over time.
    fn tufts() -> StrandSequence {
        let mut sequence = StrandSequence::missing((0..10).collect(), vec![6; 28], 6);
        for t in 0..10 {
            for n in 0..28 {
                let (tuft, member) = (n / 7, n % 7);
                let swing = if tuft == 3 { 8.0 * t as f32 } else { 0.0 };
                for (p, at) in sequence.range(t, n).enumerate() {
                    let (x, y) = (50.0 * tuft.min(2) as f32, (member as f32 - 3.0) / 3.0);
                    sequence.points[at] = Vec3::new(x, y + swing * p as f32 / 5.0, -20.0 * p as f32);
                    sequence.provenance[at] = Provenance::Observed;
                }
            }
        }
        sequence
    }

    #[test]
    fn tufts_are_found_by_root_and_by_motion_and_their_middle_leads() {
        let guides = Guides::of(&tufts(), 4).unwrap();
        assert_eq!(guides.strands, [3, 10, 17, 24]);
        assert!((0..28).all(|n| guides.guide_of(n) == Some(n as usize / 7)));
        // Members at −1, −2/3 … 1 mm: root mean square 2/3.
        assert!(guides.spread.iter().flatten().all(|s| (0.6..=0.667).contains(s)), "{:?}", guides.spread);
    }

    #[test]
    fn as_many_guides_as_strands_lead_themselves_and_none_is_none() {
        let guides = Guides::of(&sample(), 10).unwrap();
        assert_eq!(guides.strands, [0, 2, 3]);
        assert_eq!([0, 1, 2, 3].map(|n| guides.guide_of(n)), [Some(0), None, Some(1), Some(2)]);
        let empty = Guides::of(&StrandSequence::missing(vec![0], vec![0], 3), 2).unwrap();
        assert!(empty.strands.is_empty() && empty.guide_of(0).is_none());
    }
}
