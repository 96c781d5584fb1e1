//! Iterative closest point: points brought onto a surface by rotation, translation and, if asked, scale.
//!
//! Reference: Besl & McKay 1992; the scale after Umeyama 1991; pairs beyond three medians are left out.

use glam::DVec3;
use strandflow_core::RigidTransform;

use crate::{align::rigid_from_points, mesh_distance::MeshDistance};

/// A scaling about the origin followed by a rigid motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Scale, applied first.
    pub scale: f64,
    /// Rigid motion, applied second \[mm\].
    pub rigid: RigidTransform,
}

impl Similarity {
    /// The transform that changes nothing.
    pub const IDENTITY: Self = Self { scale: 1.0, rigid: RigidTransform::IDENTITY };

    /// The image of a point \[mm\].
    pub fn point(&self, point: DVec3) -> DVec3 {
        self.rigid.point(point * self.scale)
    }
}

/// What the iteration ended with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Icp {
    /// Surface from source.
    pub surface_from_source: Similarity,
    /// Root mean square distance of the pairs used \[mm\].
    pub rms_mm: f64,
    /// Iterations taken.
    pub iterations: usize,
}

/// Moves `source` onto `surface` from `start` on, until the error changes by less than a millionth or `most_iterations`.
/// `None` for fewer than three points, an empty surface, or points on one line.
pub fn icp(
    source: &[DVec3],
    surface: &MeshDistance,
    start: Similarity,
    with_scale: bool,
    most_iterations: usize,
) -> Option<Icp> {
    let mut best = Icp { surface_from_source: start, rms_mm: f64::INFINITY, iterations: 0 };
    for iteration in 1..=most_iterations {
        let moved: Vec<DVec3> = source.iter().map(|p| best.surface_from_source.point(*p)).collect();
        let nearest: Vec<DVec3> = moved.iter().map(|p| surface.nearest(*p).map(|n| n.point)).collect::<Option<_>>()?;
        let distances: Vec<f64> = moved.iter().zip(&nearest).map(|(a, b)| a.distance(*b)).collect();
        let mut sorted = distances.clone();
        sorted.sort_by(f64::total_cmp);
        let limit = 3.0 * sorted.get(sorted.len() / 2)? + 1e-9;
        let weights: Vec<f64> = distances.iter().map(|&d| f64::from(u8::from(d <= limit))).collect();
        let used: f64 = weights.iter().sum();
        let rms = (distances.iter().zip(&weights).map(|(d, w)| w * d * d).sum::<f64>() / used).sqrt();
        let settled = (best.rms_mm - rms).abs() <= 1e-6 * rms;
        (best.rms_mm, best.iterations) = (rms, iteration);
        if settled || rms < 1e-9 {
            break;
        }
        let first = rigid_from_points(source, &nearest, &weights)?;
        let scale = if with_scale { scale_between(source, &nearest, &weights, &first) } else { start.scale };
        let scaled: Vec<DVec3> = source.iter().map(|p| *p * scale).collect();
        best.surface_from_source = Similarity { scale, rigid: rigid_from_points(&scaled, &nearest, &weights)? };
    }
    Some(best)
}

/// The scale that brings the rotated, centred source nearest to the centred target.
fn scale_between(source: &[DVec3], target: &[DVec3], weights: &[f64], rigid: &RigidTransform) -> f64 {
    let total: f64 = weights.iter().sum();
    let mean = |points: &[DVec3]| points.iter().zip(weights).map(|(p, w)| *p * *w).sum::<DVec3>() / total;
    let (source_mean, target_mean) = (mean(source), mean(target));
    let (mut across, mut own) = (0.0, 0.0);
    for ((s, t), w) in source.iter().zip(target).zip(weights) {
        let s = *s - source_mean;
        across += w * rigid.vector(s).dot(*t - target_mean);
        own += w * s.length_squared();
    }
    if own > 0.0 && across > 0.0 { across / own } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitives::cuboid;
    use glam::DMat3;

    #[test]
    fn a_moved_and_scaled_box_finds_its_surface() {
        let target = cuboid(DVec3::new(-75.0, -95.0, -60.0), DVec3::new(75.0, 95.0, 60.0));
        let truth = Similarity {
            scale: 1.1,
            rigid: RigidTransform {
                rotation: DMat3::from_axis_angle(DVec3::new(1.0, -2.0, 0.5).normalize(), 0.08),
                translation: DVec3::new(4.0, -3.0, 5.0),
            },
        };
        // Points on the faces, taken back by the truth.
        let mut source = Vec::new();
        for f in 0..target.faces.len() {
            let [a, b, c] = target.corners(f);
            for i in 0..12 {
                for j in 0..12 - i {
                    let (u, v) = (f64::from(i) / 12.0, f64::from(j) / 12.0);
                    let on = a + (b - a) * u + (c - a) * v;
                    source.push(truth.rigid.inverse().point(on) / truth.scale);
                }
            }
        }
        let found = icp(&source, &MeshDistance::new(&target), Similarity::IDENTITY, true, 400).unwrap();
        assert!(found.rms_mm < 0.05, "{found:?}");
        assert!((found.surface_from_source.scale - 1.1).abs() < 0.005, "{found:?}");
        assert!(icp(&[], &MeshDistance::new(&target), Similarity::IDENTITY, true, 5).is_none());
    }
}
