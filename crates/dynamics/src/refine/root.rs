//! The way of a strand's first particles, which the simulation hangs from.

use glam::DVec3;

use crate::{refine::filter, rest::RestShape};

/// Particles that follow the samples' way at the root instead of the springs: one is a free pendulum (error 5.2 mm and growing),
/// two 2.6 mm, three 1.4 mm.
pub const CLAMPED: usize = 3;

/// Half-widths in time to choose from \[frames\], the widest first.
const HALF_WIDTHS: [usize; 6] = [24, 13, 9, 6, 4, 2];
/// A narrower filter must predict left-out frames by so much better than the wider one: it takes noise for motion.
const BETTER: f64 = 0.97;
/// Weight of a frame without a sample, where the way goes straight from the last sample to the next.
const UNSEEN: f64 = 0.02;

/// The way of the first particles in head space \[mm\], shape (T, min(n, [`CLAMPED`])), edges of their rest length: the median
/// shape, moved by what the samples (shape (T, n)) say consistently over time.
///
/// *Deviation*: the paper moves them rigidly with the head. Hair bends within millimetres of its root and is reconstructed there
/// with errors that last; what hangs from the median shape is off by that along all its length, and torn from the samples. Of
/// the first 512 strands of a take of 200 frames `fit` gave up 255 then and 194 with this alone (`docs/results.md`).
pub fn way(head: &[DVec3], weights: &[f64], n: usize, median: &[DVec3], rest: &RestShape) -> Vec<DVec3> {
    let fixed = CLAMPED.min(n);
    let frames = head.len() / n.max(1);
    let mut moved = vec![DVec3::ZERO; frames * fixed];
    let mut trust = vec![UNSEEN; frames * fixed];
    let mut is_seen = vec![false; frames * fixed];
    for i in 0..fixed {
        for t in 0..frames {
            let weight = weights[t * n + i];
            if weight > 0.0 {
                moved[t * fixed + i] = head[t * n + i] - median[i];
                trust[t * fixed + i] = weight;
                is_seen[t * fixed + i] = true;
            }
        }
        lead_over(&mut moved, &is_seen, fixed, i);
    }
    let moved = steadied(&moved, &trust, &is_seen, fixed);
    (0..frames).flat_map(|t| shaped(&moved[t * fixed..(t + 1) * fixed], median, rest)).collect()
}

/// Straight from one sample of particle `i` to the next; constant before the first and after the last.
fn lead_over(moved: &mut [DVec3], is_seen: &[bool], fixed: usize, i: usize) {
    let frames = moved.len() / fixed;
    let seen: Vec<usize> = (0..frames).filter(|t| is_seen[t * fixed + i]).collect();
    let (Some(&first), Some(&last)) = (seen.first(), seen.last()) else { return };
    (0..first).for_each(|t| moved[t * fixed + i] = moved[first * fixed + i]);
    (last + 1..frames).for_each(|t| moved[t * fixed + i] = moved[last * fixed + i]);
    for pair in seen.windows(2) {
        let (from, to) = (moved[pair[0] * fixed + i], moved[pair[1] * fixed + i]);
        for t in pair[0] + 1..pair[1] {
            moved[t * fixed + i] = from.lerp(to, (t - pair[0]) as f64 / (pair[1] - pair[0]) as f64);
        }
    }
}

/// Local quadratics of the half-width that predicts left-out frames best, or nothing at all if none does.
fn steadied(moved: &[DVec3], trust: &[f64], is_seen: &[bool], fixed: usize) -> Vec<DVec3> {
    let square = |e: usize, predicted: DVec3| trust[e] * (moved[e] - predicted).length_squared();
    let seen = || (0..moved.len()).filter(|&e| is_seen[e]);
    let mut best = (seen().map(|e| square(e, DVec3::ZERO)).sum::<f64>(), vec![DVec3::ZERO; moved.len()]);
    for half in HALF_WIDTHS {
        let (fitted, leverage) = filter::fit_all(moved, trust, fixed, half);
        let error: f64 = seen().map(|e| square(e, filter::left_out(moved[e], fitted[e], leverage[e]))).sum();
        if error < BETTER * best.0 {
            best = (error, fitted);
        }
    }
    best.1
}

/// The median shape's first particles, moved, with edges of their rest length.
fn shaped<'a>(moved: &'a [DVec3], median: &'a [DVec3], rest: &'a RestShape) -> impl Iterator<Item = DVec3> + use<'a> {
    let mut at = median[0] + moved[0];
    (0..moved.len()).map(move |i| {
        if i > 0 {
            let edge = median[i] + moved[i] - (median[i - 1] + moved[i - 1]);
            let edge = edge.try_normalize().or((median[i] - median[i - 1]).try_normalize()).unwrap_or(DVec3::NEG_Z);
            at += edge * rest.lengths[0][i - 1];
        }
        at
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAMES: usize = 80;
    const EDGE: f64 = 5.0;

    /// A straight strand of four particles that swings about its root by `angle(t)`, with noise of `noise_mm`, and its median shape.
    fn swung(angle: impl Fn(usize) -> f64, noise_mm: f64) -> (Vec<DVec3>, Vec<DVec3>, RestShape) {
        let at = |angle: f64, i: usize| EDGE * i as f64 * DVec3::new(angle.sin(), 0.0, -angle.cos());
        let noise = |e: usize| noise_mm * filter::white(e);
        let head = (0..FRAMES * 4).map(|e| at(angle(e / 4), e % 4) + if e % 4 > 0 { noise(e) } else { DVec3::ZERO });
        let median: Vec<DVec3> = (0..4).map(|i| at(0.0, i)).collect();
        let rest = RestShape::from_positions(&median, EDGE);
        (head.collect(), median, rest)
    }

    #[test]
    fn the_root_follows_a_swing_over_gaps_and_keeps_its_edges() {
        let angle = |t: usize| 0.3 * (0.15 * t as f64).sin();
        let (head, median, rest) = swung(angle, 0.1);
        let (truth, _, _) = swung(angle, 0.0);
        let mut weights = vec![1.0; head.len()];
        (30 * 4..34 * 4).for_each(|e| weights[e] = 0.0);
        let way = way(&head, &weights, 4, &median, &rest);
        for t in 0..FRAMES {
            for i in 0..CLAMPED {
                let (found, wanted) = (way[t * CLAMPED + i], truth[t * 4 + i]);
                assert!(found.distance(wanted) < 0.6, "frame {t}, particle {i}: {found} {wanted}");
            }
            for pair in way[t * CLAMPED..(t + 1) * CLAMPED].windows(2) {
                assert!((pair[0].distance(pair[1]) - EDGE).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn noise_does_not_move_the_root() {
        let (head, median, rest) = swung(|_| 0.0, 2.0);
        let way = way(&head, &vec![1.0; head.len()], 4, &median, &rest);
        for (e, found) in way.iter().enumerate() {
            assert!(found.distance(median[e % CLAMPED]) < 0.5, "{found}");
        }
    }
}
