//! Polylines: length and resampling by arc length.

use glam::Vec3;

/// Length of a polyline \[mm\].
pub fn length(points: &[Vec3]) -> f32 {
    points.windows(2).map(|pair| pair[0].distance(pair[1])).sum()
}

/// Positions along a polyline, in units of its vertices, spaced `edge_mm` along its arc from the first vertex on; the
/// last, shorter piece is dropped. `3.25` means a quarter of the way from vertex 3 to vertex 4.
pub fn arc_parameters(points: &[Vec3], edge_mm: f32) -> Vec<f32> {
    let mut out = Vec::new();
    if points.is_empty() || edge_mm.is_nan() || edge_mm <= 0.0 {
        return out;
    }
    out.push(0.0);
    let (mut walked, mut next) = (0.0f32, edge_mm);
    for (i, pair) in points.windows(2).enumerate() {
        let step = pair[0].distance(pair[1]);
        while step > 0.0 && walked + step >= next {
            out.push(i as f32 + ((next - walked) / step).min(1.0));
            next += edge_mm;
        }
        walked += step;
    }
    out
}

/// The point at a parameter of [`arc_parameters`].
pub fn at_parameter(points: &[Vec3], parameter: f32) -> Vec3 {
    let i = (parameter as usize).min(points.len().saturating_sub(2));
    if points.len() < 2 { points[0] } else { points[i].lerp(points[i + 1], parameter - i as f32) }
}

/// `count` places (2 at least) at equal lengths along segments of the given lengths, ends included: segment and part of the way
/// along it. By number of segments where they have no length.
pub fn even_places(lengths: &[f32], count: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
    let total: f32 = lengths.iter().sum();
    let length = move |segment: usize| if total > 0.0 { lengths[segment] } else { 1.0 };
    let whole = if total > 0.0 { total } else { lengths.len() as f32 };
    let (mut segment, mut before) = (0, 0.0);
    (0..count).map(move |place| {
        let want = whole * place as f32 / (count - 1) as f32;
        while segment + 1 < lengths.len() && before + length(segment) < want {
            before += length(segment);
            segment += 1;
        }
        let own = if lengths.is_empty() { 0.0 } else { length(segment) };
        let part = if own > 0.0 { ((want - before) / own).clamp(0.0, 1.0) } else { 0.0 };
        // The last is the tip, whatever rounding says.
        (segment, if place + 1 == count { 1.0 } else { part })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bent_line_is_walked_by_arc_length() {
        let points = [Vec3::ZERO, Vec3::new(3.0, 0.0, 0.0), Vec3::new(3.0, 4.0, 0.0)];
        assert_eq!(length(&points), 7.0);
        let parameters = arc_parameters(&points, 2.0);
        let resampled: Vec<Vec3> = parameters.iter().map(|&s| at_parameter(&points, s)).collect();
        assert_eq!(resampled.len(), 4);
        assert!(resampled[2].distance(Vec3::new(3.0, 1.0, 0.0)) < 1e-6);
        assert!(resampled[3].distance(Vec3::new(3.0, 3.0, 0.0)) < 1e-6);
    }
}
