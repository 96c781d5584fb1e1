//! What is seen of a strand's displacement, carried on smoothly over the particles and frames where nothing is seen.

use glam::DVec3;

/// Weight of squared second differences in time against a sample of full trust.
const IN_TIME: f64 = 0.05;
/// Weight of squared differences between neighbours along the strand.
const ALONG: f64 = 0.02;
/// Weight of the displacement itself: far from all samples the simulation is right.
const HOLD: f64 = 1e-5;
/// Conjugate gradients between two judgements; each carries what is seen a few particles further.
const GRADIENTS: usize = 12;
/// Times that the trust in samples is judged anew.
const JUDGED: usize = 5;
/// Distance from the smooth field at which a sample loses half its trust \[mm\], and in units of the noise.
const ASTRAY_MM: f64 = 3.0;
/// See [`ASTRAY_MM`].
const ASTRAY_NOISE: f64 = 4.0;
/// Noise under which samples count by their precision \[mm\]: the field goes through what is exact.
const EXACT_NOISE_MM: f64 = 0.05;

/// The smooth field through displacements (shape (T, n)) of these weights (0: not seen), noise per coordinate \[mm\].
///
/// Minimises Σ w |u − d|² + [`IN_TIME`] Σ |second difference in time|² + [`ALONG`] Σ |difference along the strand|² +
/// [`HOLD`] Σ |u|² by conjugate gradients, preconditioned by exact solves in time. Samples far from the field lose weight (Cauchy).
pub fn continued(displacements: &[DVec3], weights: &[f64], n: usize, noise_mm: f64) -> Vec<DVec3> {
    let frames = displacements.len() / n.max(1);
    if frames == 0 {
        return Vec::new();
    }
    // Nothing is known of an infinite noise: it is neither taken for a large one nor for none.
    let noise_mm = if noise_mm.is_finite() { noise_mm } else { EXACT_NOISE_MM };
    let scale = ASTRAY_MM + ASTRAY_NOISE * noise_mm;
    let exact = (EXACT_NOISE_MM / noise_mm.max(1e-3)).powi(2).max(1.0);
    // By particle, then by frame.
    let place = |k: usize| (k % frames) * n + k / frames;
    let seen: Vec<DVec3> = (0..n * frames).map(|k| displacements[place(k)]).collect();
    let given: Vec<f64> = (0..n * frames).map(|k| exact * weights[place(k)]).collect();
    let mut trust = given.clone();
    let mut field = vec![DVec3::ZERO; n * frames];
    for round in 0..JUDGED {
        if round > 0 {
            for ((trust, given), (u, d)) in trust.iter_mut().zip(&given).zip(field.iter().zip(&seen)) {
                *trust = given / (1.0 + u.distance_squared(*d) / (scale * scale));
            }
        }
        solve(&seen, &trust, frames, &mut field);
    }
    let mut out = vec![DVec3::ZERO; n * frames];
    (0..n * frames).for_each(|k| out[place(k)] = field[k]);
    out
}

/// Conjugate gradients from `field` on, by particle and then by frame.
fn solve(seen: &[DVec3], trust: &[f64], frames: usize, field: &mut [DVec3]) {
    let lines: Vec<Line> = trust
        .chunks_exact(frames)
        .enumerate()
        .map(|(i, trust)| {
            let neighbours = usize::from(i > 0) + usize::from((i + 1) * frames < seen.len());
            Line::new(trust, HOLD + ALONG * neighbours as f64)
        })
        .collect();
    let preconditioned = |residual: &[DVec3], out: &mut Vec<DVec3>| {
        out.clear();
        out.extend_from_slice(residual);
        out.chunks_exact_mut(frames).zip(&lines).for_each(|(part, line)| line.solve(part));
    };
    let dot = |a: &[DVec3], b: &[DVec3]| a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum::<f64>();
    let mut image = vec![DVec3::ZERO; seen.len()];
    apply(trust, frames, field, &mut image);
    let mut residual: Vec<DVec3> = (0..seen.len()).map(|k| trust[k] * seen[k] - image[k]).collect();
    let mut step = Vec::new();
    preconditioned(&residual, &mut step);
    let mut way = step.clone();
    let mut slope = dot(&residual, &step);
    for _ in 0..GRADIENTS {
        apply(trust, frames, &way, &mut image);
        let curvature = dot(&way, &image);
        if slope <= 0.0 || curvature <= 0.0 {
            return;
        }
        let length = slope / curvature;
        for k in 0..seen.len() {
            field[k] += length * way[k];
            residual[k] -= length * image[k];
        }
        preconditioned(&residual, &mut step);
        let next = dot(&residual, &step);
        let kept = next / slope;
        way.iter_mut().zip(&step).for_each(|(way, step)| *way = *step + kept * *way);
        slope = next;
    }
}

/// The quadratic form's matrix times a field.
fn apply(trust: &[f64], frames: usize, field: &[DVec3], out: &mut [DVec3]) {
    for k in 0..field.len() {
        let mut sum = (trust[k] + HOLD) * field[k];
        if k >= frames {
            sum += ALONG * (field[k] - field[k - frames]);
        }
        if k + frames < field.len() {
            sum += ALONG * (field[k] - field[k + frames]);
        }
        out[k] = sum;
    }
    for (line, out) in field.chunks_exact(frames).zip(out.chunks_exact_mut(frames)) {
        for t in 2..frames {
            let second = IN_TIME * (line[t - 2] - 2.0 * line[t - 1] + line[t]);
            out[t - 2] += second;
            out[t - 1] -= 2.0 * second;
            out[t] += second;
        }
    }
}

