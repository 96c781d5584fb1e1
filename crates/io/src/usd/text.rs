//! USD as text (`.usda`). Attributes one after the other: each pass over the frames writes one attribute's samples.

use std::{fmt::Display, io::Write, path::Path};

use glam::{Vec2, Vec3};

use super::{LayerHead, up_axis};

use crate::{
    IoError,
    scene::{Sample, Scene, extent},
    whole_file::{Unfinished, write_whole},
};

pub(super) fn write(path: &Path, scene: &Scene) -> Result<(), IoError> {
    write_whole(path, |out| write_to(out, scene))
}

fn write_to(out: &mut impl Write, scene: &Scene) -> Result<(), Unfinished> {
    let width = scene.width();
    begin(out, &LayerHead::of(scene), ("strands", "BasisCurves"))?;
    writeln!(out, "        uniform token type = \"linear\"\n        uniform token wrap = \"nonperiodic\"")?;
    writeln!(out, "        int[] curveVertexCounts = [{}]", list(scene.curves.counts()))?;
    writeln!(out, "        float[] widths = [{width}] (\n            interpolation = \"constant\"\n        )")?;
    let ids = list(&scene.curves.strands);
    writeln!(out, "        int[] primvars:strand = [{ids}] (\n            interpolation = \"uniform\"\n        )")?;
    let uvs = coordinates(&scene.root_uvs);
    writeln!(out, "        texCoord2f[] primvars:st = [{uvs}] (\n            interpolation = \"uniform\"\n        )")?;
    samples(out, scene, "float3[] extent", "", |sample| points_text(&extent(&sample.points, width)))?;
    samples(out, scene, "point3f[] points", "", |sample| points_text(&sample.points))?;
    if scene.options.velocities {
        samples(out, scene, "vector3f[] velocities", "", |sample| points_text(&sample.velocities))?;
    }
    let vertex = " (\n            interpolation = \"vertex\"\n        )";
    samples(out, scene, "int[] primvars:provenance", vertex, |sample| list(&sample.provenance))?;
    samples(out, scene, "float[] primvars:confidence", vertex, |sample| list(&sample.confidence))?;
    Ok(writeln!(out, "    }}\n}}")?)
}

/// The layer's metadata, `/hair`, and the start of the prim below it: its name and type.
pub(super) fn begin(out: &mut impl Write, head: &LayerHead, (name, type_name): (&str, &str)) -> std::io::Result<()> {
    let (first, last, fps, metres) = (head.first(), head.last(), head.fps, head.metres_per_unit);
    let up = up_axis(head.up);
    write!(
        out,
        "#usda 1.0\n(\n    defaultPrim = \"hair\"\n    endTimeCode = {last}\n    framesPerSecond = {fps}\n    \
         metersPerUnit = {metres}\n    startTimeCode = {first}\n    timeCodesPerSecond = {fps}\n    upAxis = \"{up}\"\n)\n\n\
         def Xform \"hair\"\n{{\n    def {type_name} \"{name}\"\n    {{\n"
    )
}

/// An attribute with a value per frame; metadata belongs to its declaration, samples to a line of their own.
fn samples(
    out: &mut impl Write,
    scene: &Scene,
    what: &str,
    metadata: &str,
    text: impl Fn(&Sample) -> String,
) -> Result<(), Unfinished> {
    if !metadata.is_empty() {
        writeln!(out, "        {what}{metadata}")?;
    }
    writeln!(out, "        {what}.timeSamples = {{")?;
    for (t, time) in scene.times().into_iter().enumerate() {
        writeln!(out, "            {time}: [{}],", text(&scene.sample(t)?))?;
    }
    Ok(writeln!(out, "        }}")?)
}

pub(super) fn list<T: Display>(values: impl IntoIterator<Item = T>) -> String {
    values.into_iter().map(|value| value.to_string()).collect::<Vec<_>>().join(", ")
}

pub(super) fn coordinates(uvs: &[Vec2]) -> String {
    list(uvs.iter().map(|uv| format!("({}, {})", uv.x, uv.y)))
}

pub(super) fn points_text(points: &[Vec3]) -> String {
    list(points.iter().map(|p| format!("({}, {}, {})", p.x, p.y, p.z)))
}
