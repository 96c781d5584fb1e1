//! A long take in stretches of frames, so that memory does not grow with it.

use std::ops::Range;

use glam::DVec3;

/// The most frames that are a stretch's own. A take of fewer is one stretch.
const MOST: usize = 320;
/// Frames that a stretch is refined beyond its own, on either side: what lies at its ends is reached by fewer windows and by half a
/// filter.
const BEYOND: usize = 24;
/// Frames over which a stretch passes into the next, around the frame where its own end.
pub const SEAM: usize = 16;

/// A stretch of a take's frames, by their places in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stretch {
    /// The frames that it is refined over.
    pub frames: Range<usize>,
    /// Those that are no other stretch's.
    pub own: Range<usize>,
    /// Those that are settled with it.
    pub settled: Range<usize>,
}

impl Stretch {
    /// Whether none comes after it.
    pub fn is_last(&self) -> bool {
        self.settled.end == self.frames.end
    }

    /// The settled frames by their places in the stretch.
    pub(super) fn settled_places(&self) -> Range<usize> {
        self.settled.start - self.frames.start..self.settled.end - self.frames.start
    }
}

/// The stretches of a take of so many frames: all of nearly the same length, each with some frames of its neighbours.
///
/// *Deviation*: the paper's takes have 200 frames and are held at once; so is what has at most 320 here. Longer strands have one
/// body (rest shape, noise) over the take and go from one stretch into the next over 16 frames. Parameters begin anew in each.
/// `docs/dynamics.md` has the measured effect.
pub fn stretches(frames: usize) -> Vec<Stretch> {
    cut(frames, MOST)
}

pub(super) fn cut(frames: usize, most: usize) -> Vec<Stretch> {
    let count = frames.div_ceil(most).max(1);
    let border = |k: usize| k * frames / count;
    (0..count)
        .map(|k| {
            let own = border(k)..border(k + 1);
            let (is_first, is_last) = (k == 0, k + 1 == count);
            let beyond = own.start.saturating_sub(BEYOND)..(own.end + BEYOND).min(frames);
            let settled = if is_first { 0 } else { own.start - SEAM / 2 };
            Stretch { frames: beyond, settled: settled..if is_last { frames } else { own.end - SEAM / 2 }, own }
        })
        .collect()
}

/// Leads over from the end of the stretch before, shape (frames of the seam, n), to the next one's way from its first settled frame on.
pub(super) fn join(tail: &[DVec3], way: &mut [DVec3], n: usize) {
    let seam = tail.len() / n.max(1);
    for (e, (before, after)) in tail.iter().zip(way).enumerate() {
        let u = ((e / n) as f64 + 0.5) / seam as f64;
        *after = before.lerp(*after, u * u * (3.0 - 2.0 * u));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_frame_is_settled_once_and_seams_are_refined_by_both_sides() {
        for frames in [0, 1, 30, 320, 321, 700, 2000] {
            let all = stretches(frames);
            let settled: Vec<usize> = all.iter().flat_map(|s| s.settled.clone()).collect();
            let own: Vec<usize> = all.iter().flat_map(|s| s.own.clone()).collect();
            assert_eq!(settled, (0..frames).collect::<Vec<_>>());
            assert_eq!(own, settled);
            assert_eq!(all.len(), frames.div_ceil(MOST).max(1));
            assert!(all.iter().all(|s| s.frames.len() <= MOST + 2 * BEYOND));
            for pair in all.windows(2) {
                let seam = pair[1].settled.start..pair[1].settled.start + SEAM;
                let inner = |s: &Stretch| s.frames.start + 8 <= seam.start && seam.end + 8 <= s.frames.end;
                assert!(inner(&pair[0]) && inner(&pair[1]), "{pair:?}");
            }
            assert_eq!(all.iter().filter(|s| s.is_last()).count(), 1);
        }
    }
}
