//! Symmetric 3×3 tensors as six numbers: undirected lines as d dᵀ, which can be averaged, and their principal direction.
//!
//! Reference: Paris et al. 2008, section 5 (orientation diffusion).

use std::ops::{Add, AddAssign, Mul};

use glam::{DVec3, Vec3};

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

    /// Eigenvalues, largest first.
    ///
    /// Reference: Smith 1961.
    pub fn eigenvalues(&self) -> [f32; 3] {
        self.double().eigenvalues().map(|value| value as f32)
    }

    /// The unit eigenvector of the smallest eigenvalue; any of those there are where two or all are the same.
    ///
    /// Reference: Eberly 2014: first the eigenvector of the eigenvalue that stands apart, then the others in the plane across it.
    pub fn least_direction(&self) -> Vec3 {
        self.double().least_direction().as_vec3()
    }

    /// In double precision, scaled to entries up to 1, with that scale.
    fn double(&self) -> Double {
        let entries = self.0.map(f64::from);
        let scale = entries.iter().fold(0.0f64, |most, entry| most.max(entry.abs()));
        if scale > 0.0 {
            Double { entries: entries.map(|entry| entry / scale), scale }
        } else {
            Double { entries, scale }
        }
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
        let [xx, yy, zz, xy, xz, yz] = self.0;
        let [a, b, c] = [Vec3::new(xx, xy, xz), Vec3::new(xy, yy, yz), Vec3::new(xz, yz, zz)];
        Self([a.dot(a), b.dot(b), c.dot(c), a.dot(b), a.dot(c), b.dot(c)])
    }
}

/// A tensor in double precision, for its eigenvalues and eigenvectors.
struct Double {
    entries: [f64; 6],
    scale: f64,
}

impl Double {
    /// The rows of the tensor less a multiple of the identity.
    fn rows_less(&self, value: f64) -> [DVec3; 3] {
        let [xx, yy, zz, xy, xz, yz] = self.entries;
        [DVec3::new(xx - value, xy, xz), DVec3::new(xy, yy - value, yz), DVec3::new(xz, yz, zz - value)]
    }

    /// The mean of the eigenvalues; the deviation of the others, √(Σ (λ − mean)² / 6); and half the determinant of the
    /// tensor less its mean, over that deviation's cube: cos 3φ of the eigenvalues' angles, −1 to 1.
    fn invariants(&self) -> (f64, f64, f64) {
        let [xx, yy, zz, xy, xz, yz] = self.entries;
        let mean = (xx + yy + zz) / 3.0;
        let (x, y, z) = (xx - mean, yy - mean, zz - mean);
        let beside = xy * xy + xz * xz + yz * yz;
        let deviation = ((x * x + y * y + z * z + 2.0 * beside) / 6.0).sqrt();
        let determinant = x * (y * z - yz * yz) - xy * (xy * z - yz * xz) + xz * (xy * yz - y * xz);
        let cosine = if deviation > 0.0 { 0.5 * determinant / deviation.powi(3) } else { 0.0 };
        (mean, deviation, cosine.clamp(-1.0, 1.0))
    }

    /// Of the tensor over its scale.
    fn scaled_eigenvalues(&self) -> [f64; 3] {
        let (mean, deviation, cosine) = self.invariants();
        let angle = cosine.acos() / 3.0;
        let first = mean + 2.0 * deviation * angle.cos();
        let last = mean + 2.0 * deviation * (angle + std::f64::consts::TAU / 3.0).cos();
        [first, 3.0 * mean - first - last, last]
    }

    fn eigenvalues(&self) -> [f64; 3] {
        self.scaled_eigenvalues().map(|value| value * self.scale)
    }

