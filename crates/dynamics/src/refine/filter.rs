//! A local quadratic filter in time whose width the data choose.

use glam::DVec3;

/// Half-widths to choose from \[frames\]. Seven frames suit 3 mm of noise; strands grown anew in each frame want more.
const HALF_WIDTHS: [usize; 6] = [2, 3, 4, 6, 9, 13];
/// Particles whose residuals are averaged before they vote on the width: prox removes what differs between neighbours,
/// so only noise that they share calls for a wider filter.
const SHARED: usize = 8;

/// Smooths `values` (shape (T, n)) over time by weighted local quadratics of the half-width that predicts left-out
/// samples best. Samples of weight zero do not count; `observed` says which ones may vote on the width.
pub fn smooth(values: &[DVec3], weights: &[f64], observed: &[bool], n: usize) -> Vec<DVec3> {
    let candidates = HALF_WIDTHS.map(|half| fit_all(values, weights, n, half));
    let mut best = (f64::INFINITY, 0);
    for (k, (fitted, leverage)) in candidates.iter().enumerate() {
        let mut error = 0.0;
        for frame in 0..values.len() / n {
            for block in (frame * n..(frame + 1) * n).step_by(SHARED) {
                let members = (block..(block + SHARED).min((frame + 1) * n)).filter(|&e| observed[e]);
                let (mut sum, mut total) = (DVec3::ZERO, 0.0);
                for e in members {
                    sum += weights[e] * (values[e] - fitted[e]) / (1.0 - leverage[e]).max(0.05);
                    total += weights[e];
                }
                error += if total > 0.0 { sum.length_squared() / total } else { 0.0 };
            }
        }
        // A wider filter must be clearly better: what it hides is motion.
        if error < best.0 * 0.97 {
            best = (error, k);
        }
    }
    candidates.into_iter().nth(best.1).map(|c| c.0).unwrap_or_default()
}

/// Half-widths of the average along the strand that [`structure`] chooses from \[particles\].
const ALONG: [usize; 3] = [0, 3, 8];
/// Half-widths in time that [`structure`] chooses from \[frames\].
const IN_TIME: [usize; 2] = [5, 10];
/// What the structure must explain of the squared residual to be believed.
const WORTH: f64 = 0.01;

/// The part of residuals (shape (T, n)) that is predictable from other frames: what the model does not know, such as wind.
/// White noise gives zero. Chosen among averages along the strand and quadratics in time by leaving out whole frames,
/// so that noise shared along a strand does not pass for structure.
pub fn structure(residuals: &[DVec3], weights: &[f64], n: usize) -> Vec<DVec3> {
    let square = |e: usize, predicted: DVec3| weights[e] * (residuals[e] - predicted).length_squared();
    let none: f64 = (0..residuals.len()).map(|e| square(e, DVec3::ZERO)).sum();
    let mut best = (none * (1.0 - WORTH), vec![DVec3::ZERO; residuals.len()]);
    for along in ALONG {
        let (averaged, total) = average_along(residuals, weights, n, along);
        for half in IN_TIME {
            let (fitted, leverage) = fit_all(&averaged, &total, n, half);
            let error: f64 = (0..residuals.len())
                .filter(|&e| weights[e] > 0.0)
                .map(|e| square(e, left_out(averaged[e], fitted[e], leverage[e])))
                .sum();
            if error < best.0 {
                best = (error, fitted);
            }
        }
    }
    best.1
}

/// Weighted averages over 2 `half` + 1 particles along the strand, with the mean weight. Where nothing is seen the
/// residual counts as zero with little weight.
fn average_along(values: &[DVec3], weights: &[f64], n: usize, half: usize) -> (Vec<DVec3>, Vec<f64>) {
    let span = (2 * half + 1) as f64;
    (0..values.len())
        .map(|e| {
            let (base, i) = (e - e % n, e % n);
            let near = base + i.saturating_sub(half)..base + (i + half + 1).min(n);
            let total: f64 = weights[near.clone()].iter().sum();
            let sum: DVec3 = near.map(|e| weights[e] * values[e]).sum();
            let unseen = UNSEEN * span;
            (sum / total.max(unseen), total.max(unseen) / span)
        })
        .unzip()
}

/// Weight of a residual where no sample is.
const UNSEEN: f64 = 0.05;

/// Half-width of the quadratic that the ends are drawn to \[frames\].
const END_HALF: usize = 6;
/// Weight of the first and of the second frame from either end in it: no window reaches frame 0, and few reach the others.
const END_WEIGHTS: [f64; 2] = [0.1, 0.3];

