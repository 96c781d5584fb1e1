//! The tree of objects and the tables of an Alembic archive.

use std::io::Result;

use super::{
    ogawa::{Child, Ogawa, key},
    property::{Body, Pod, Property, Samples, Shape, write_compound},
};

/// The version of Alembic's library whose archives these are like (1.8.5), as its number.
const LIKE_LIBRARY: i32 = 10805;

/// Evenly spaced frames.
pub(super) struct Timing {
    /// Seconds.
    start: f64,
    /// Seconds.
    step: f64,
    count: u32,
}

impl Timing {
    /// `None` where frames are not evenly spaced.
    pub fn of(frames: &[u32], fps: f64) -> Option<Self> {
        let stride = frames.windows(2).next().map_or(Some(1), |pair| pair[1].checked_sub(pair[0]))?;
        let even = stride > 0 && frames.windows(2).all(|pair| pair[1].checked_sub(pair[0]) == Some(stride));
        let start = f64::from(*frames.first()?) / fps;
        even.then_some(Self { start, step: f64::from(stride) / fps, count: frames.len() as u32 })
    }
}

/// An object that is written but for its place in the tree.
pub(super) struct Object {
    pub name: &'static str,
    pub metadata: &'static str,
    pub group: Child,
    /// Hashes of its properties and of its children.
    pub hashes: [u8; 32],
}

impl Object {
    /// Writes an object: its properties, its children, their headers.
    pub fn write(
        file: &mut Ogawa,
        (name, metadata): (&'static str, &'static str),
        properties: &[Property],
        children: &[Self],
    ) -> Result<Self> {
        let mut keys = Vec::new();
        let mut group = vec![write_compound(file, properties, &mut keys)?];
        group.extend(children.iter().map(|child| child.group));
        let mut headers = Vec::new();
        for child in children {
            headers.extend((child.name.len() as u32).to_le_bytes());
            headers.extend(child.name.bytes());
            headers.push(METADATA_INLINE);
            headers.extend((child.metadata.len() as u32).to_le_bytes());
            headers.extend(child.metadata.bytes());
        }
        let below: Vec<u8> = children.iter().flat_map(|child| child.hashes).chain(headers.iter().copied()).collect();
        let mut hashes = [0; 32];
        hashes[..16].copy_from_slice(&key(&keys));
        hashes[16..].copy_from_slice(&key(&below));
        headers.extend(hashes);
        group.push(file.data(&headers)?);
        Ok(Self { name, metadata, group: file.group(&group)?, hashes })
    }
}

/// The metadata follows in full, rather than by number in the archive's table.
const METADATA_INLINE: u8 = 0xff;

/// Writes `/hair` over the transforms of its curves, and the archive's tables.
pub(super) fn finish(mut file: Ogawa, curves: Vec<Object>, timing: &Timing) -> Result<()> {
    // Importers name curves after the transform above them.
    let mut parts = Vec::new();
    for curves in curves {
        parts.push(transform(&mut file, curves.name, Vec::new(), &[curves])?);
    }
    let hair = hair(&mut file, &parts)?;
    let top = Object::write(&mut file, ("ABC", ""), &[], &[hair])?;
    let format = file.data(&0i32.to_le_bytes())?;
    let library = file.data(&LIKE_LIBRARY.to_le_bytes())?;
    let about = concat!("_ai_AlembicVersion=1.8.5;_ai_Application=strandflow ", env!("CARGO_PKG_VERSION"));
    let about = file.data(about.as_bytes())?;
    let times = file.data(&time_samplings(timing))?;
    // No table of metadata: every header carries its own.
    let root = file.group(&[format, library, top.group, about, times, Child::EMPTY_DATA])?;
    file.finish(root)
}

/// Properties of the whole groom belong on the first transform, as scalars.
fn hair(file: &mut Ogawa, parts: &[Object]) -> Result<Object> {
    let tool = concat!("strandflow ", env!("CARGO_PKG_VERSION"), "\0");
    let user = vec![
        scalar(file, "groom_version_major", Pod::Int16, &1i16.to_le_bytes())?,
        scalar(file, "groom_version_minor", Pod::Int16, &4i16.to_le_bytes())?,
        scalar(file, "groom_tool", Pod::Text, tool.as_bytes())?,
    ];
    let user = Property { name: ".userProperties", metadata: "", body: Body::Compound(user) };
    transform(file, "hair", vec![user], parts)
}

/// A transform that does nothing over some objects.
fn transform(file: &mut Ogawa, name: &'static str, properties: Vec<Property>, children: &[Object]) -> Result<Object> {
    let schema = Property { name: ".xform", metadata: "schema=AbcGeom_Xform_v3", body: Body::Compound(properties) };
    let metadata = "schema=AbcGeom_Xform_v3;schemaObjTitle=AbcGeom_Xform_v3:.xform";
    Object::write(file, (name, metadata), &[schema], children)
}

fn scalar(file: &mut Ogawa, name: &'static str, pod: Pod, bytes: &[u8]) -> Result<Property> {
    Ok(Property { name, metadata: "", body: Samples::of(file, (pod, 1, Shape::Scalar), bytes)? })
}

/// Each: the most samples, seconds a cycle, the times that are stored. Number 0 is for what does not move.
fn time_samplings(timing: &Timing) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (count, step, start) in [(1u32, 1.0f64, 0.0f64), (timing.count, timing.step, timing.start)] {
        bytes.extend(count.to_le_bytes());
        bytes.extend(step.to_le_bytes());
        bytes.extend(1u32.to_le_bytes());
        bytes.extend(start.to_le_bytes());
    }
    bytes
}
