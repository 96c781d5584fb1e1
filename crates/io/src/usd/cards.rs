//! Hair cards as one animated USD `Mesh` of constant topology.
//!
//! Cards one after the other as in the OBJ files; every card is a strip of quads. `primvars:st` is that of the first frame, since
//! textures must not swim; `primvars:strand` names each face's guide.

use std::{io::Write, path::Path};

use glam::{Vec2, Vec3};

use super::{
    Form, LayerHead,
    crate_file::{Attribute, Crate, write_layer},
    text::{begin, coordinates, list, points_text},
};
use crate::{
    IoError,
    scene::extent,
    whole_file::{Unfinished, write_whole},
};

/// What of a mesh stays.
pub(crate) struct CardMesh<'a> {
    pub head: &'a crate::scene::Scene<'a>,
    /// Points along each card.
    pub rows: Vec<usize>,
    /// Guide's strand of each card.
    pub strands: Vec<i32>,
    /// Of each vertex.
    pub uvs: Vec<Vec2>,
}

/// What of a mesh moves: of each vertex.
pub(crate) struct CardSample {
    pub points: Vec<Vec3>,
    pub normals: Vec<Vec3>,
}

impl CardMesh<'_> {
    fn face_count(&self) -> usize {
        self.rows.iter().map(|rows| rows - 1).sum()
    }

    /// Corners of all quads, anticlockwise seen from outside.
    fn corners(&self) -> Vec<i32> {
        let mut first = 0;
        let mut corners = Vec::with_capacity(4 * self.face_count());
        for rows in &self.rows {
            for row in 0..rows - 1 {
                let left = first + 2 * row as i32;
                corners.extend([left, left + 1, left + 3, left + 2]);
            }
            first += 2 * *rows as i32;
        }
        corners
    }

    fn strand_of_face(&self) -> Vec<i32> {
        let faces = self.rows.iter().zip(&self.strands);
        faces.flat_map(|(rows, strand)| std::iter::repeat_n(*strand, rows - 1)).collect()
    }
}

/// Writes cards; the ending of the file decides the form. `sample` gives the vertices of the `t`-th frame.
///
/// # Errors
/// The ending is none of USD's, a frame cannot be read, or the file cannot be written; the file is then as it was before.
pub(crate) fn write_cards(
    path: &Path,
    mesh: &CardMesh,
    sample: impl Fn(usize) -> Result<CardSample, IoError>,
) -> Result<(), IoError> {
    let head = LayerHead::of(mesh.head);
    match Form::of(path)? {
        Form::Text => write_whole(path, |out| write_text(out, &head, mesh, &sample)),
        Form::Crate => write_layer(path, &head, ("cards", "Mesh"), |file| values(file, &head, mesh, &sample)),
    }
}

fn values(
    file: &mut Crate,
    head: &LayerHead,
    mesh: &CardMesh,
    sample: &impl Fn(usize) -> Result<CardSample, IoError>,
) -> Result<Vec<Attribute>, Unfinished> {
    let mut attributes = vec![
        Attribute { uniform: true, default: Some(Crate::boolean(true)), ..Attribute::new("doubleSided", "bool") },
        Attribute {
            uniform: true,
            default: Some(file.token_value("none")),
            ..Attribute::new("subdivisionScheme", "token")
        },
        Attribute {
            default: Some(file.ints(&vec![4; mesh.face_count()])?),
            ..Attribute::new("faceVertexCounts", "int[]")
        },
        Attribute { default: Some(file.ints(&mesh.corners())?), ..Attribute::new("faceVertexIndices", "int[]") },
        Attribute {
            default: Some(file.coordinates(&mesh.uvs)?),
            interpolation: Some("vertex"),
            ..Attribute::new("primvars:st", "texCoord2f[]")
        },
        Attribute {
            default: Some(file.ints(&mesh.strand_of_face())?),
            interpolation: Some("uniform"),
            ..Attribute::new("primvars:strand", "int[]")
        },
    ];
    let mut samples: [Vec<u64>; 3] = Default::default();
    for t in 0..head.times.len() {
        let CardSample { points, normals } = sample(t)?;
        samples[0].push(file.vectors(&extent(&points, 0.0))?);
        samples[1].push(file.vectors(&points)?);
        samples[2].push(file.vectors(&normals)?);
    }
    let times = file.doubles(&head.times)?;
    for (values, (name, type_name, interpolation)) in samples.iter().zip([
        ("extent", "float3[]", None),
        ("points", "point3f[]", None),
        ("normals", "normal3f[]", Some("vertex")),
    ]) {
        let samples = Some(file.time_samples(times, values)?);
        attributes.push(Attribute { samples, interpolation, ..Attribute::new(name, type_name) });
    }
    Ok(attributes)
}

fn write_text(
    out: &mut impl Write,
    head: &LayerHead,
    mesh: &CardMesh,
    sample: &impl Fn(usize) -> Result<CardSample, IoError>,
) -> Result<(), Unfinished> {
    begin(out, head, ("cards", "Mesh"))?;
    writeln!(out, "        uniform bool doubleSided = 1\n        uniform token subdivisionScheme = \"none\"")?;
    writeln!(out, "        int[] faceVertexCounts = [{}]", list(vec![4; mesh.face_count()]))?;
    writeln!(out, "        int[] faceVertexIndices = [{}]", list(mesh.corners()))?;
    let interpolated = |kind: &str| format!(" (\n            interpolation = \"{kind}\"\n        )");
    let uvs = coordinates(&mesh.uvs);
    writeln!(out, "        texCoord2f[] primvars:st = [{uvs}]{}", interpolated("vertex"))?;
    let strands = list(mesh.strand_of_face());
    writeln!(out, "        int[] primvars:strand = [{strands}]{}", interpolated("uniform"))?;
    // Metadata belongs to a declaration, samples to a line of their own.
    writeln!(out, "        normal3f[] normals{}", interpolated("vertex"))?;
    type Part = fn(&CardSample) -> String;
    let parts: [(&str, Part); 3] = [
        ("float3[] extent", |sample| points_text(&extent(&sample.points, 0.0))),
        ("point3f[] points", |sample| points_text(&sample.points)),
        ("normal3f[] normals", |sample| points_text(&sample.normals)),
    ];
    for (what, part) in parts {
        writeln!(out, "        {what}.timeSamples = {{")?;
        for (t, time) in head.times.iter().enumerate() {
            writeln!(out, "            {time}: [{}],", part(&sample(t)?))?;
        }
        writeln!(out, "        }}")?;
    }
    Ok(writeln!(out, "    }}\n}}")?)
}
