//! The shape behind the noise of a strand's samples: the median shape and the rest shape, in head space.

use glam::DVec3;

use crate::rest::{ALTITUDE_EPSILON, RestShape};

/// Edge lengths varying by less than this (relative) are taken as the strand's own; above, noise made them.
const STEADY_EDGES: f64 = 0.2;

/// The middle value (upper of two); reorders its input.
pub(super) fn median(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The median by coordinate.
pub(super) fn median_point(points: impl Iterator<Item = DVec3> + Clone, scratch: &mut Vec<f64>) -> Option<DVec3> {
    let mut out = [0.0; 3];
    for (axis, slot) in out.iter_mut().enumerate() {
        scratch.clear();
        scratch.extend(points.clone().map(|p| p[axis]));
        *slot = median(scratch)?;
    }
    Some(DVec3::from_array(out))
}

/// The time median of each particle in head space; particles never seen continue the strand by whole edges.
pub(super) fn median_shape(head: &[DVec3], weights: &[f64], n: usize, edge_mm: f64) -> Option<Vec<DVec3>> {
    let frames = head.len() / n;
    let mut scratch = Vec::new();
    let seen: Vec<Option<DVec3>> = (0..n)
        .map(|i| {
            let of_particle = (0..frames).map(|t| t * n + i).filter(|&e| weights[e] > 0.0).map(|e| head[e]);
            median_point(of_particle, &mut scratch)
        })
        .collect();
    let first = seen.iter().position(Option::is_some)?;
    let mut shape = vec![seen[first]?; n];
    for i in first + 1..n {
        let before = if i >= 2 { shape[i - 1] - shape[i - 2] } else { DVec3::ZERO };
        let onward = before.try_normalize().unwrap_or(DVec3::NEG_Z) * edge_mm;
        shape[i] = seen[i].unwrap_or(shape[i - 1] + onward);
    }
    for i in (0..first).rev() {
        let onward = if i + 2 < n { shape[i + 1] - shape[i + 2] } else { DVec3::ZERO };
        shape[i] = shape[i + 1] + onward.try_normalize().unwrap_or(DVec3::Z) * edge_mm;
    }
    Some(shape)
}

/// Weighted mean over frames of a quantity of `span + 1` consecutive particles from `i` on, with the sum of weights.
fn over_frames(weights: &[f64], n: usize, i: usize, span: usize, value: impl Fn(usize) -> f64) -> (f64, f64) {
    let (mut sum, mut total) = (0.0, 0.0);
    for t in 0..weights.len() / n {
        let base = t * n + i;
        let w = weights[base..=base + span].iter().fold(1.0f64, |m, &w| m.min(w));
        if w > 0.0 {
            sum += w * value(base);
            total += w;
        }
    }
    (if total > 0.0 { sum / total } else { 0.0 }, total)
}

/// The rest shape from noisy samples.
///
/// Independent noise of σ lengthens squared distances by 6σ² on average; it is measured by third differences in time of
/// the difference vectors themselves, so that noise shared by neighbours does not count. Signed volumes of
/// tetrahedra are multilinear in the points, so their mean is unbiased as it is. Where edges hardly vary (strands grown by
/// constant steps) noise only turned them and nothing is subtracted.
pub(super) fn rest_shape(head: &[DVec3], weights: &[f64], n: usize, median_shape: &[DVec3], edge_mm: f64) -> RestShape {
    let frames = head.len() / n;
    let mut edges: Vec<f64> = Vec::new();
    for t in 0..frames {
        for e in t * n..t * n + n - 1 {
            if weights[e] > 0.0 && weights[e + 1] > 0.0 {
                edges.push(head[e].distance(head[e + 1]));
            }
        }
    }
    let mean = edges.iter().sum::<f64>() / edges.len().max(1) as f64;
    let spread = (edges.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / edges.len().max(1) as f64).sqrt();
    let steady = !edges.is_empty() && spread < STEADY_EDGES * mean;
    let edge = if steady { median(&mut edges).unwrap_or(edge_mm) } else { edge_mm };
    let lengths: Vec<f64> = (0..n.saturating_sub(1))
        .map(|i| match over_frames(weights, n, i, 1, |e| head[e].distance(head[e + 1])) {
            (own, total) if steady && total > 0.0 => own,
            _ => edge,
        })
        .collect();
    let steadiness: Option<Vec<f64>> =
        steady.then(|| (0..n.saturating_sub(2)).map(|i| bend_steadiness(head, weights, n, i)).collect());
    let mut squares = [lengths.iter().map(|l| l * l).collect(), vec![], vec![]];
    for order in 2..=3usize {
        let noise = if steady { 0.0 } else { difference_noise(head, weights, n, order) };
        let longest = |i: usize| lengths[i..i + order].iter().sum::<f64>().powi(2);
        let mut raw: Vec<(f64, f64)> = (0..n.saturating_sub(order))
            .map(|i| {
                let longest = longest(i);
                let (mean, total) = over_frames(weights, n, i, order, |e| head[e].distance_squared(head[e + order]));
                let unseen = median_shape[i].distance_squared(median_shape[i + order]);
                match &steadiness {
                    _ if total == 0.0 => (unseen, 1e-3),
                    None => (mean - noise, total),
                    Some(steadiness) => {
                        let near = &steadiness[i..i + order - 1];
                        let own = near.iter().sum::<f64>() / near.len() as f64;
                        (longest - own * (longest - mean).max(0.0), total)
                    }
                }
            })
            .collect();
        if !steady {
            along_strand(&mut raw);
        }
        // No chord is longer than its edges; one under 40 % of them is noise.
        squares[order - 1] = raw.iter().enumerate().map(|(i, r)| r.0.clamp(0.15 * longest(i), longest(i))).collect();
    }
    let epsilon = ALTITUDE_EPSILON * edge * edge;
    let mut volumes: Vec<(f64, f64)> = (0..n.saturating_sub(3))
        .map(|i| {
            let volume = |e: usize| {
                let (a, b, c, d) = (head[e], head[e + 1], head[e + 2], head[e + 3]);
                (b - a).dot((c - a).cross(d - a))
            };
            over_frames(weights, n, i, 3, volume)
        })
        .collect();
    if !steady {
        along_strand(&mut volumes);
    }
    let altitudes = volumes
        .iter()
        .enumerate()
        .map(|(i, (volume, _))| {
            let of = |order: usize, at: usize| squares[order - 1][at];
            rest_altitudes(*volume, [of(1, i), of(1, i + 1), of(1, i + 2)], [of(2, i), of(2, i + 1)], of(3, i), epsilon)
        })
        .collect();
    let lengths = squares.map(|squares| squares.into_iter().map(f64::sqrt).collect());
    RestShape { lengths, altitudes, epsilon }
}

/// The share of the mean squared bend at particle i + 1 that is the strand's own; the rest is what motion and noise make of it in
/// any direction, by which a straight strand would pass for a bent one.
///
/// With a bend of constant size A and a Gaussian in the plane, |b|² has mean M = A² + 2σ² and variance V = 4σ⁴ + 4A²σ², so that
/// A⁴ = M² − V (moments of the Rice distribution).
fn bend_steadiness(head: &[DVec3], weights: &[f64], n: usize, i: usize) -> f64 {
    let bend = |e: usize| {
        let (a, b) = (head[e + 1] - head[e], head[e + 2] - head[e + 1]);
        ((b - a).length_squared() - (b.length() - a.length()).powi(2)).max(0.0)
    };
    let (mean, _) = over_frames(weights, n, i, 2, bend);
    let (square, _) = over_frames(weights, n, i, 2, |e| bend(e).powi(2));
    let own = (2.0 * mean * mean - square).max(0.0).sqrt();
    if mean > 0.0 { (own / mean).min(1.0) } else { 1.0 }
}

/// Half-width of the average along the strand where noise is large; hair curls evenly \[particles\]. With 2 the wavy and
/// the helical strand end further off, with 8 the helix gains nothing more.
const ALONG_HALF: usize = 4;

/// Replaces (value, weight) by weighted averages over neighbours along the strand.
fn along_strand(values: &mut [(f64, f64)]) {
    let raw = values.to_vec();
    for (i, slot) in values.iter_mut().enumerate() {
        let near = &raw[i.saturating_sub(ALONG_HALF)..(i + ALONG_HALF + 1).min(raw.len())];
        let total: f64 = near.iter().map(|r| r.1).sum();
        if total > 0.0 {
            slot.0 = near.iter().map(|r| r.0 * r.1).sum::<f64>() / total;
        }
    }
}

/// The seven altitudes from six times the signed volume and the squared distances ab bc cd, ac bd, ad.
fn rest_altitudes(volume: f64, [ab, bc, cd]: [f64; 3], [ac, bd]: [f64; 2], ad: f64, epsilon: f64) -> [f64; 7] {
    // Squared area of a parallelogram from its sides and diagonal, and of crossed edges from their dot product.
    let face = |p: f64, q: f64, between: f64| p * q - (0.5 * (p + q - between)).powi(2);
    let crossed = |p: f64, q: f64, dot: f64| p * q - dot * dot;
    let squares = [
        face(bc, bd, cd),
        face(ac, ad, cd),
        face(ab, ad, bd),
        face(ab, ac, bc),
        crossed(ab, cd, 0.5 * (ad + bc - ac - bd)),
        crossed(ac, bd, 0.5 * (ad + bc - ab - cd)),
        crossed(ad, bc, 0.5 * (ac + bd - ab - cd)),
    ];
    // The distances bound the volume (Gram determinant): noise in a straight strand must not make a height.
    let (g12, g13, g23) = (0.5 * (ab + ac - bc), 0.5 * (ab + ad - bd), 0.5 * (ac + ad - cd));
    let gram = ab * (ac * ad - g23 * g23) - g12 * (g12 * ad - g23 * g13) + g13 * (g12 * g23 - ac * g13);
    let bound = gram.max(0.0).sqrt() * (1.0 + 1e-9);
    let volume = volume.clamp(-bound, bound);
    squares.map(|square| volume / (square.max(0.0) + epsilon * epsilon).sqrt())
}

/// What noise adds to squared distances over `order` edges \[mm²\]: three times the variance per coordinate of the
/// difference vectors, from their third differences in time (which are 20 variances).
fn difference_noise(head: &[DVec3], weights: &[f64], n: usize, order: usize) -> f64 {
    differences(weights, n, order, THIRD, |e| head[e + order] - head[e]).unwrap_or(0.0)
}

/// Coefficients of the third and fourth difference, and the sum of their squares.
const THIRD: ([f64; 4], f64) = ([1.0, -3.0, 3.0, -1.0], 20.0);
const FOURTH: ([f64; 5], f64) = ([1.0, -4.0, 6.0, -4.0, 1.0], 70.0);

/// Mean squared difference in time of a quantity of the particles i and i + `span`, over the sum of its squared coefficients:
/// three variances per coordinate of white noise. Every sample that is present counts, however little it is trusted: on
/// real footage most confidences are below one half, and leaving those out once made the noisiest strands look noiseless.
fn differences<const N: usize>(
    weights: &[f64],
    n: usize,
    span: usize,
    (coefficients, squares): ([f64; N], f64),
    value: impl Fn(usize) -> DVec3,
) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0.0);
    for t in 0..(weights.len() / n + 1).saturating_sub(N) {
        for i in 0..n.saturating_sub(span) {
            let at = |k: usize| (t + k) * n + i;
            if (0..N).all(|k| weights[at(k)] > 0.0 && weights[at(k) + span] > 0.0) {
                let difference: DVec3 = (0..N).map(|k| coefficients[k] * value(at(k))).sum();
                sum += difference.length_squared() / squares;
                count += 1.0;
            }
        }
    }
    (count > 0.0).then(|| sum / count)
}

