//! The nearest point of a triangle mesh, and on which side of it a point lies.
//!
//! A bounding-volume tree over the faces, split at the median of the longest axis. The side is the sign of the
//! angle-weighted pseudonormal of the nearest feature, exact for closed meshes.
//!
//! Reference: Ericson 2005 §5.1.5 (nearest point of a triangle); Bærentzen & Aanæs 2005 (pseudonormals).

use std::collections::BTreeMap;

use glam::DVec3;
use strandflow_core::TriMesh;

/// Faces in a leaf; 2 to 8 are equally fast, above 16 queries slow down.
const LEAF_FACES: usize = 4;

/// The nearest point of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearestPoint {
    /// The point \[mm\].
    pub point: DVec3,
    /// The face it lies on.
    pub face: usize,
    /// Outward unit pseudonormal of the face, edge or vertex it lies on.
    pub normal: DVec3,
    /// Distance \[mm\], negative inside.
    pub signed_distance: f64,
}

/// A mesh prepared for nearest-point queries.
#[derive(Clone, Debug)]
pub struct MeshDistance {
    faces: Vec<Face>,
    nodes: Vec<Node>,
}

#[derive(Clone, Debug)]
struct Face {
    number: usize,
    corners: [DVec3; 3],
    /// Pseudonormals: the face, its edges (0–1, 1–2, 2–0), its corners.
    normals: [DVec3; 7],
}

#[derive(Clone, Debug)]
struct Node {
    low: DVec3,
    high: DVec3,
    /// Leaf: faces `first..first + count`. Inner (`count` is 0): children are the next node and `first`.
    first: usize,
    count: usize,
}

impl Node {
    fn distance_squared(&self, point: DVec3) -> f64 {
        point.distance_squared(point.clamp(self.low, self.high))
    }
}

impl MeshDistance {
    /// Prepares a mesh. Degenerate faces and faces with non-finite corners are left out.
    pub fn new(mesh: &TriMesh) -> Self {
        let mut faces = faces_with_pseudonormals(mesh);
        let mut nodes = Vec::new();
        if !faces.is_empty() {
            let count = faces.len();
            build(&mut faces, 0, count, &mut nodes);
        }
        Self { faces, nodes }
    }

    /// The nearest point of the mesh; `None` for an empty mesh.
    pub fn nearest(&self, point: DVec3) -> Option<NearestPoint> {
        let (mut best_squared, mut best) = (f64::INFINITY, None);
        let mut stack = Vec::with_capacity(64);
        if !self.nodes.is_empty() {
            stack.push((0usize, self.nodes[0].distance_squared(point)));
        }
        while let Some((index, bound)) = stack.pop() {
            if bound >= best_squared {
                continue;
            }
            let node = &self.nodes[index];
            if node.count == 0 {
                // The nearer child is taken first: it goes on the stack last.
                let (a, b) = (index + 1, node.first);
                let (da, db) = (self.nodes[a].distance_squared(point), self.nodes[b].distance_squared(point));
                let order = if da <= db { [(b, db), (a, da)] } else { [(a, da), (b, db)] };
                stack.extend(order);
                continue;
            }
            for (i, face) in self.faces[node.first..node.first + node.count].iter().enumerate() {
                let (candidate, feature) = nearest_of_triangle(point, face.corners);
                let squared = candidate.distance_squared(point);
                if squared < best_squared {
                    (best_squared, best) = (squared, Some((node.first + i, candidate, feature)));
                }
            }
        }
        best.map(|(i, nearest, feature)| {
            let normal = self.faces[i].normals[feature];
            let side = if (point - nearest).dot(normal) < 0.0 { -1.0 } else { 1.0 };
            let signed_distance = side * best_squared.sqrt();
            NearestPoint { point: nearest, face: self.faces[i].number, normal, signed_distance }
        })
    }
}

