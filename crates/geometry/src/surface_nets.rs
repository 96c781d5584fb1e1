//! Surface of a voxel set, as a mesh for looking at.
//!
//! Reference: naive surface nets (Gibson 1998): one vertex in each cell whose corners differ, at the mean of where the
//! density crosses one half on the cell's edges; one quadrilateral for each grid edge that crosses.

use glam::DVec3;
use strandflow_core::{Grid, Occupancy, TriMesh};

/// The surface of the occupied voxels, outward faces, world \[mm\]. `factor` voxels a side become one sample (their share
/// occupied is the density), which smooths the steps of the voxels and makes the mesh smaller by about `factor²`.
/// Parts thinner than half such a sample may be lost.
pub fn surface(occupancy: &Occupancy, factor: usize) -> TriMesh {
    let density = Density::of(occupancy, factor.max(1));
    let [nx, ny, nz] = density.grid.dims;
    let mut mesh = TriMesh::default();
    // Vertices of the cells of two layers: quadrilaterals join a cell with those before it.
    let mut layers = [vec![u32::MAX; nx * ny], vec![u32::MAX; nx * ny]];
    for z in 0..nz.saturating_sub(1) {
        layers.swap(0, 1);
        layers[1].fill(u32::MAX);
        for y in 0..ny.saturating_sub(1) {
            for x in 0..nx.saturating_sub(1) {
                let Some(vertex) = density.vertex([x, y, z]) else { continue };
                layers[1][y * nx + x] = mesh.vertices.len() as u32;
                mesh.vertices.push(vertex);
                faces(&density, [x, y, z], &layers, &mut mesh.faces);
            }
        }
    }
    mesh
}

/// Shares of occupied voxels, with a border of nothing.
struct Density {
    grid: Grid,
    values: Vec<f32>,
}

impl Density {
    fn of(occupancy: &Occupancy, factor: usize) -> Self {
        let fine = occupancy.grid;
        let dims = fine.dims.map(|n| n.div_ceil(factor) + 2);
        let voxel_mm = fine.voxel_mm * factor as f64;
        let grid = Grid { origin: fine.origin - DVec3::splat(voxel_mm), voxel_mm, dims };
        let mut values = vec![0.0f32; grid.len()];
        let each = 1.0 / factor.pow(3) as f32;
        for index in occupancy.indices() {
            values[grid.index(fine.coordinates(index).map(|c| c / factor + 1))] += each;
        }
        Self { grid, values }
    }

    fn inside(&self, at: [usize; 3]) -> bool {
        self.values[self.grid.index(at)] > 0.5
    }

    /// The vertex of the cell between sample centres `at` and `at + 1`, if the surface goes through it.
    fn vertex(&self, at: [usize; 3]) -> Option<DVec3> {
        let corner = |k: usize| std::array::from_fn(|axis| at[axis] + (k >> axis & 1));
        let values: [f32; 8] = std::array::from_fn(|k| self.values[self.grid.index(corner(k))]);
        let inside = values.iter().filter(|v| **v > 0.5).count();
        if inside == 0 || inside == 8 {
            return None;
        }
        let (mut sum, mut count) = (DVec3::ZERO, 0.0);
        for a in 0..8usize {
            for axis in (0..3).filter(|axis| a >> axis & 1 == 0) {
                let (from, to) = (values[a], values[a | 1 << axis]);
                if (from > 0.5) != (to > 0.5) {
                    let mut point = DVec3::from_array(std::array::from_fn(|k| f64::from(u8::from(a >> k & 1 == 1))));
                    point[axis] = f64::from((0.5 - from) / (to - from));
                    (sum, count) = (sum + point, count + 1.0);
                }
            }
        }
        Some(self.grid.centre(at) + sum / count * self.grid.voxel_mm)
    }
}

/// Adds the faces around the three grid edges that leave sample `at` in rising direction, as far as they cross.
fn faces(density: &Density, at: [usize; 3], layers: &[Vec<u32>; 2], faces: &mut Vec<[u32; 3]>) {
    let nx = density.grid.dims[0];
    for axis in 0..3 {
        let mut next = at;
        next[axis] += 1;
        let (here, there) = (density.inside(at), density.inside(next));
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        // The border is empty, so an edge that crosses has cells on all sides.
        if here == there || at[u] == 0 || at[v] == 0 {
            continue;
        }
        let cell = |back_u: usize, back_v: usize| {
            let mut cell = at;
            cell[u] -= back_u;
            cell[v] -= back_v;
            let layer = &layers[usize::from(cell[2] == at[2])];
            layer[cell[1] * nx + cell[0]]
        };
        let quad = [cell(0, 0), cell(1, 0), cell(1, 1), cell(0, 1)];
        let [a, b, c, d] = if here { quad } else { [quad[0], quad[3], quad[2], quad[1]] };
        faces.extend([[a, b, c], [a, c, d]]);
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;

    fn ball(radius_mm: f64) -> Occupancy {
        let grid = Grid { origin: DVec3::new(-25.0, -24.0, -23.0), voxel_mm: 1.0, dims: [50, 48, 46] };
        let mut occupancy = Occupancy::empty(grid);
        for index in (0..grid.len()).filter(|&i| grid.centre_of_index(i).length() < radius_mm) {
            occupancy.set(index, true);
        }
        occupancy
    }

    #[test]
    fn a_ball_has_a_closed_outward_surface_at_its_radius() {
        for factor in [1, 2, 3] {
            let mesh = surface(&ball(20.0), factor);
            assert!(mesh.vertices.len() > 1000 / factor.pow(2));
            let off = mesh.vertices.iter().map(|v| (v.length() - 20.0).abs()).fold(0.0, f64::max);
            assert!(off < 0.8 * factor as f64, "factor {factor}: {off} mm");
            let volume: f64 = (0..mesh.faces.len())
                .map(|f| {
                    let [a, b, c] = mesh.corners(f);
                    a.cross(b).dot(c) / 6.0
                })
                .sum();
            let truth = 4.0 / 3.0 * std::f64::consts::PI * 20.0f64.powi(3);
            assert!((volume / truth - 1.0).abs() < 0.05, "factor {factor}: {volume} of {truth} mm³");
            let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
            for face in &mesh.faces {
                for (a, b) in [(face[0], face[1]), (face[1], face[2]), (face[2], face[0])] {
                    *edges.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
                }
            }
            assert!(edges.values().all(|sum| *sum == 0), "every edge is run both ways");
        }
    }

    #[test]
    fn what_fills_the_grid_is_closed_and_nothing_has_no_surface() {
        let grid = Grid { origin: DVec3::ZERO, voxel_mm: 2.0, dims: [3, 3, 3] };
        let mut full = Occupancy::empty(grid);
        (0..grid.len()).for_each(|i| full.set(i, true));
        let mesh = surface(&full, 1);
        assert!(mesh.faces.len() == 6 * 9 * 2 && mesh.vertices.iter().all(|v| v.is_finite()));
        assert!(surface(&Occupancy::empty(grid), 2).faces.is_empty());
    }
}
