//! Wavefront OBJ meshes: vertices and faces; all else in such files is passed over.

use std::path::Path;

use glam::DVec3;
use strandflow_core::TriMesh;

use crate::error::{At, IoError};

/// Reads vertices and faces, polygons as fans, in the file's unit.
///
/// # Errors
/// The file cannot be read, a line is not what it says it is, a face names a vertex that is not there, or there is no face.
pub fn read_obj(path: &Path) -> Result<TriMesh, IoError> {
    let text = std::fs::read_to_string(path).map_err(IoError::reading(path))?;
    let wrong = |line: usize, fact: String| {
        let hint = "write the mesh anew as a Wavefront OBJ of `v x y z` and `f i j k` lines";
        IoError::content(path, if line == 0 { At::FILE } else { At::line(line) }, fact, hint)
    };
    let mut mesh = TriMesh::default();
    for (n, line) in text.lines().enumerate() {
        let mut words = line.split_whitespace();
        let read = match words.next() {
            Some("v") => vertex(words).map(|vertex| mesh.vertices.push(vertex)),
            Some("f") => polygon(words, mesh.vertices.len()).map(|corners| {
                mesh.faces.extend(corners[1..].windows(2).map(|pair| [corners[0], pair[0], pair[1]]));
            }),
            _ => Ok(()),
        };
        read.map_err(|fact| wrong(n + 1, fact))?;
    }
    if mesh.faces.is_empty() {
        return Err(wrong(0, "holds no faces".into()));
    }
    Ok(mesh)
}

fn vertex<'a>(words: impl Iterator<Item = &'a str>) -> Result<DVec3, String> {
    let numbers: Vec<f64> = words.map_while(|word| word.parse().ok()).filter(|x: &f64| x.is_finite()).collect();
    match numbers[..] {
        [x, y, z, ..] => Ok(DVec3::new(x, y, z)),
        _ => Err("a vertex is not three numbers".into()),
    }
}

/// Vertex numbers of a face, from 0; negative ones count from the newest vertex back.
fn polygon<'a>(words: impl Iterator<Item = &'a str>, vertices: usize) -> Result<Vec<u32>, String> {
    let corner = |word: &str| {
        let number: i64 = word.split('/').next().and_then(|first| first.parse().ok())?;
        let index = if number < 0 { vertices as i64 + number } else { number - 1 };
        (0..vertices as i64).contains(&index).then_some(index as u32)
    };
    let corners: Option<Vec<u32>> = words.map(corner).collect();
    match corners {
        Some(corners) if corners.len() >= 3 => Ok(corners),
        Some(_) => Err("a face has fewer than three corners".into()),
        None => Err(format!("a face names a vertex that is not among the {vertices} before it")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<TriMesh, IoError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.obj");
        std::fs::write(&path, text).unwrap();
        read_obj(&path)
    }

    #[test]
    fn polygons_become_fans_and_numbers_may_count_back() {
        let square = "# x\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
        let fan = [[0, 1, 2], [0, 2, 3]];
        assert_eq!(read(&format!("{square}f 1/1 2/2 3/3 4/4\n")).unwrap().faces, fan);
        assert_eq!(read(&format!("{square}f -4//1 -3//1 -2//1 -1//1\n")).unwrap().faces, fan);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        for (text, line, fact) in [
            ("v 0 0 0\nf 1 2 3\n", ":2", "among the 1"),
            ("v 0 0\n", ":1", "three numbers"),
            ("v 0 nan 0\n", ":1", "three numbers"),
            ("v 0 0 0\nv 1 0 0\nf 1 2\n", ":3", "fewer than three"),
            ("v 0 0 0\n", "a.obj", "no faces"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.place().ends_with(line) && error.fact().contains(fact), "{error}");
        }
    }
}
