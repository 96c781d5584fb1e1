//! Which samples of a strand belong to one hair.
//!
//! A strand that is lost for some frames, or grown astray, may come back as another hair. The frames then fall into
//! segments between which the strand jumps; a simulation can follow one of them.

use glam::DVec3;

use super::shape::median;

/// A jump from one frame to the next beyond this is another hair \[mm, mean over the particles\], unless the strand often
/// goes as far: one that is grown anew in each frame is restless, and no less one hair.
const JUMP_MM: f64 = 10.0;
/// How often is often: the share of its ways from frame to frame that are shorter.
const OFTEN: f64 = 0.8;
/// Further way allowed a frame, in steps of the strand.
const STEPS: f64 = 1.5;
/// Frames over which steps are measured: over one, noise of 3 mm would look like a step of 7 mm.
const AROUND: usize = 3;
/// Segments of fewer frames are left to the sliding median, which knows the single samples.
const LEAST_FRAMES: usize = 3;

/// Takes the weight from all frames but those of one hair: the heaviest segment, and those that continue it.
///
/// *Deviation*: the paper fits what it is given. `joint_table` has the measured effect (row "two hairs").
pub fn keep_one_hair(head: &[DVec3], weights: &mut [f64], n: usize) {
    let strand = Strand::new(head, weights, n);
    let segments: Vec<Vec<usize>> =
        strand.segments().into_iter().filter(|segment| segment.len() >= LEAST_FRAMES).collect();
    let weight = |s: usize| segments[s].iter().flat_map(|t| &strand.weights[t * n..(t + 1) * n]).sum::<f64>();
    let heaviest = (0..segments.len()).max_by(|&a, &b| weight(a).total_cmp(&weight(b)).then(b.cmp(&a)));
    let Some(heaviest) = heaviest else { return };
    let mut dropped: Vec<usize> = Vec::new();
    let (mut first, mut last) = (heaviest, heaviest);
    for s in heaviest + 1..segments.len() {
        if strand.goes_on(&segments[last], &segments[s]) { last = s } else { dropped.extend(&segments[s]) }
    }
    for s in (0..heaviest).rev() {
        if strand.goes_on(&segments[s], &segments[first]) { first = s } else { dropped.extend(&segments[s]) }
    }
    for t in dropped {
        weights[t * n..(t + 1) * n].fill(0.0);
    }
}

/// A strand of n particles in head space; samples of weight zero are missing.
struct Strand<'a> {
    head: &'a [DVec3],
    weights: &'a [f64],
    n: usize,
    /// The median of its steps \[mm/frame\].
    usual: f64,
    /// The least way that counts as a jump \[mm\].
    jump: f64,
}

impl<'a> Strand<'a> {
    fn new(head: &'a [DVec3], weights: &'a [f64], n: usize) -> Self {
        let mut strand = Self { head, weights, n, usual: 0.0, jump: JUMP_MM };
        let mut steps: Vec<f64> = (0..strand.frames()).filter_map(|t| strand.step(t)).collect();
        strand.usual = median(&mut steps).unwrap_or(0.0);
        let mut ways: Vec<f64> = (1..strand.frames()).filter_map(|t| strand.mean_way(t - 1, t)).collect();
        ways.sort_by(f64::total_cmp);
        let often = ways.get((OFTEN * ways.len() as f64) as usize).copied();
        strand.jump = often.map_or(JUMP_MM, |way| way.max(JUMP_MM));
        strand
    }

    fn frames(&self) -> usize {
        self.weights.len() / self.n
    }

    /// Runs of present frames without a jump; frames without a sample belong to none.
    fn segments(&self) -> Vec<Vec<usize>> {
        let present = |t: &usize| self.weights[t * self.n..(t + 1) * self.n].iter().any(|w| *w > 0.0);
        let mut segments: Vec<Vec<usize>> = Vec::new();
        for t in (0..self.frames()).filter(present) {
            match segments.last_mut() {
                Some(segment) if !self.jumps(&segment[segment.len() - 1..], &[t]) => segment.push(t),
                _ => segments.push(vec![t]),
            }
        }
        segments
    }

    /// Whether one segment continues another. A single frame at either end may be astray.
    fn goes_on(&self, before: &[usize], after: &[usize]) -> bool {
        !self.jumps(&before[before.len().saturating_sub(2)..], &after[..after.len().min(2)])
    }

    /// The way from a frame to one a few later, for each of them \[mm\].
    fn step(&self, t: usize) -> Option<f64> {
        let way = (t + AROUND < self.frames()).then(|| self.mean_way(t, t + AROUND)).flatten()?;
        Some(way / AROUND as f64)
    }

    /// Whether the strand goes further between some frames before and some after than its steps there, or its usual ones,
    /// explain.
    fn jumps(&self, before: &[usize], after: &[usize]) -> bool {
        let (Some(&a), Some(&b)) = (before.last(), after.first()) else { return false };
        let ways = before.iter().flat_map(|a| after.iter().filter_map(|b| self.mean_way(*a, *b)));
        let way = ways.fold(f64::INFINITY, f64::min);
        let around = [a.checked_sub(AROUND).and_then(|t| self.step(t)), self.step(b)];
        let step = around.into_iter().flatten().fold(self.usual, f64::max);
        way.is_finite() && way > self.jump + STEPS * step * (b - a) as f64
    }

    /// The mean way of the particles that both frames have \[mm\].
    fn mean_way(&self, a: usize, b: usize) -> Option<f64> {
        let (a, b) = (a * self.n, b * self.n);
        let both = (0..self.n).filter(|i| self.weights[a + i] > 0.0 && self.weights[b + i] > 0.0);
        let (sum, count) = both.fold((0.0, 0), |(s, c), i| (s + self.head[a + i].distance(self.head[b + i]), c + 1));
        (count > 0).then(|| sum / f64::from(count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 4;

    /// A strand that swings; `offset` puts it elsewhere in some frames, `present` leaves some out.
    fn strand(frames: usize, offset: impl Fn(usize) -> f64, present: impl Fn(usize) -> bool) -> (Vec<DVec3>, Vec<f64>) {
        let point =
            |t: usize, i: usize| DVec3::new(offset(t) + 9.0 * (0.4 * t as f64).sin() * i as f64, 0.0, -5.0 * i as f64);
        let head = (0..frames * N).map(|e| point(e / N, e % N)).collect();
        (head, (0..frames * N).map(|e| f64::from(u8::from(present(e / N)))).collect())
    }

    fn kept(head: &[DVec3], mut weights: Vec<f64>) -> Vec<usize> {
        keep_one_hair(head, &mut weights, N);
        (0..weights.len() / N).filter(|t| weights[t * N] > 0.0).collect()
    }

    #[test]
    fn a_swinging_strand_with_gaps_is_one_hair() {
        let (head, weights) = strand(20, |_| 0.0, |t| !(7..11).contains(&t) && t != 15);
        let all: Vec<usize> = (0..20).filter(|t| !(7..11).contains(t) && *t != 15).collect();
        assert_eq!(kept(&head, weights), all);
    }

    #[test]
    fn the_hair_of_most_frames_stays() {
        let (head, weights) = strand(20, |t| if t < 12 { 0.0 } else { 40.0 }, |t| t != 12);
        assert_eq!(kept(&head, weights), (0..12).collect::<Vec<_>>());
    }

    #[test]
    fn a_strand_that_comes_back_keeps_both_ends() {
        let (head, weights) = strand(20, |t| if (6..10).contains(&t) { -50.0 } else { 0.0 }, |_| true);
        assert_eq!(kept(&head, weights), (0..6).chain(10..20).collect::<Vec<_>>());
    }
}
