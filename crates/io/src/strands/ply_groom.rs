//! Strands from PLY (ASCII or binary little endian), of ours and of point clouds in strand order.
//!
//! What belongs to a strand is told by, in this order: `edge` elements, whose chains are the strands (the end earlier in the
//! file is the root); a vertex property `strand`, whose runs are the strands; `comment points_per_strand N`, or 100 (as
//! NeuralHaircut and GaussianHaircut write), points in a row.

use std::path::Path;

use glam::Vec3;

use super::ply_elements::{Elements, Numbers, Row};
use crate::{Groom, IoError, groom::from_bytes};

/// Points of a strand in files that say nothing about it.
const USUAL_POINTS: usize = 100;

/// What [`super::write_ply`](crate::write_ply) writes into the header.
const OURS: &str = "strandflow strands, world millimetres";

/// Reads a groom.
pub(crate) fn read(path: &Path) -> Result<Groom, IoError> {
    let hint =
        "write vertices x, y, z strand by strand, with edges, a property `strand`, or `comment points_per_strand N`";
    from_bytes(path, hint, groom)
}

fn groom(data: &[u8]) -> Result<Groom, String> {
    let (elements, mut numbers) = Elements::of(data)?;
    let cloud = Cloud::read(&elements, &mut numbers)?;
    let strands = if !cloud.edges.is_empty() {
        cloud.chains()?
    } else if !cloud.strand.is_empty() {
        cloud.runs()
    } else {
        cloud.rows(elements.comment("points_per_strand"))?
    };
    Ok(Groom { strands, unit_known: elements.comments.iter().any(|words| words.starts_with(OURS)), up_axis: None })
}

#[derive(Default)]
struct Cloud {
    points: Vec<Vec3>,
    /// The strand of each point; empty where the file does not say.
    strand: Vec<i64>,
    edges: Vec<[usize; 2]>,
}

impl Cloud {
    fn read(elements: &Elements, numbers: &mut Numbers) -> Result<Self, String> {
        let mut cloud = Self::default();
        // Rows of a second list would go by other columns.
        let lists = elements.all.iter().filter(|element| element.name == "vertex").count();
        if lists > 1 {
            return Err(format!("it has {lists} `vertex` elements, one is read"));
        }
        for element in &elements.all {
            let column = |name: &str| element.columns.iter().position(|column| column.name == name);
            let lacks = |name: &str| format!("its {} elements have no `{name}`", element.name);
            match element.name.as_str() {
                "vertex" => {
                    let [x, y, z] = ["x", "y", "z"].map(|name| column(name).ok_or_else(|| lacks(name)));
                    let (x, y, z, strand) = (x?, y?, z?, column("strand"));
                    numbers.rows(element, |row: &Row| {
                        cloud.points.push(Vec3::new(row[x] as f32, row[y] as f32, row[z] as f32));
                        cloud.strand.extend(strand.map(|at| row[at] as i64));
                        Ok(())
                    })?;
                }
                "edge" => {
                    let [a, b] = ["vertex1", "vertex2"].map(|name| column(name).ok_or_else(|| lacks(name)));
                    let (a, b, count) = (a?, b?, cloud.points.len());
                    numbers.rows(element, |row: &Row| {
                        let ends = [row[a], row[b]].map(|x| x as i64 as usize);
                        if ends.iter().any(|&end| end >= count) {
                            return Err(format!("an edge names the vertex {}, of {count}", ends[0].max(ends[1])));
                        }
                        cloud.edges.push(ends);
                        Ok(())
                    })?;
                }
                _ => numbers.rows(element, |_| Ok(()))?,
            }
        }
        Ok(cloud)
    }

    /// Vertices along edges; a vertex without an edge is a strand of one point.
    fn chains(&self) -> Result<Vec<Vec<Vec3>>, String> {
        let mut near: Vec<[Option<usize>; 2]> = vec![[None; 2]; self.points.len()];
        for &[a, b] in &self.edges {
            for (from, to) in [(a, b), (b, a)] {
                let free = near[from].iter_mut().find(|end| end.is_none());
                *free.ok_or_else(|| format!("the vertex {from} has more than two edges: strands do not branch"))? =
                    Some(to);
            }
        }
        let mut strands = Vec::new();
        let mut taken = vec![false; self.points.len()];
        for root in (0..self.points.len()).filter(|&at| near[at][1].is_none()) {
            if taken[root] {
                continue;
            }
            let (mut strand, mut next) = (Vec::new(), Some(root));
            while let Some(at) = next {
                taken[at] = true;
                strand.push(self.points[at]);
                next = near[at].iter().flatten().copied().find(|&to| !taken[to]);
            }
            strands.push(strand);
        }
        match taken.iter().position(|taken| !taken) {
            Some(at) => Err(format!("the edges of vertex {at} form a ring")),
            None => Ok(strands),
        }
    }

