//! A local quadratic filter in time whose width the data choose.

use glam::DVec3;

/// Half-widths to choose from \[frames\]. Seven frames suit 3 mm of noise; strands grown anew in each frame want more.
const HALF_WIDTHS: [usize; 5] = [3, 4, 6, 9, 13];

/// Smooths `values` (shape (T, n)) over time by weighted local quadratics of the half-width that predicts left-out
/// samples best. Samples of weight zero do not count; `observed` says which ones may vote on the width.
pub fn smooth(values: &[DVec3], weights: &[f64], observed: &[bool], n: usize) -> Vec<DVec3> {
    let candidates = HALF_WIDTHS.map(|half| fit_all(values, weights, n, half));
    let mut best = (f64::INFINITY, 0);
    for (k, (fitted, leverage)) in candidates.iter().enumerate() {
        let mut error = 0.0;
        for e in 0..values.len() {
            if observed[e] {
                error += weights[e] * (values[e] - fitted[e]).length_squared() / (1.0 - leverage[e]).max(0.05).powi(2);
            }
        }
        // A wider filter must be clearly better: what it hides is motion.
        if error < best.0 * 0.97 {
            best = (error, k);
        }
    }
    let [a, b, c, d, e] = candidates;
    [a.0, b.0, c.0, d.0, e.0].into_iter().nth(best.1).unwrap_or_default()
}

/// The fit at every sample and its leverage (the weight of a sample in its own fit).
fn fit_all(values: &[DVec3], weights: &[f64], n: usize, half: usize) -> (Vec<DVec3>, Vec<f64>) {
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
    if !(determinant > 1e-9 * m[0] * m[0] * m[0]) {
        return (m[0] > 0.0).then(|| (b[0] / m[0], 1.0 / m[0]));
    }
    Some(((c0 * b[0] + c1 * b[1] + c2 * b[2]) / determinant, c0 / determinant))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quadratics_pass_unchanged_with_missing_samples() {
        let values: Vec<DVec3> = (0..30).map(|t| f64::from(t)).map(|t| DVec3::new(t * t, 3.0 - t, 1.0)).collect();
        let mut weights = vec![1.0; 30];
        (weights[7], weights[0]) = (0.0, 0.2);
        let out = smooth(&values, &weights, &vec![true; 30], 1);
        for (a, b) in out.iter().zip(&values) {
            assert!(a.distance(*b) < 1e-9);
        }
    }
}
