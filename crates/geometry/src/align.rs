//! Least-squares rigid alignment of corresponding points.
//!
//! Reference: Kabsch 1976; Zhang et al. 2012 eq. 1.

use glam::{DMat3, DVec3};
use nalgebra::Matrix3;
use strandflow_core::RigidTransform;

/// The rigid transform `target_from_source` that minimises Σ w |T s − t|²; `None` with fewer than three points, a
/// non-positive weight sum, or points on one line.
pub fn rigid_from_points(source: &[DVec3], target: &[DVec3], weights: &[f64]) -> Option<RigidTransform> {
    if source.len() < 3 || source.len() != target.len() || source.len() != weights.len() {
        return None;
    }
    let total: f64 = weights.iter().sum();
    if total.is_nan() || total <= 0.0 {
        return None;
    }
    let mean = |points: &[DVec3]| points.iter().zip(weights).map(|(p, w)| *p * *w).sum::<DVec3>() / total;
    let (source_mean, target_mean) = (mean(source), mean(target));
    let mut h = Matrix3::<f64>::zeros();
    for ((s, t), w) in source.iter().zip(target).zip(weights) {
        let (s, t) = (*s - source_mean, *t - target_mean);
        for r in 0..3 {
            for c in 0..3 {
                h[(r, c)] += w * t[r] * s[c];
            }
        }
    }
    let svd = nalgebra::linalg::SVD::new(h, true, true);
    let (largest, middle): (f64, f64) = (svd.singular_values[0], svd.singular_values[1]);
    if middle <= 1e-9 * largest.max(1e-300) {
        return None;
    }
    let (u, vt) = (svd.u?, svd.v_t?);
    let (u, vt): (Matrix3<f64>, Matrix3<f64>) = (u, vt);
    let sign = (u * vt).determinant().signum();
    let r = u * Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0, 1.0, sign)) * vt;
    let column = |c: usize| DVec3::new(r[(0, c)], r[(1, c)], r[(2, c)]);
    let rotation = DMat3::from_cols(column(0), column(1), column(2));
    Some(RigidTransform { rotation, translation: target_mean - rotation * source_mean })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_motion_is_recovered() {
        let truth = RigidTransform {
            rotation: DMat3::from_axis_angle(DVec3::new(1.0, 2.0, -1.0).normalize(), 1.1),
            translation: DVec3::new(5.0, -7.0, 300.0),
        };
        let source: Vec<DVec3> =
            (0..6).map(|i| DVec3::new((i * i) as f64, (7 * i % 5) as f64, (3 * i % 4) as f64) * 10.0).collect();
        let target: Vec<DVec3> = source.iter().map(|p| truth.point(*p)).collect();
        let found = rigid_from_points(&source, &target, &[1.0; 6]).unwrap();
        assert!(source.iter().zip(&target).all(|(s, t)| found.point(*s).distance(*t) < 1e-9));
        assert!(rigid_from_points(&[DVec3::ZERO, DVec3::X, DVec3::X * 2.0], &[DVec3::ZERO; 3], &[1.0; 3]).is_none());
    }
}
