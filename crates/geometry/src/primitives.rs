//! Closed meshes of simple solids.

use std::collections::BTreeMap;

use glam::DVec3;
use strandflow_core::TriMesh;

/// A box from its smallest to its largest corner \[mm\].
pub fn cuboid(low: DVec3, high: DVec3) -> TriMesh {
    let vertices = (0..8)
        .map(|i| {
            let pick = |bit: usize, axis: usize| if i >> bit & 1 == 1 { high[axis] } else { low[axis] };
            DVec3::new(pick(0, 0), pick(1, 1), pick(2, 2))
        })
        .collect();
    let quads: [[u32; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    TriMesh { vertices, faces }
}

/// A sphere of 20 · 4^`subdivisions` nearly equal triangles, vertices on the sphere \[mm\].
pub fn icosphere(centre: DVec3, radius: f64, subdivisions: usize) -> TriMesh {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let signs = [(-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)];
    let mut unit: Vec<DVec3> = Vec::new();
    unit.extend(signs.map(|(s, t)| DVec3::new(s, t * g, 0.0)));
    unit.extend(signs.map(|(s, t)| DVec3::new(0.0, s, t * g)));
    unit.extend(signs.map(|(s, t)| DVec3::new(t * g, 0.0, s)));
    unit.iter_mut().for_each(|v| *v = v.normalize());
    let mut faces: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..subdivisions {
        faces = subdivided(&mut unit, &faces);
    }
    TriMesh { vertices: unit.iter().map(|v| centre + *v * radius).collect(), faces }
}

/// Splits each face into four; new vertices are put on the unit sphere.
fn subdivided(unit: &mut Vec<DVec3>, faces: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut middles: BTreeMap<(u32, u32), u32> = BTreeMap::new();
    let mut middle = |a: u32, b: u32| {
        *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
            unit.push((unit[a as usize] + unit[b as usize]).normalize());
            unit.len() as u32 - 1
        })
    };
    let mut out = Vec::with_capacity(faces.len() * 4);
    for &[a, b, c] in faces {
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        out.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume(mesh: &TriMesh) -> f64 {
        let signed = |f| {
            let [a, b, c]: [DVec3; 3] = mesh.corners(f);
            a.dot(b.cross(c)) / 6.0
        };
        (0..mesh.faces.len()).map(signed).sum()
    }

    #[test]
    fn faces_look_outward_and_enclose_the_volume() {
        let sphere = icosphere(DVec3::new(100.0, -20.0, 5.0), 50.0, 4);
        let exact = 4.0 / 3.0 * std::f64::consts::PI * 50f64.powi(3);
        assert!((volume(&sphere) / exact - 1.0).abs() < 0.005);
        assert!((volume(&cuboid(DVec3::ONE, DVec3::new(3.0, 4.0, 5.0))) - 24.0).abs() < 1e-12);
    }
}