/// Noise per coordinate \[mm\], from fourth differences in time; infinite where no five consecutive frames have a particle.
pub(super) fn noise_mm(head: &[DVec3], weights: &[f64], n: usize) -> f64 {
    differences(weights, n, 0, FOURTH, |e| head[e]).map_or(f64::INFINITY, |d| (d / 3.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn altitudes_from_distances_match_those_from_points() {
        let p = [DVec3::ZERO, DVec3::new(5.0, 0.0, 0.0), DVec3::new(8.0, 4.0, 0.0), DVec3::new(9.0, 6.0, 4.5)];
        let direct = RestShape::from_positions(&p, 5.0);
        let d = |a: usize, b: usize| p[a].distance_squared(p[b]);
        let volume = (p[1] - p[0]).dot((p[2] - p[0]).cross(p[3] - p[0]));
        let built = rest_altitudes(volume, [d(0, 1), d(1, 2), d(2, 3)], [d(0, 2), d(1, 3)], d(0, 3), direct.epsilon);
        for (a, b) in built.iter().zip(&direct.altitudes[0]) {
            assert!((a - b).abs() < 1e-7, "{a} {b}");
        }
    }

    /// Strands of edges 5 mm, shape (T, 4), whose middle bends by `bend(t)` \[rad\] around an axis turned by `turn(t)`.
    fn bent(frames: usize, bend: impl Fn(usize) -> f64, turn: impl Fn(usize) -> f64) -> Vec<DVec3> {
        (0..frames)
            .flat_map(|t| {
                let aside = DVec3::new(turn(t).cos(), turn(t).sin(), 0.0);
                let edge = |angle: f64| 5.0 * (DVec3::NEG_Z * angle.cos() + aside * angle.sin());
                let a = edge(-0.5 * bend(t));
                let b = a + edge(0.5 * bend(t));
                [DVec3::ZERO, a, b, b + edge(1.5 * bend(t))]
            })
            .collect()
    }

    #[test]
    fn bends_of_every_direction_and_size_are_not_the_strands_own() {
        let rest = |head: &[DVec3]| {
            let weights = vec![1.0; head.len()];
            let median = median_shape(head, &weights, 4, 5.0).unwrap();
            rest_shape(head, &weights, 4, &median, 5.0)
        };
        // Straight but for a Gaussian in the plane: the size of the bend is Rayleigh's, by its quantiles. Its mean chord is 9.78 mm.
        let size = |t: usize| 0.3 * (-2.0 * ((t as f64 * 0.618_034).fract() * 0.998 + 0.001).ln()).sqrt();
        let turn = |t: usize| 2.399_963 * t as f64;
        let loose = rest(&bent(400, size, turn));
        assert!(loose.lengths[1].iter().all(|chord| *chord > 9.94), "{loose:?}");
        // A bend that keeps its size is the strand's own, whichever way it turns.
        let curled = rest(&bent(400, |_| 0.6, turn));
        assert!(curled.lengths[1].iter().all(|chord| (*chord - 10.0 * 0.3f64.cos()).abs() < 0.01), "{curled:?}");
    }
}
