//! EasyMocap: `intri.yml` with `K_NAME` and `dist_NAME`, `extri.yml` with `Rot_NAME` (3×3) or `R_NAME` (rotation vector) and
//! `T_NAME`, world to camera with OpenCV axes and pixels, in metres; image sizes (`H_NAME`, `W_NAME`) are rarely there.

use std::{collections::BTreeMap, path::Path};

use glam::DVec3;

use super::{
    convention::Unit,
    dispatch::{read_bounded, text_of},
    opencv::{Node, fault},
    opencv_yaml,
    parts::{CameraParts, Lens, rows_from_rotation_vector, rows_of},
    settle::Described,
};
use crate::{IoError, error::At};

/// Whether a folder holds EasyMocap's two files.
pub(super) fn is_folder(folder: &Path) -> bool {
    ["intri.yml", "extri.yml"].iter().all(|name| folder.join(name).is_file())
}

/// What the two files of a folder say.
pub(super) fn described(folder: &Path) -> Result<Described, IoError> {
    let (intri, extri) = (folder.join("intri.yml"), folder.join("extri.yml"));
    let read = |file: &Path| opencv_yaml::parse(&text_of(file, read_bounded(file)?)?).map_err(fault(file));
    from_nodes((&intri, &read(&intri)?), (&extri, &read(&extri)?))
}

fn from_nodes(intri: (&Path, &Node), extri: (&Path, &Node)) -> Result<Described, IoError> {
    let (inner, outer) = (numbers_by_name(intri.1), numbers_by_name(extri.1));
    let names = names(intri.1, &inner);
    if names.is_empty() {
        let hint = "name the camera matrices K_NAME, as EasyMocap does";
        return Err(IoError::content(intri.0, At::FILE, "holds no camera matrix", hint));
    }
    let cameras = names.into_iter().map(|name| camera(intri.0, extri.0, name, &inner, &outer));
    let cameras = cameras.collect::<Result<_, _>>()?;
    Ok(Described::opencv("EasyMocap", cameras, Unit::Customary(1000.0), 0.0))
}

type Numbers<'a> = BTreeMap<&'a str, &'a [f64]>;

fn numbers_by_name(root: &Node) -> Numbers<'_> {
    let Node::Map(entries) = root else { return Numbers::new() };
    let numbers = entries.iter().filter_map(|(key, node)| match node {
        Node::Numbers(values) => Some((key.as_str(), values.as_slice())),
        _ => None,
    });
    numbers.collect()
}

/// The list `names` where all of it have a matrix; otherwise every name that has one, in the order of the file.
fn names<'a>(root: &'a Node, numbers: &Numbers<'_>) -> Vec<&'a str> {
    let Node::Map(entries) = root else { return Vec::new() };
    let listed = entries.iter().find(|(key, _)| key == "names").and_then(|(_, node)| match node {
        Node::Map(items) => items
            .iter()
            .map(|(_, item)| match item {
                Node::Text(name) if numbers.contains_key(format!("K_{name}").as_str()) => Some(name.as_str()),
                _ => None,
            })
            .collect::<Option<Vec<_>>>(),
        _ => None,
    });
    let all = || entries.iter().filter_map(|(key, _)| key.strip_prefix("K_")).collect();
    listed.filter(|names| !names.is_empty()).unwrap_or_else(all)
}

fn camera(
    intri: &Path,
    extri: &Path,
    name: &str,
    inner: &Numbers<'_>,
    outer: &Numbers<'_>,
) -> Result<CameraParts, IoError> {
    let lacks = |file: &Path, what: &str| {
        let hint = "calibrate the extrinsics of every camera with EasyMocap, and keep both files in one folder";
        IoError::content(file, At::view(name), format!("has no {what}"), hint)
    };
    let of = |numbers: &Numbers<'_>, key: &str| numbers.get(format!("{key}_{name}").as_str()).map(|v| v.to_vec());
    let k = of(inner, "K").and_then(|v| rows_of(&v)).ok_or_else(|| lacks(intri, "3x3 matrix K_"))?;
    let vector = || of(outer, "R").and_then(|v| <[f64; 3]>::try_from(v).ok()).map(DVec3::from);
    let rotation = of(outer, "Rot")
        .and_then(|v| rows_of(&v))
        .or_else(|| vector().map(rows_from_rotation_vector))
        .ok_or_else(|| lacks(extri, "rotation Rot_ or R_"))?;
    let translation =
        of(outer, "T").and_then(|v| <[f64; 3]>::try_from(v).ok()).ok_or_else(|| lacks(extri, "translation T_"))?;
    let side = |key: &str| of(inner, key).and_then(|v| v.first().copied()).map(|side| side as usize);
    Ok(CameraParts {
        name: name.to_owned(),
        size: side("W").zip(side("H")).map(|(w, h)| [w, h]),
        k,
        lens: Lens::OpenCv(of(inner, "dist").or_else(|| of(inner, "D")).unwrap_or_default()),
        rotation,
        translation,
    })
}
