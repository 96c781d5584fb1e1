//! The space that another program expects: unit, up axis, handedness.

use glam::{DMat3, DQuat, DVec3};

/// The axis that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Up {
    /// Y.
    Y,
    /// Z.
    Z,
}

/// Unit and axes of a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Space {
    /// One unit of the file \[mm\].
    pub unit_mm: f64,
    /// The axis against gravity.
    pub up: Up,
    /// Whether y is negated after the turn, for readers that take coordinates into a left-handed space as they are.
    pub mirrored: bool,
}

impl Default for Space {
    /// Millimetres, Z up, right-handed.
    fn default() -> Self {
        Self { unit_mm: 1.0, up: Up::Z, mirrored: false }
    }
}

impl Space {
    /// From world vectors \[mm\] to the file's. The shortest turn takes the world's up (against `gravity`, any unit; Z
    /// without it) to Z; from there to Y up it is (x, y, z) → (x, z, −y), the turn that importers undo.
    pub fn linear_from_world(&self, gravity: Option<DVec3>) -> DMat3 {
        let up = gravity.and_then(|gravity| (-gravity).try_normalize()).unwrap_or(DVec3::Z);
        let z_up = DMat3::from_quat(DQuat::from_rotation_arc(up, DVec3::Z));
        let turned = match self.up {
            Up::Z => z_up,
            Up::Y => DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y) * z_up,
        };
        let mirror = DMat3::from_diagonal(DVec3::new(1.0, if self.mirrored { -1.0 } else { 1.0 }, 1.0));
        mirror * turned * (1.0 / self.unit_mm)
    }

    /// The unit in words.
    pub fn unit_name(&self) -> String {
        match self.unit_mm {
            1.0 => "millimetres".into(),
            10.0 => "centimetres".into(),
            1000.0 => "metres".into(),
            other => format!("units of {other} mm"),
        }
    }
}

/// A program that a file is meant for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// Unreal Engine.
    Unreal,
    /// Houdini.
    Houdini,
    /// Blender.
    Blender,
    /// Maya.
    Maya,
}

/// What carries the strands: importers of one program differ in what they assume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Carrier {
    /// Alembic: the file states neither unit nor axes.
    Alembic,
    /// USD: the file states both.
    Usd,
    /// OpenVDB: the file states neither.
    Vdb,
    /// OBJ: the file states neither.
    Obj,
}

impl Target {
    /// The space in which a file arrives upright and at its size with the importer's default settings.
    ///
    /// - Unreal counts centimetres, Z up, left-handed. Its groom importer takes Alembic coordinates as they are (rotation 0,
    ///   scale 1 by default), so y is negated here; its USD importer changes the handedness itself.
    /// - Blender's Alembic and OBJ importers take files for Y up and turn them; USD and OpenVDB arrive as they are.
    pub fn space(self, carrier: Carrier) -> Space {
        let space = |unit_mm, up| Space { unit_mm, up, mirrored: false };
        match (self, carrier) {
            (Self::Unreal, Carrier::Alembic) => Space { mirrored: true, ..space(10.0, Up::Z) },
            (Self::Unreal, _) => space(10.0, Up::Z),
            (Self::Blender, Carrier::Alembic | Carrier::Obj) => space(1000.0, Up::Y),
            (Self::Blender, _) => space(1000.0, Up::Z),
            (Self::Houdini, _) => space(1000.0, Up::Y),
            (Self::Maya, _) => space(10.0, Up::Y),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 180 mm above and 20 mm beside, in a world whose gravity points along +y.
    #[test]
    fn gravity_points_down_in_every_space() {
        let (gravity, point) = (Some(DVec3::Y * 9810.0), DVec3::new(20.0, -180.0, 0.0));
        for (target, carrier, expected) in [
            (Target::Unreal, Carrier::Alembic, DVec3::new(2.0, 0.0, 18.0)),
            (Target::Houdini, Carrier::Usd, DVec3::new(0.02, 0.18, 0.0)),
            (Target::Blender, Carrier::Usd, DVec3::new(0.02, 0.0, 0.18)),
            (Target::Blender, Carrier::Alembic, DVec3::new(0.02, 0.18, 0.0)),
            (Target::Maya, Carrier::Alembic, DVec3::new(2.0, 18.0, 0.0)),
        ] {
            let at = target.space(carrier).linear_from_world(gravity) * point;
            assert!(at.distance(expected) < 1e-9, "{target:?} {carrier:?}: {at}");
        }
    }

    #[test]
    fn only_unreal_s_alembic_is_mirrored() {
        for target in [Target::Unreal, Target::Houdini, Target::Blender, Target::Maya] {
            for carrier in [Carrier::Alembic, Carrier::Usd, Carrier::Vdb, Carrier::Obj] {
                let mirrored = target.space(carrier).linear_from_world(None).determinant() < 0.0;
                assert_eq!(mirrored, target == Target::Unreal && carrier == Carrier::Alembic);
            }
        }
    }
}