    fn least_direction(&self) -> DVec3 {
        let [first, _, last] = self.scaled_eigenvalues();
        // Of the middle eigenvalue the last is the farther one where cos 3φ is negative.
        if self.invariants().2 < 0.0 {
            return self.across_rows_less(last).unwrap_or(DVec3::X);
        }
        let Some(apart) = self.across_rows_less(first) else { return DVec3::X };
        // Within the plane across the first: the tensor there is (a b; b c).
        let (u, v) = apart.any_orthonormal_pair();
        let [x, y, z] = self.rows_less(0.0);
        let times = |d: DVec3| DVec3::new(x.dot(d), y.dot(d), z.dot(d));
        let (a, b, c) = (u.dot(times(u)), u.dot(times(v)), v.dot(times(v)));
        // The eigenvector of the smaller eigenvalue, from the half difference and without cancellation.
        let half = 0.5 * (c - a);
        let root = half.hypot(b);
        let direction = if half >= 0.0 { u * (half + root) - v * b } else { u * b - v * (root - half) };
        direction.try_normalize().unwrap_or(u)
    }

    /// The unit vector across all rows of the tensor less a simple eigenvalue; `None` where it is not simple.
    fn across_rows_less(&self, value: f64) -> Option<DVec3> {
        let [x, y, z] = self.rows_less(value);
        let crosses = [x.cross(y), x.cross(z), y.cross(z)];
        let longest = crosses.into_iter().max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))?;
        longest.try_normalize()
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

    /// Eigenvalues, largest first, with their unit eigenvectors, by QR iterations.
    fn decomposed(tensor: Tensor) -> [(f32, Vec3); 3] {
        let [xx, yy, zz, xy, xz, yz] = tensor.0.map(f64::from);
        let eigen = nalgebra::Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz).symmetric_eigen();
        let mut pairs = [0, 1, 2].map(|i| {
            let v = eigen.eigenvectors.column(i);
            (eigen.eigenvalues[i] as f32, Vec3::new(v[0] as f32, v[1] as f32, v[2] as f32))
        });
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0));
        pairs
    }

    #[test]
    fn eigenvalues_and_least_directions_are_those_of_qr_iterations() {
        // Shapes from needles to plates and balls, turned anyhow, and over many scales.
        let shapes =
            [[1.0, 0.5, 0.2], [1.0, 1.0, 0.1], [1.0, 0.1, 0.1], [1.0, 1e-3, 0.0], [1.0, 0.999, 0.0], [1.0, 0.0, 0.0]];
        for (k, shape) in shapes.into_iter().cycle().take(60).enumerate() {
            let turn = glam::Quat::from_euler(glam::EulerRot::XYZ, 0.7 * k as f32, 1.3 * k as f32, 0.4 * k as f32);
            let scale = 10f32.powi(k as i32 % 9 - 4);
            let tensor = [Vec3::X, Vec3::Y, Vec3::Z]
                .iter()
                .zip(shape)
                .fold(Tensor::default(), |sum, (axis, value)| sum + Tensor::of_line(turn * *axis) * (value * scale));
            let expected = decomposed(tensor);
            let found = tensor.eigenvalues();
            for i in 0..3 {
                assert!((found[i] - expected[i].0).abs() < 1e-6 * scale, "{shape:?}: {found:?} {expected:?}");
            }
            // Where the smallest are nearly the same, any direction between theirs will do.
            let d = tensor.least_direction();
            assert!((d.length() - 1.0).abs() < 1e-6);
            assert!((tensor.apply(d) - d * expected[2].0).length() < 2e-6 * scale, "{shape:?}: {d}");
        }
        let ball = Tensor([3.0, 3.0, 3.0, 0.0, 0.0, 0.0]);
        assert_eq!((ball.eigenvalues(), ball.least_direction().length()), ([3.0; 3], 1.0));
        assert_eq!((Tensor::default().eigenvalues(), Tensor::default().least_direction().length()), ([0.0; 3], 1.0));
    }

    #[test]
    fn the_principal_direction_of_a_mixture_is_the_eigenvector() {
        let (a, b) = (Vec3::new(0.3, -0.8, 0.5).normalize(), Vec3::new(1.0, 0.2, 0.1).normalize());
        let mixture = Tensor::of_line(a) * 0.7 + Tensor::of_line(b) * 0.2 + Tensor([0.02, 0.02, 0.02, 0.0, 0.0, 0.0]);
        let eigen = decomposed(mixture);
        let [(l1, v1), (l2, _), (l3, _)] = eigen;
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