fn faces_with_pseudonormals(mesh: &TriMesh) -> Vec<Face> {
    let mut corner_normals = vec![DVec3::ZERO; mesh.vertices.len()];
    let mut edge_normals: BTreeMap<(u32, u32), DVec3> = BTreeMap::new();
    let edge = |a: u32, b: u32| (a.min(b), a.max(b));
    let usable: Vec<usize> = (0..mesh.faces.len()).filter(|&f| mesh.face_normal(f).length_squared() > 0.5).collect();
    for &f in &usable {
        let (indices, corners, normal) = (mesh.faces[f], mesh.corners(f), mesh.face_normal(f));
        for i in 0..3 {
            let (next, last) = (corners[(i + 1) % 3] - corners[i], corners[(i + 2) % 3] - corners[i]);
            corner_normals[indices[i] as usize] += normal * next.angle_between(last);
            *edge_normals.entry(edge(indices[i], indices[(i + 1) % 3])).or_default() += normal;
        }
    }
    let at_edge = |a, b| edge_normals.get(&edge(a, b)).copied().unwrap_or_default().normalize_or_zero();
    let prepared = |&f: &usize| {
        let [a, b, c] = mesh.faces[f];
        let corner = |v: u32| corner_normals[v as usize].normalize_or_zero();
        let normals =
            [mesh.face_normal(f), at_edge(a, b), at_edge(b, c), at_edge(c, a), corner(a), corner(b), corner(c)];
        Face { number: f, corners: mesh.corners(f), normals }
    };
    usable.iter().map(prepared).collect()
}

/// Appends the tree over `faces[first..first + count]` in depth-first order and returns its root.
fn build(faces: &mut [Face], first: usize, count: usize, nodes: &mut Vec<Node>) -> usize {
    let here = nodes.len();
    let range = first..first + count;
    let all = || faces[range.clone()].iter().flat_map(|face| face.corners);
    let low = all().fold(DVec3::INFINITY, DVec3::min);
    let high = all().fold(DVec3::NEG_INFINITY, DVec3::max);
    nodes.push(Node { low, high, first, count });
    if count <= LEAF_FACES {
        return here;
    }
    let extent = high - low;
    let axis = if extent.x >= extent.y.max(extent.z) { 0 } else { usize::from(extent.y < extent.z) + 1 };
    let key = |face: &Face| face.corners.iter().map(|c| c[axis]).sum::<f64>();
    faces[range].sort_by(|a, b| key(a).total_cmp(&key(b)).then(a.number.cmp(&b.number)));
    let half = count / 2;
    build(faces, first, half, nodes);
    let right = build(faces, first + half, count - half, nodes);
    (nodes[here].first, nodes[here].count) = (right, 0);
    here
}

/// The nearest point of a triangle and its feature: 0 the face, 1–3 the edges 0–1, 1–2, 2–0, 4–6 the corners.
fn nearest_of_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> (DVec3, usize) {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return (a, 4);
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return (b, 5);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (a + ab * (d1 / (d1 - d3)), 1);
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return (c, 6);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (a + ac * (d2 / (d2 - d6)), 3);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        return (b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6))), 2);
    }
    let scale = 1.0 / (va + vb + vc);
    (a + ab * (vb * scale) + ac * (vc * scale), 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitives::{cuboid, icosphere};

    #[test]
    fn the_tree_finds_what_a_search_of_all_faces_finds() {
        let mesh = icosphere(DVec3::new(3.0, -5.0, 9.0), 40.0, 3);
        let tree = MeshDistance::new(&mesh);
        for i in 0..500 {
            let t = i as f64;
            let point = DVec3::new((t * 1.7).sin(), (t * 2.3).cos(), (t * 0.9).sin()) * 60.0;
            let brute = (0..mesh.faces.len())
                .map(|f| nearest_of_triangle(point, mesh.corners(f)).0.distance(point))
                .fold(f64::INFINITY, f64::min);
            assert!((tree.nearest(point).unwrap().signed_distance.abs() - brute).abs() < 1e-12);
        }
    }

    #[test]
    fn the_side_is_right_at_faces_edges_and_corners() {
        let tree = MeshDistance::new(&cuboid(DVec3::splat(-1.0), DVec3::splat(1.0)));
        for (point, expected) in [
            (DVec3::new(0.3, 0.1, 3.0), 2.0),
            (DVec3::new(2.0, 2.0, 0.2), 2f64.sqrt()),
            (DVec3::new(2.0, -2.0, 2.0), 3f64.sqrt()),
            (DVec3::new(0.9, 0.2, 0.5), -0.1),
            (DVec3::new(0.8, 0.8, 0.8), -0.2),
        ] {
            assert!((tree.nearest(point).unwrap().signed_distance - expected).abs() < 1e-12, "{point}");
        }
        assert!(MeshDistance::new(&TriMesh::default()).nearest(DVec3::ZERO).is_none());
    }
}