    fn runs(&self) -> Vec<Vec<Vec3>> {
        let mut strands: Vec<Vec<Vec3>> = Vec::new();
        for (at, &point) in self.points.iter().enumerate() {
            match strands.last_mut() {
                Some(strand) if self.strand[at] == self.strand[at - 1] => strand.push(point),
                _ => strands.push(vec![point]),
            }
        }
        strands
    }

    fn rows(&self, stated: Option<usize>) -> Result<Vec<Vec<Vec3>>, String> {
        let length = stated.unwrap_or(USUAL_POINTS);
        if length == 0 || !self.points.len().is_multiple_of(length) {
            let count = self.points.len();
            let why = if stated.is_some() { "as it states" } else { "taken since it has neither edges nor `strand`" };
            return Err(format!("its {count} vertices do not divide into strands of {length} points ({why})"));
        }
        Ok(self.points.chunks(length).map(<[Vec3]>::to_vec).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strands::{Interchange, ply::write_ply, sample};
    use proptest::prelude::*;

    fn ours() -> Vec<u8> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.ply");
        write_ply(&path, &Interchange::new(&sample()).unwrap(), 0).unwrap();
        std::fs::read(&path).unwrap()
    }

    fn lengths(groom: &Groom) -> Vec<usize> {
        groom.strands.iter().map(Vec::len).collect()
    }

    #[test]
    fn ours_comes_back() {
        let read = groom(&ours()).unwrap();
        assert_eq!((lengths(&read), read.unit_known), (vec![5, 3, 4], true));
        assert_eq!(read.strands[1], sample().strand(0, 2));
    }

    /// Points (i, 0, 0); `more`: further lines of the header and rows.
    fn ascii(points: usize, header: &str, rows: &str) -> String {
        let cloud: String = (0..points).map(|i| format!("{i} 0 0 255\n")).collect();
        format!(
            "ply\nformat ascii 1.0\nelement vertex {points}\nproperty double x\nproperty double y\nproperty double z\n\
             property uchar red\n{header}end_header\n{cloud}{rows}"
        )
    }

    #[test]
    fn clouds_are_cut_by_a_hundred_or_as_they_state() {
        let read = groom(ascii(200, "", "").as_bytes()).unwrap();
        assert_eq!((lengths(&read), read.unit_known, read.strands[1][0].x), (vec![100, 100], false, 100.0));
        let stated = ascii(6, "comment points_per_strand 3\n", "");
        assert_eq!(lengths(&groom(stated.as_bytes()).unwrap()), [3, 3]);
        assert!(groom(ascii(150, "", "").as_bytes()).unwrap_err().contains("do not divide into strands of 100"));
    }

    #[test]
    fn edges_make_strands_in_any_order() {
        let header = "element face 1\nproperty list uchar int vertex_indices\n\
                      element edge 3\nproperty int vertex1\nproperty int vertex2\n";
        let rows = |edges: &str| format!("3 0 1 2\n{edges}");
        let read = groom(ascii(5, header, &rows("1 4\n0 2\n2 1\n")).as_bytes()).unwrap();
        assert_eq!(read.strands[0].iter().map(|p| p.x).collect::<Vec<_>>(), [0.0, 2.0, 1.0, 4.0]);
        assert_eq!(lengths(&read), [4, 1]);
        let told = |edges: &str| groom(ascii(5, header, &rows(edges)).as_bytes()).unwrap_err();
        assert!(told("0 1\n1 2\n2 0\n").contains("ring"));
        assert!(told("0 1\n0 2\n0 3\n").contains("branch"));
        assert!(told("0 1\n0 2\n-1 3\n").contains("names the vertex"));
        assert!(told("0 1\n").contains("ends"));
    }

    #[test]
    fn a_second_list_of_vertices_is_refused() {
        let second = "element vertex 1\nproperty double x\nproperty double y\nproperty double z\nproperty int strand\n";
        let told = groom(ascii(3, second, "9 0 0 1\n").as_bytes()).unwrap_err();
        assert!(told.contains("2 `vertex` elements"), "{told}");
    }

    #[test]
    fn claims_are_no_sizes() {
        let boast = "ply\nformat binary_little_endian 1.0\nelement vertex 99999999999\nproperty float x\n\
                     property float y\nproperty float z\nelement nothing 99999999999\nend_header\n";
        assert!(groom(boast.as_bytes()).unwrap_err().contains("ends"));
        assert!(groom(boast.replace("little", "big").as_bytes()).unwrap_err().contains("big_endian"));
    }

    proptest! {
        #[test]
        fn any_bytes_are_safe(cut in 0usize..800, flips in prop::collection::vec((0usize..800, any::<u8>()), 0..6)) {
            let mut data = ours();
            for (at, value) in flips { let n = data.len(); data[at % n] = value; }
            data.truncate(cut);
            let _ = groom(&data);
        }
    }
}
