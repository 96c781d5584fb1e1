//! Strands against curves that a person drew (Zhang et al. 2012, figure 6).

use glam::{DVec3, Vec3};
use serde::Serialize;

/// How far a strand is from a drawn curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CurveDistance {
    /// Mean distance of the curve's points to the strand \[mm\].
    pub mean_mm: f64,
    /// The largest \[mm\].
    pub worst_mm: f64,
    /// Length of the strand \[mm\].
    pub strand_mm: f64,
}

/// Distances of a curve's points to a strand, whose missing (NaN) points are passed over; `None` where fewer than two are
/// present.
pub fn distance_to_strand(curve: &[DVec3], strand: &[Vec3]) -> Option<CurveDistance> {
    let present: Vec<DVec3> = strand.iter().filter(|point| point.is_finite()).map(|point| point.as_dvec3()).collect();
    if present.len() < 2 || curve.is_empty() {
        return None;
    }
    let all: Vec<f64> = curve.iter().map(|point| to_polyline(*point, &present)).collect();
    Some(CurveDistance {
        mean_mm: all.iter().sum::<f64>() / all.len() as f64,
        worst_mm: all.iter().copied().fold(0.0, f64::max),
        strand_mm: length(&present),
    })
}

/// Length of a curve \[mm\].
pub fn length(points: &[DVec3]) -> f64 {
    points.windows(2).map(|pair| pair[0].distance(pair[1])).sum()
}

/// The strand that a person drew over several frames: the one whose worse direction of the mean distance (curve to strand,
/// strand to curve) is least, over the frames that have it. `strand(t, n)` is strand n in the frame of the t-th curve.
pub fn drawn_strand<'a>(
    curves: &[Vec<DVec3>],
    strand_count: usize,
    strand: impl Fn(usize, usize) -> &'a [Vec3],
) -> Option<usize> {
    let apart = |n: usize| {
        let both = curves.iter().enumerate().filter_map(|(t, curve)| {
            let there = distance_to_strand(curve, strand(t, n))?.mean_mm;
            let present = strand(t, n).iter().filter(|point| point.is_finite());
            let back: Vec<f64> = present.map(|point| to_polyline(point.as_dvec3(), curve)).collect();
            Some(there.max(back.iter().sum::<f64>() / back.len() as f64))
        });
        let all: Vec<f64> = both.collect();
        // A strand that most frames lack is not the one that was drawn in them.
        (all.len() * 2 > curves.len()).then(|| all.iter().sum::<f64>() / all.len() as f64)
    };
    let apart = (0..strand_count).filter_map(|n| Some((n, apart(n)?)));
    apart.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(n, _)| n)
}

fn to_polyline(point: DVec3, line: &[DVec3]) -> f64 {
    let to_segment = |pair: &[DVec3]| {
        let along = pair[1] - pair[0];
        let part = ((point - pair[0]).dot(along) / along.length_squared().max(1e-12)).clamp(0.0, 1.0);
        point.distance(pair[0] + along * part)
    };
    line.windows(2).map(to_segment).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(x: f32) -> Vec<Vec3> {
        (0..5).map(|i| Vec3::new(x, 10.0 * i as f32, 0.0)).collect()
    }

    #[test]
    fn a_strand_beside_the_curve_is_as_far_as_it_is() {
        let curve: Vec<DVec3> = (0..9).map(|i| DVec3::new(3.0, 5.0 * f64::from(i), 4.0)).collect();
        let mut strand = line(0.0);
        strand[2] = Vec3::NAN;
        let found = distance_to_strand(&curve, &strand).unwrap();
        assert!((found.mean_mm - 5.0).abs() < 1e-12 && (found.worst_mm - 5.0).abs() < 1e-12);
        assert_eq!((found.strand_mm, length(&curve)), (40.0, 40.0));
        assert_eq!(distance_to_strand(&curve, &[Vec3::ZERO, Vec3::NAN]), None);
    }

    #[test]
    fn the_drawn_strand_is_the_one_that_stays_near_and_is_as_long() {
        let curves = vec![vec![DVec3::ZERO, DVec3::new(0.0, 20.0, 0.0)], vec![DVec3::ZERO, DVec3::new(0.0, 20.0, 0.0)]];
        // 0: twice as long; 1: near, short and right; 2: exact, but missing in the second frame.
        let short: Vec<Vec3> = line(1.0)[..3].to_vec();
        let strands = [[line(0.0), line(0.0)], [short.clone(), short], [line(0.0)[..3].to_vec(), vec![Vec3::NAN; 3]]];
        assert_eq!(drawn_strand(&curves, 3, |t, n| &strands[n][t]), Some(1));
        assert_eq!(drawn_strand(&curves, 0, |t, n| &strands[n][t]), None);
    }
}