/// Draws the two first and two last frames of refined values (shape (T, n)) to quadratics in time through the frames beside
/// them, by a share each. Frame 0 is no window's prediction and the last frame is only one's: their noise is that of the samples.
pub fn settle_ends(values: &mut [DVec3], n: usize, share: impl Fn(usize) -> f64) {
    let frames = values.len() / n;
    if frames <= END_HALF {
        return;
    }
    let weight = |t: usize| END_WEIGHTS.get(t.min(frames - 1 - t)).copied().unwrap_or(1.0);
    let weights: Vec<f64> = (0..values.len()).map(|e| weight(e / n)).collect();
    let (fitted, _) = fit_all(values, &weights, n, END_HALF);
    for t in [0, 1, frames - 2, frames - 1] {
        for e in t * n..(t + 1) * n {
            values[e] = values[e].lerp(fitted[e], share(e));
        }
    }
}

/// What a fit of [`fit_all`] would have been without the sample itself.
pub fn left_out(value: DVec3, fitted: DVec3, leverage: f64) -> DVec3 {
    let own = leverage.min(0.95);
    (fitted - own * value) / (1.0 - own)
}

/// The fit at every sample and its leverage (the weight of a sample in its own fit).
pub fn fit_all(values: &[DVec3], weights: &[f64], n: usize, half: usize) -> (Vec<DVec3>, Vec<f64>) {
    let frames = values.len() / n;
    let mut fitted = values.to_vec();
    let mut leverage = vec![0.0; values.len()];
    for t in 0..frames {
        let (from, to) = (t.saturating_sub(half), (t + half + 1).min(frames));
        for i in 0..n {
            let samples = (from..to).map(|s| {
                let e = s * n + i;
                ((s as f64 - t as f64) / half as f64, weights[e], values[e])
            });
            if let Some((value, own)) = quadratic_at_zero(samples) {
                fitted[t * n + i] = value;
                leverage[t * n + i] = own * weights[t * n + i];
            }
        }
    }
    (fitted, leverage)
}

/// The constant term of the weighted quadratic fit through (u, weight, value), and the factor of a unit weight at u = 0.
fn quadratic_at_zero(samples: impl Iterator<Item = (f64, f64, DVec3)>) -> Option<(DVec3, f64)> {
    let mut m = [0.0; 5];
    let mut b = [DVec3::ZERO; 3];
    for (u, w, y) in samples {
        let mut power = w;
        for (k, slot) in m.iter_mut().enumerate() {
            *slot += power;
            if k < 3 {
                b[k] += power * y;
            }
            power *= u;
        }
    }
    // First row of the inverse of the 3×3 moment matrix.
    let (c0, c1, c2) = (m[2] * m[4] - m[3] * m[3], m[2] * m[3] - m[1] * m[4], m[1] * m[3] - m[2] * m[2]);
    let determinant = m[0] * c0 + m[1] * c1 + m[2] * c2;
    if determinant.is_nan() || determinant <= 1e-9 * m[0] * m[0] * m[0] {
        return (m[0] > 0.0).then(|| (b[0] / m[0], 1.0 / m[0]));
    }
    Some(((c0 * b[0] + c1 * b[1] + c2 * b[2]) / determinant, c0 / determinant))
}

/// White noise of the variance 1 a coordinate, one vector a number: a multiplicative hash.
#[cfg(test)]
pub(super) fn white(e: usize) -> DVec3 {
    let number = |axis: u64| {
        let h = (e as u64 * 3 + axis + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        ((h ^ (h >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 40) as f64 / f64::from(1 << 24) - 0.5
    };
    12f64.sqrt() * DVec3::new(number(0), number(1), number(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn structure_is_found_in_waves_and_not_in_noise() {
        let n = 20;
        let wave = |e: usize| DVec3::X * 3.0 * (0.2 * (e / n) as f64 + 0.1 * (e % n) as f64).sin();
        let noise = |e: usize| 8.0 / 12f64.sqrt() * white(e);
        let weights = vec![1.0; 60 * n];
        let found = structure(&(0..60 * n).map(|e| wave(e) + noise(e)).collect::<Vec<_>>(), &weights, n);
        let error = (0..60 * n).map(|e| found[e].distance_squared(wave(e))).sum::<f64>() / (60 * n) as f64;
        assert!(error < 1.0, "{error}");
        let nothing = structure(&(0..60 * n).map(noise).collect::<Vec<_>>(), &weights, n);
        let size = nothing.iter().map(|p| p.length_squared()).sum::<f64>() / (60 * n) as f64;
        assert!(size < 0.3, "{size}");
    }

    #[test]
    fn quadratics_pass_unchanged_with_missing_samples() {
        let values: Vec<DVec3> = (0..30).map(f64::from).map(|t| DVec3::new(t * t, 3.0 - t, 1.0)).collect();
        let mut weights = vec![1.0; 30];
        (weights[7], weights[0]) = (0.0, 0.2);
        let out = smooth(&values, &weights, &[true; 30], 1);
        for (a, b) in out.iter().zip(&values) {
            assert!(a.distance(*b) < 1e-9);
        }
    }
}
