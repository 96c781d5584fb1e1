//! What a reader of USD keeps of a layer: its unit and axis, its prims, and the attributes that strands need.

use std::collections::BTreeMap;

use glam::{DMat4, DQuat, DVec3, EulerRot, Vec3};

use crate::{Groom, Up};

/// A layer, parents before children.
#[derive(Debug, Default)]
pub(super) struct Layer {
    pub metres_per_unit: Option<f64>,
    pub up: Option<Up>,
    pub prims: Vec<Prim>,
}

#[derive(Debug, Default)]
pub(super) struct Prim {
    pub name: String,
    pub type_name: String,
    pub parent: Option<usize>,
    /// A class, or within one: it is there to be inherited from, not to be seen.
    pub is_abstract: bool,
    pub attributes: BTreeMap<String, Value>,
}

/// An attribute's default, or else its first time sample.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    Numbers(Vec<f64>),
    Names(Vec<String>),
}

/// Attributes that are read; the rest is passed over.
pub(super) fn is_needed(name: &str) -> bool {
    matches!(name, "points" | "curveVertexCounts" | "xformOpOrder") || name.starts_with("xformOp:")
}

/// The axis of a name.
pub(super) fn up_of(name: &str) -> Option<Up> {
    match name {
        "Y" => Some(Up::Y),
        "Z" => Some(Up::Z),
        _ => None,
    }
}

impl Prim {
    fn numbers(&self, name: &str) -> &[f64] {
        match self.attributes.get(name) {
            Some(Value::Numbers(numbers)) => numbers,
            _ => &[],
        }
    }

    /// The prim's transform; whether it is within its parent's.
    fn transform(&self) -> Result<(DMat4, bool), String> {
        let Some(Value::Names(order)) = self.attributes.get("xformOpOrder") else { return Ok((DMat4::IDENTITY, true)) };
        let (mut matrix, mut is_within) = (DMat4::IDENTITY, true);
        for name in order {
            if name == "!resetXformStack!" {
                (matrix, is_within) = (DMat4::IDENTITY, false);
                continue;
            }
            let (op, is_inverse) = name.strip_prefix("!invert!").map_or((name.as_str(), false), |op| (op, true));
            let kind = op.split(':').nth(1).unwrap_or_default();
            let step = operation(kind, self.numbers(op));
            let step = step.ok_or_else(|| format!("the transform `{op}` of `{}` is not understood", self.name))?;
            matrix *= if is_inverse { step.inverse() } else { step };
        }
        Ok((matrix, is_within))
    }
}

/// A transform operation; degrees, and matrices that act on row vectors.
fn operation(kind: &str, values: &[f64]) -> Option<DMat4> {
    let angles = |order: EulerRot, [first, second, third]: [usize; 3]| {
        let turn = |at: usize| Some(values.get(at)?.to_radians());
        // Turned about the first axis of the name first: the last one is outermost.
        Some(DMat4::from_euler(order, turn(third)?, turn(second)?, turn(first)?))
    };
    match (kind, values) {
        ("translate", &[x, y, z]) => Some(DMat4::from_translation(DVec3::new(x, y, z))),
        ("scale", &[x, y, z]) => Some(DMat4::from_scale(DVec3::new(x, y, z))),
        ("orient", &[w, x, y, z]) => Some(DMat4::from_quat(DQuat::from_xyzw(x, y, z, w).normalize())),
        ("transform", matrix) if matrix.len() == 16 => Some(DMat4::from_cols_slice(matrix)),
        ("rotateX", &[angle]) => Some(DMat4::from_rotation_x(angle.to_radians())),
        ("rotateY", &[angle]) => Some(DMat4::from_rotation_y(angle.to_radians())),
        ("rotateZ", &[angle]) => Some(DMat4::from_rotation_z(angle.to_radians())),
        ("rotateXYZ", _) => angles(EulerRot::ZYX, [0, 1, 2]),
        ("rotateXZY", _) => angles(EulerRot::YZX, [0, 2, 1]),
        ("rotateYXZ", _) => angles(EulerRot::ZXY, [1, 0, 2]),
        ("rotateYZX", _) => angles(EulerRot::XZY, [1, 2, 0]),
        ("rotateZXY", _) => angles(EulerRot::YXZ, [2, 0, 1]),
        ("rotateZYX", _) => angles(EulerRot::XYZ, [2, 1, 0]),
        _ => None,
    }
}

impl Layer {
    /// The curves of all `BasisCurves`, in the layer's space; \[mm\] where it states its unit.
    pub fn groom(&self) -> Result<Groom, String> {
        let unit_mm = self.metres_per_unit.map(|metres| metres * 1000.0);
        if unit_mm.is_some_and(|mm| !(mm.is_finite() && mm > 0.0)) {
            return Err("states an impossible `metersPerUnit`".into());
        }
        let scale = DMat4::from_scale(DVec3::splat(unit_mm.unwrap_or(1.0)));
        let mut world_from_prim: Vec<DMat4> = Vec::with_capacity(self.prims.len());
        let mut strands = Vec::new();
        for prim in &self.prims {
            let (matrix, is_within) = prim.transform()?;
            let parent = prim.parent.and_then(|at| world_from_prim.get(at)).filter(|_| is_within).copied();
            let placed = parent.unwrap_or(scale) * matrix;
            world_from_prim.push(placed);
            if prim.type_name == "BasisCurves" && !prim.is_abstract {
                strands.extend(curves(prim, placed)?);
            }
        }
        if strands.is_empty() {
            return Err("holds no BasisCurves of its own".into());
        }
        Ok(Groom { strands, unit_known: unit_mm.is_some(), up_axis: self.up })
    }
}

fn curves(prim: &Prim, world_from_prim: DMat4) -> Result<Vec<Vec<Vec3>>, String> {
    let (points, counts) = (prim.numbers("points").as_chunks::<3>().0, prim.numbers("curveVertexCounts"));
    let stated: f64 = counts.iter().sum();
    if counts.iter().any(|&count| count < 0.0) || stated != points.len() as f64 {
        return Err(format!("the curves `{}` have {} points, but count {stated}", prim.name, points.len()));
    }
    let mut rest = points;
    let strand = |count: &f64| {
        let (strand, behind) = rest.split_at(*count as usize);
        rest = behind;
        strand.iter().map(|&p| world_from_prim.transform_point3(DVec3::from_array(p)).as_vec3()).collect()
    };
    Ok(counts.iter().map(strand).collect())
}
