//! Which samples of a strand belong to one hair.
//!
//! A strand that is lost for some frames, or grown astray, may come back as another hair. The frames then fall into
//! segments between which the strand jumps; a simulation can follow one of them.

use glam::DVec3;

/// A jump from one frame to the next beyond this is another hair \[mm, mean over the particles\].
const JUMP_MM: f64 = 10.0;
/// Further way allowed, in steps that the strand makes in the frames around.
const STEPS: f64 = 1.5;
/// Frames around whose steps count.
const AROUND: usize = 3;

/// Segments of fewer frames are left to the sliding median, which knows the single samples.
const LEAST_FRAMES: usize = 3;

/// Takes the weight from all frames but those of one hair: the heaviest segment, and those that continue it.
pub fn keep_one_hair(head: &[DVec3], weights: &mut [f64], n: usize) {
    let mut segments = segments(head, weights, n);
    segments.retain(|segment| segment.len() >= LEAST_FRAMES);
    let weight =
        |segment: &[usize]| -> f64 { segment.iter().map(|t| weights[t * n..(t + 1) * n].iter().sum::<f64>()).sum() };
    let heaviest =
        (0..segments.len()).max_by(|&a, &b| weight(&segments[a]).total_cmp(&weight(&segments[b])).then(b.cmp(&a)));
    let Some(heaviest) = heaviest.filter(|_| segments.len() > 1) else { return };
    let mut dropped: Vec<usize> = Vec::new();
    let mut walk = |order: &mut dyn Iterator<Item = usize>, backwards: bool| {
        let mut last = heaviest;
        for s in order {
            let (before, after) = if backwards { (s, last) } else { (last, s) };
            // A single frame at either end may be astray.
            let mut ends = segments[before].iter().rev().take(2);
            let goes_on = |a: &usize| segments[after].iter().take(2).any(|&b| !jumps(head, weights, n, *a, b));
            if ends.any(goes_on) { last = s } else { dropped.extend(&segments[s]) }
        }
    };
    walk(&mut (heaviest + 1..segments.len()), false);
    walk(&mut (0..heaviest).rev(), true);
    for t in dropped {
        weights[t * n..(t + 1) * n].fill(0.0);
    }
}

/// Runs of present frames without a jump; frames without a sample belong to none.
fn segments(head: &[DVec3], weights: &[f64], n: usize) -> Vec<Vec<usize>> {
    let present = (0..weights.len() / n).filter(|t| weights[t * n..(t + 1) * n].iter().any(|w| *w > 0.0));
    let mut segments: Vec<Vec<usize>> = Vec::new();
    for t in present {
        match segments.last_mut() {
            Some(segment) if segment.last().is_some_and(|&before| !jumps(head, weights, n, before, t)) => {
                segment.push(t)
            }
            _ => segments.push(vec![t]),
        }
    }
    segments
}

/// Whether a strand goes further from frame `a` to frame `b` than its steps around them explain.
fn jumps(head: &[DVec3], weights: &[f64], n: usize, a: usize, b: usize) -> bool {
    let Some(way) = mean_way(head, weights, n, a, b) else { return false };
    let last = weights.len() / n - 1;
    let around = (a.saturating_sub(AROUND)..a).chain(b..(b + AROUND).min(last));
    let mut steps: Vec<f64> = around.filter_map(|t| mean_way(head, weights, n, t, t + 1)).collect();
    steps.sort_by(f64::total_cmp);
    let step = if steps.is_empty() { 0.0 } else { steps[steps.len() / 2] };
    way > JUMP_MM + STEPS * step * (b - a) as f64
}

/// The mean way of the particles that both frames have \[mm\].
fn mean_way(head: &[DVec3], weights: &[f64], n: usize, a: usize, b: usize) -> Option<f64> {
    let both = (0..n).filter(|i| weights[a * n + i] > 0.0 && weights[b * n + i] > 0.0);
    let (sum, count) = both.fold((0.0, 0), |(s, c), i| (s + head[a * n + i].distance(head[b * n + i]), c + 1));
    (count > 0).then(|| sum / f64::from(count))
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
