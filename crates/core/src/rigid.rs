//! Rigid transforms, named `target_from_source`.

use glam::{DMat3, DMat4, DVec3};
use serde::{Deserialize, Serialize};

/// A rotation followed by a translation \[mm\].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RigidTransform {
    /// Rotation (orthonormal, determinant +1).
    pub rotation: DMat3,
    /// Translation \[mm\].
    pub translation: DVec3,
}

impl Default for RigidTransform {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl RigidTransform {
    /// The transform that moves nothing.
    pub const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, translation: DVec3::ZERO };

    /// The image of a point \[mm\].
    pub fn point(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    /// The image of a direction.
    pub fn vector(&self, vector: DVec3) -> DVec3 {
        self.rotation * vector
    }

    /// The inverse transform.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// `self` after `first`.
    pub fn after(&self, first: &Self) -> Self {
        Self { rotation: self.rotation * first.rotation, translation: self.point(first.translation) }
    }

    /// The rotation angle \[rad\].
    pub fn angle(&self) -> f64 {
        let d = self.rotation;
        let sine = DVec3::new(d.y_axis.z - d.z_axis.y, d.z_axis.x - d.x_axis.z, d.x_axis.y - d.y_axis.x).length() * 0.5;
        sine.atan2((d.x_axis.x + d.y_axis.y + d.z_axis.z - 1.0) * 0.5)
    }

    /// Row-major 4×4 matrix.
    pub fn to_rows(&self) -> [[f64; 4]; 4] {
        let m = DMat4::from_mat3(self.rotation).transpose().to_cols_array_2d();
        let t = self.translation;
        let mut rows = m;
        (rows[0][3], rows[1][3], rows[2][3]) = (t.x, t.y, t.z);
        rows
    }

    /// From a row-major 4×4 matrix (the last row is ignored).
    pub fn from_rows(rows: &[[f64; 4]; 4]) -> Self {
        let column = |j: usize| DVec3::new(rows[0][j], rows[1][j], rows[2][j]);
        Self { rotation: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_round_trip_and_inverse_undoes() {
        let t = RigidTransform { rotation: DMat3::from_rotation_z(0.3), translation: DVec3::new(1.0, -2.0, 3.0) };
        assert_eq!(RigidTransform::from_rows(&t.to_rows()), t);
        let p = DVec3::new(4.0, 5.0, 6.0);
        assert!((t.inverse().point(t.point(p)) - p).length() < 1e-12);
        assert!((t.angle() - 0.3).abs() < 1e-12);
    }
}
