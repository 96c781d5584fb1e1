//! The strands' curves as values of a crate file.

use std::path::Path;

use super::{
    LayerHead,
    crate_file::{Attribute, Crate, write_layer},
};
use crate::{
    IoError,
    scene::{Scene, extent},
    whole_file::Unfinished,
};

pub(super) fn write(path: &Path, scene: &Scene) -> Result<(), IoError> {
    write_layer(path, &LayerHead::of(scene), ("strands", "BasisCurves"), |file| values(file, scene))
}

/// Writes all values, frames in order, and says where they lie.
fn values(file: &mut Crate, scene: &Scene) -> Result<Vec<Attribute>, Unfinished> {
    let linear =
        Attribute { uniform: true, default: Some(file.token_value("linear")), ..Attribute::new("type", "token") };
    let wrap =
        Attribute { uniform: true, default: Some(file.token_value("nonperiodic")), ..Attribute::new("wrap", "token") };
    let counts: Vec<i32> = scene.curves.counts().iter().map(|&count| count as i32).collect();
    let counts = Attribute { default: Some(file.ints(&counts)?), ..Attribute::new("curveVertexCounts", "int[]") };
    let widths = Attribute {
        default: Some(file.floats(&[scene.width()])?),
        interpolation: Some("constant"),
        ..Attribute::new("widths", "float[]")
    };
    let ids: Vec<i32> = scene.curves.strands.iter().map(|&id| id as i32).collect();
    let ids = Attribute {
        default: Some(file.ints(&ids)?),
        interpolation: Some("uniform"),
        ..Attribute::new("primvars:strand", "int[]")
    };
    let uvs = Attribute {
        default: Some(file.coordinates(&scene.root_uvs)?),
        interpolation: Some("uniform"),
        ..Attribute::new("primvars:st", "texCoord2f[]")
    };

    let times = scene.times();
    let mut samples: [Vec<u64>; 5] = Default::default();
    for t in 0..times.len() {
        let sample = scene.sample(t)?;
        samples[0].push(file.vectors(&extent(&sample.points, scene.width()))?);
        samples[1].push(file.vectors(&sample.points)?);
        samples[2].push(file.vectors(&sample.velocities)?);
        samples[3].push(file.ints(&sample.provenance)?);
        samples[4].push(file.floats(&sample.confidence)?);
    }
    let times = file.doubles(&times)?;
    let mut moving = Vec::new();
    for (values, (name, type_name)) in samples.iter().zip([
        ("extent", "float3[]"),
        ("points", "point3f[]"),
        ("velocities", "vector3f[]"),
        ("primvars:provenance", "int[]"),
        ("primvars:confidence", "float[]"),
    ]) {
        if name == "velocities" && !scene.options.velocities {
            continue;
        }
        let interpolation = name.starts_with("primvars").then_some("vertex");
        let samples = Some(file.time_samples(times, values)?);
        moving.push(Attribute { samples, interpolation, ..Attribute::new(name, type_name) });
    }
    Ok([linear, wrap, counts, widths, ids, uvs].into_iter().chain(moving).collect())
}
