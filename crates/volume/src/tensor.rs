//! Symmetric 3×3 tensors as six numbers: undirected lines as d dᵀ, which can be averaged, and their principal direction.
//!
//! Reference: Paris et al. 2008, section 5 (orientation diffusion).

use std::ops::{Add, AddAssign, Mul};

use glam::Vec3;
use nalgebra::Matrix3;

/// A symmetric tensor: xx, yy, zz, xy, xz, yz.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tensor(pub [f32; 6]);

impl Tensor {
    /// d dᵀ of a direction.
    #[inline]
    pub fn of_line(d: Vec3) -> Self {
        Self([d.x * d.x, d.y * d.y, d.z * d.z, d.x * d.y, d.x * d.z, d.y * d.z])
    }

    /// The product with a vector.
    #[inline]
    pub fn apply(&self, v: Vec3) -> Vec3 {
        let [xx, yy, zz, xy, xz, yz] = self.0;
        Vec3::new(xx * v.x + xy * v.y + xz * v.z, xy * v.x + yy * v.y + yz * v.z, xz * v.x + yz * v.y + zz * v.z)
    }

    /// Sum of the eigenvalues.
    #[inline]
    pub fn trace(&self) -> f32 {
        self.0[0] + self.0[1] + self.0[2]
    }

    /// The inverse; `None` where the tensor is singular (to single precision).
    pub fn inverse(&self) -> Option<Self> {
        let [xx, yy, zz, xy, xz, yz] = self.0.map(f64::from);
        let (a, b, c) = (yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy);
        let determinant = xx * a + xy * b + xz * c;
        let scale = f64::from(self.trace()).abs() / 3.0;
        (determinant.abs() > 1e-9 * scale.powi(3)).then(|| {
            let adjugate = [a, xx * zz - xz * xz, xx * yy - xy * xy, b, c, xy * xz - xx * yz];
            Self(adjugate.map(|entry| (entry / determinant) as f32))
        })
    }

    /// Eigenvalues, largest first, with their unit eigenvectors.
    pub fn eigen(&self) -> [(f32, Vec3); 3] {
        let [xx, yy, zz, xy, xz, yz] = self.0.map(f64::from);
        let eigen = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz).symmetric_eigen();
        let mut pairs = [0, 1, 2].map(|i| {
            let v = eigen.eigenvectors.column(i);
            (eigen.eigenvalues[i] as f32, Vec3::new(v[0] as f32, v[1] as f32, v[2] as f32))
        });
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0));
        pairs
    }

    /// The principal direction and 1 − λ₂/λ₁, in which 1 is a pure line and 0 has no direction. `guess` is a direction
    /// that is not across it. The tensor's sixteenth power, exact to 4e-3 rad where λ₂/λ₁ < 0.7.
    pub fn principal(&self, guess: Vec3) -> (Vec3, f32) {
        let squared = self.times_itself();
        // Squared thrice again, each time at a trace of one: a chain of few operations, and without a root.
        let power = (0..3).fold(squared, |power, _| (power * power.trace().max(1e-30).recip()).times_itself());
        let d = power.apply(guess).try_normalize().unwrap_or(guess);
        let first = d.dot(self.apply(d)).max(1e-12);
        // The two others follow from trace and Frobenius norm.
        let rest = self.trace() - first;
        let squares = squared.trace() - first * first;
        let second = 0.5 * (rest + (2.0 * squares - rest * rest).max(0.0).sqrt());
        (d, (1.0 - second / first).clamp(0.0, 1.0))
    }

    /// The axis with the largest diagonal entry, projected through the tensor: a start for [`Tensor::principal`].
    pub fn rough_direction(&self) -> Vec3 {
        let [xx, yy, zz, ..] = self.0;
        let axis = if xx >= yy && xx >= zz {
            Vec3::X
        } else if yy >= zz {
            Vec3::Y
        } else {
            Vec3::Z
        };
        self.apply(axis).normalize_or(axis)
    }

    fn times_itself(&self) -> Self {
        let [a, b, c] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| self.apply(axis));
        Self([a.dot(a), b.dot(b), c.dot(c), a.dot(b), a.dot(c), b.dot(c)])
    }
}

impl Add for Tensor {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] + other.0[i]))
    }
}

impl AddAssign for Tensor {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Mul<f32> for Tensor {
    type Output = Self;

    #[inline]
    fn mul(self, factor: f32) -> Self {
        Self(self.0.map(|entry| entry * factor))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_principal_direction_of_a_mixture_is_the_eigenvector() {
        let (a, b) = (Vec3::new(0.3, -0.8, 0.5).normalize(), Vec3::new(1.0, 0.2, 0.1).normalize());
        let mixture = Tensor::of_line(a) * 0.7 + Tensor::of_line(b) * 0.2 + Tensor([0.02, 0.02, 0.02, 0.0, 0.0, 0.0]);
        let [(l1, v1), (l2, _), (l3, _)] = mixture.eigen();
        let (d, trust) = mixture.principal(mixture.rough_direction());
        assert!(d.dot(v1).abs() > 1.0 - 1e-6);
        assert!((trust - (1.0 - l2 / l1)).abs() < 1e-4);
        assert!((mixture.trace() - l1 - l2 - l3).abs() < 1e-5);
    }

    #[test]
    fn the_inverse_undoes_the_product() {
        let t = Tensor([2.0, 3.0, 4.0, 0.5, -0.3, 0.8]);
        let v = Vec3::new(0.4, -1.2, 2.0);
        assert!(t.inverse().unwrap().apply(t.apply(v)).distance(v) < 1e-5);
        assert!(Tensor::of_line(Vec3::X).inverse().is_none());
    }

    #[test]
    fn opposite_vectors_are_one_line() {
        let d = Vec3::new(0.6, 0.0, 0.8);
        let sum = Tensor::of_line(d) + Tensor::of_line(-d);
        let (found, trust) = sum.principal(sum.rough_direction());
        assert!(found.dot(d).abs() > 0.999_999 && trust > 0.999);
    }
}