/// L D Lᵀ of diag(trust + hold) + [`IN_TIME`] D₂ᵀD₂, of five diagonals.
struct Line {
    /// 1 / D, and the two diagonals of L, of each row.
    rows: Vec<[f64; 3]>,
}

impl Line {
    fn new(trust: &[f64], hold: f64) -> Self {
        let frames = trust.len();
        // D₂ᵀD₂: on the diagonal, one before, two before.
        let mut rows = vec![[0.0; 3]; frames];
        for t in 2..frames {
            rows[t - 2][0] += 1.0;
            rows[t - 1][0] += 4.0;
            rows[t][0] += 1.0;
            rows[t - 1][1] -= 2.0;
            rows[t][1] -= 2.0;
            rows[t][2] += 1.0;
        }
        let mut pivots = Vec::with_capacity(frames);
        for t in 0..frames {
            let [own, one, two] = rows[t].map(|r| IN_TIME * r);
            let (mut first, mut second) = (0.0, 0.0);
            let mut pivot = own + trust[t] + hold;
            if t >= 2 {
                second = two / pivots[t - 2];
                first -= second * pivots[t - 2] * rows[t - 1][1];
            }
            if t >= 1 {
                first = (one + first) / pivots[t - 1];
                pivot -= first * first * pivots[t - 1];
            }
            if t >= 2 {
                pivot -= second * second * pivots[t - 2];
            }
            pivots.push(pivot);
            rows[t] = [1.0 / pivot, first, second];
        }
        Self { rows }
    }

    fn solve(&self, b: &mut [DVec3]) {
        let frames = b.len();
        for t in 1..frames {
            let [_, first, second] = self.rows[t];
            let mut value = b[t] - first * b[t - 1];
            if t >= 2 {
                value -= second * b[t - 2];
            }
            b[t] = value;
        }
        for t in (0..frames).rev() {
            let mut value = b[t] * self.rows[t][0];
            if t + 1 < frames {
                value -= self.rows[t + 1][1] * b[t + 1];
            }
            if t + 2 < frames {
                value -= self.rows[t + 2][2] * b[t + 2];
            }
            b[t] = value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_solved() {
        let trust = [1.0, 0.0, 0.0, 0.3, 1.0, 0.0, 0.0];
        let (line, hold) = (Line::new(&trust, 0.2), 0.2);
        let x: Vec<DVec3> = (0..7).map(|t| DVec3::new(f64::from(t), (f64::from(t)).sin(), 1.0)).collect();
        let mut b: Vec<DVec3> = x.iter().zip(trust).map(|(x, w)| (w + hold) * x).collect();
        for t in 0..5 {
            let second = x[t] - 2.0 * x[t + 1] + x[t + 2];
            b[t] += IN_TIME * second;
            b[t + 1] -= 2.0 * IN_TIME * second;
            b[t + 2] += IN_TIME * second;
        }
        line.solve(&mut b);
        for (found, wanted) in b.iter().zip(&x) {
            assert!(found.distance(*wanted) < 1e-12, "{b:?}");
        }
    }

    #[test]
    fn what_is_seen_stays_and_what_is_not_goes_on_smoothly() {
        let (frames, n) = (60, 12);
        let wave = |e: usize| DVec3::X * 5.0 * (0.12 * (e / n) as f64).sin();
        // The tip is seen in the first and last frames only, and one sample there is astray.
        let is_seen = |e: usize| e % n < 6 || !(20..40).contains(&(e / n));
        let mut seen: Vec<DVec3> = (0..frames * n).map(|e| if is_seen(e) { wave(e) } else { DVec3::ZERO }).collect();
        let weights: Vec<f64> = (0..frames * n).map(|e| f64::from(u8::from(is_seen(e)))).collect();
        seen[10 * n + 9] += DVec3::Y * 40.0;
        let found = continued(&seen, &weights, n, 0.1);
        for (e, found) in found.iter().enumerate() {
            let is_beside = (e / n).abs_diff(10) < 3 && (e % n).abs_diff(9) < 3;
            let most = if !is_seen(e) {
                2.5
            } else if is_beside {
                1.2
            } else {
                0.3
            };
            assert!(found.distance(wave(e)) < most, "frame {}, particle {}: {found}", e / n, e % n);
        }
        for t in 1..frames - 1 {
            for i in 0..n {
                let at = |t: usize| found[t * n + i];
                let second = at(t - 1) - 2.0 * at(t) + at(t + 1);
                let most = if t.abs_diff(10) < 4 && i.abs_diff(9) < 3 { 2.5 } else { 0.4 };
                assert!(second.length() < most, "frame {t}, particle {i}: {second}");
            }
        }
        assert!(continued(&seen, &vec![0.0; frames * n], n, 0.1).iter().all(|u| u.length() == 0.0));
        assert!(continued(&[], &[], 0, 0.1).is_empty());
    }
}
