//! The strands of the curves of an archive: control points of the first samples, in the space above all transforms.

use std::io::{Read, Seek};

use glam::{DMat4, DVec3, Vec3};

use super::reader::{Archive, Object, Property};
use crate::Groom;

/// Objects within objects: deeper trees are damage.
const DEEPEST: usize = 256;

pub(super) fn groom(source: &mut (impl Read + Seek)) -> Result<Groom, String> {
    let (archive, top) = Archive::open(source)?;
    let mut walk = Walk { archive, strands: Vec::new(), guides: Vec::new() };
    walk.below(&top, DMat4::IDENTITY, 0)?;
    // Guides repeat what the strands show; a file of guides alone is a groom all the same.
    let strands = if walk.strands.is_empty() { walk.guides } else { walk.strands };
    if strands.is_empty() {
        return Err("holds no curves".into());
    }
    Ok(Groom { strands, unit_known: false, up_axis: None })
}

struct Walk<'a, R> {
    archive: Archive<'a, R>,
    strands: Vec<Vec<Vec3>>,
    guides: Vec<Vec<Vec3>>,
}

impl<R: Read + Seek> Walk<'_, R> {
    fn below(&mut self, object: &Object, world_from_parent: DMat4, depth: usize) -> Result<(), String> {
        if depth > DEEPEST {
            return Err("is damaged: its objects contain each other".into());
        }
        let mut world_from_object = world_from_parent;
        if is(object, "AbcGeom_Xform") {
            if let Some(schema) = self.schema(object, ".xform")? {
                world_from_object = self.transform(&schema, world_from_parent)?;
            }
        } else if is(object, "AbcGeom_Curve")
            && let Some(schema) = self.schema(object, ".geom")?
        {
            self.curves(&object.name, &schema, world_from_object)?;
        }
        for child in self.archive.objects(object)? {
            self.below(&child, world_from_object, depth + 1)?;
        }
        Ok(())
    }

    fn schema(&mut self, object: &Object, name: &str) -> Result<Option<Vec<Property>>, String> {
        let properties = self.archive.properties(object)?;
        let schema = properties.iter().find(|property| property.name == name);
        schema.map(|schema| self.archive.inner(schema)).transpose()
    }

    fn numbers(&mut self, properties: &[Property], name: &str) -> Result<Option<Vec<f64>>, String> {
        match properties.iter().find(|property| property.name == name) {
            Some(property) => self.archive.numbers(property),
            None => Ok(None),
        }
    }

    fn transform(&mut self, schema: &[Property], world_from_parent: DMat4) -> Result<DMat4, String> {
        let inherits = self.numbers(schema, ".inherits")?.is_none_or(|flag| flag.first() != Some(&0.0));
        let start = if inherits { world_from_parent } else { DMat4::IDENTITY };
        let ops = self.numbers(schema, ".ops")?.unwrap_or_default();
        let values = self.numbers(schema, ".vals")?.unwrap_or_default();
        Ok(start * parent_from_object(&ops, &values).ok_or("is damaged: a transform lacks numbers")?)
    }

    fn curves(&mut self, name: &str, schema: &[Property], world_from_object: DMat4) -> Result<(), String> {
        let (Some(points), Some(counts)) = (self.numbers(schema, "P")?, self.numbers(schema, "nVertices")?) else {
            return Ok(());
        };
        let points = points.as_chunks::<3>().0;
        let stated: f64 = counts.iter().sum();
        if counts.iter().any(|&count| count < 0.0) || stated != points.len() as f64 {
            return Err(format!("the curves `{name}` have {} points, but count {stated}", points.len()));
        }
        let is_guide = self.guides_among(schema)?;
        let mut rest = points;
        for (n, count) in counts.iter().enumerate() {
            let (strand, behind) = rest.split_at(*count as usize);
            rest = behind;
            let place = |&p: &[f64; 3]| world_from_object.transform_point3(DVec3::from_array(p)).as_vec3();
            let strand = strand.iter().map(place).collect();
            // One flag for all, or one a curve.
            let flag = if is_guide.len() == counts.len() { is_guide.get(n) } else { is_guide.first() };
            let to = if flag.is_some_and(|flag| *flag != 0.0) { &mut self.guides } else { &mut self.strands };
            to.push(strand);
        }
        Ok(())
    }

    /// `groom_guide` of Unreal's schema, by itself or as a compound of values and their indices; empty without it.
    fn guides_among(&mut self, schema: &[Property]) -> Result<Vec<f64>, String> {
        for home in [".arbGeomParams", ".userProperties"] {
            let Some(home) = schema.iter().find(|property| property.name == home).cloned() else { continue };
            let attributes = self.archive.inner(&home)?;
            let Some(guide) = attributes.iter().find(|property| property.name == "groom_guide") else { continue };
            if let Some(flags) = self.archive.numbers(guide)? {
                return Ok(flags);
            }
            let parts = self.archive.inner(guide)?;
            let values = self.numbers(&parts, ".vals")?.unwrap_or_default();
            let indices = self.numbers(&parts, ".indices")?.unwrap_or_default();
            return Ok(indices.iter().map(|&at| values.get(at as usize).copied().unwrap_or(0.0)).collect());
        }
        Ok(Vec::new())
    }
}

fn is(object: &Object, schema: &str) -> bool {
    object.metadata.split(';').any(|pair| pair.strip_prefix("schema=").is_some_and(|name| name.starts_with(schema)))
}

/// The operations of a transform, the outermost first: the upper four bits are the kind. Angles are in degrees; matrices act on
/// row vectors. `None` if there are fewer numbers than the operations take.
fn parent_from_object(ops: &[f64], values: &[f64]) -> Option<DMat4> {
    let mut values = values;
    let mut matrix = DMat4::IDENTITY;
    for &op in ops {
        let kind = op as u8 >> 4;
        let (taken, rest) = values.split_at_checked(match kind {
            0 | 1 => 3,
            2 => 4,
            3 => 16,
            _ => 1,
        })?;
        values = rest;
        matrix *= match kind {
            0 => DMat4::from_scale(DVec3::from_slice(taken)),
            1 => DMat4::from_translation(DVec3::from_slice(taken)),
            2 => match DVec3::from_slice(taken).try_normalize() {
                Some(axis) => DMat4::from_axis_angle(axis, taken[3].to_radians()),
                None => DMat4::IDENTITY,
            },
            // Rows of row vectors lie as columns of column vectors do.
            3 => DMat4::from_cols_slice(taken),
            4 => DMat4::from_rotation_x(taken[0].to_radians()),
            5 => DMat4::from_rotation_y(taken[0].to_radians()),
            6 => DMat4::from_rotation_z(taken[0].to_radians()),
            _ => return None,
        };
    }
    Some(matrix)
}
