//! Indexed triangle meshes.

use glam::DVec3;

/// Triangles with outward, counter-clockwise faces.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriMesh {
    /// Vertices \[mm\].
    pub vertices: Vec<DVec3>,
    /// Vertex indices of each face.
    pub faces: Vec<[u32; 3]>,
}

impl TriMesh {
    /// The corners of a face.
    pub fn corners(&self, face: usize) -> [DVec3; 3] {
        self.faces[face].map(|v| self.vertices[v as usize])
    }

    /// Unit normal of a face (zero where it is degenerate).
    pub fn face_normal(&self, face: usize) -> DVec3 {
        let [a, b, c] = self.corners(face);
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// Area of a face \[mm²\].
    pub fn face_area(&self, face: usize) -> f64 {
        let [a, b, c] = self.corners(face);
        (b - a).cross(c - a).length() * 0.5
    }
}
