//! What each view sees first: depth maps of sets of voxels, by splatting them into a z-buffer.

use glam::{DVec2, DVec3};
use strandflow_core::{Camera, Grid, Occupancy, Plane};
use strandflow_geometry::project::{depth, project};

/// Distance along the optical axis to the first voxel of a set, one value a pixel \[mm\]; infinite where there is none.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    /// Depths \[mm\], shape (height, width).
    pub depth: Plane<f32>,
}

impl DepthMap {
    /// The depth map of a set of voxels, each drawn as the square that its circumscribed cube covers. Depths are those of
    /// the voxel centres, so the map is right to about half a voxel; silhouettes grow by at most one voxel.
    pub fn of_voxels(camera: &Camera, grid: &Grid, voxels: &[u32]) -> Self {
        let mut map = Plane::filled(camera.width, camera.height, f32::INFINITY);
        for &voxel in voxels {
            splat(camera, grid.centre_of_index(voxel as usize), grid.voxel_mm, &mut map);
        }
        Self { depth: map }
    }

    /// How far a world point lies behind the first surface along its viewing ray \[mm\] (negative in front of it);
    /// `None` where the view shows nothing of the set or the point lies outside the image.
    pub fn behind(&self, camera: &Camera, point: DVec3) -> Option<f32> {
        self.behind_at(project(camera, point)?, depth(camera, point))
    }

    /// The same for a point whose pixel and depth are known already.
    #[inline]
    pub fn behind_at(&self, pixel: DVec2, depth: f64) -> Option<f32> {
        let first = *self.depth.at_point(pixel.x, pixel.y)?;
        first.is_finite().then_some(depth as f32 - first)
    }
}

/// The occupied voxels without their outermost layers.
pub fn without_layers(occupancy: &Occupancy, layers: usize) -> Occupancy {
    let mut rest = occupancy.clone();
    for _ in 0..layers {
        surface_voxels(&rest).into_iter().for_each(|voxel| rest.set(voxel as usize, false));
    }
    rest
}

/// Draws one voxel into the z-buffer.
fn splat(camera: &Camera, centre: DVec3, voxel_mm: f64, map: &mut Plane<f32>) {
    let (Some(pixel), z) = (project(camera, centre), depth(camera, centre)) else { return };
    // Half of a cube's edge seen obliquely: between 0.5 and 0.87 of the edge; 0.6 leaves no pinholes at any angle.
    let radius = 0.6 * voxel_mm * camera.focal[0].max(camera.focal[1]) / z;
    let (x0, x1) = covered(pixel.x, radius, map.width);
    let (y0, y1) = covered(pixel.y, radius, map.height);
    for y in y0..y1 {
        for first in &mut map.data[y * map.width + x0.min(x1)..y * map.width + x1] {
            *first = first.min(z as f32);
        }
    }
}

/// The half-open range of pixels whose centres lie within `radius` of `at`, at least the pixel that contains it.
fn covered(at: f64, radius: f64, size: usize) -> (usize, usize) {
    let low = (at - radius + 0.5).floor().min(at.floor());
    let high = (at + radius + 0.5).floor().max(at.floor() + 1.0);
    (low.clamp(0.0, size as f64) as usize, high.clamp(0.0, size as f64) as usize)
}

/// The voxels of an occupancy with at least one of their six neighbours empty (or outside the grid), rising.
pub fn surface_voxels(occupancy: &Occupancy) -> Vec<u32> {
    let grid = &occupancy.grid;
    let [nx, ny, nz] = grid.dims;
    let inner = |index: usize| {
        let [x, y, z] = grid.coordinates(index);
        let within = x > 0 && y > 0 && z > 0 && x + 1 < nx && y + 1 < ny && z + 1 < nz;
        within
            && [index - 1, index + 1, index - nx, index + nx, index - nx * ny, index + nx * ny]
                .iter()
                .all(|&neighbour| occupancy.get(neighbour))
    };
    occupancy.indices().filter(|&index| !inner(index)).map(|index| index as u32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use strandflow_core::{Distortion, RigidTransform};

    #[test]
    fn a_ball_is_seen_from_the_front() {
        let grid = Grid { origin: DVec3::splat(-30.0), voxel_mm: 2.0, dims: [30; 3] };
        let mut ball = Occupancy::empty(grid);
        for index in 0..grid.len() {
            ball.set(index, grid.centre_of_index(index).length() < 25.0);
        }
        let camera = Camera {
            name: "c".into(),
            width: 200,
            height: 160,
            focal: [1000.0; 2],
            principal: [100.0, 80.0],
            distortion: Distortion::None,
            camera_from_world: RigidTransform { translation: DVec3::Z * 500.0, ..RigidTransform::IDENTITY },
        };
        let map = DepthMap::of_voxels(&camera, &grid, &surface_voxels(&ball));
        // Of the centres beside the axis, those at z = −23 are the first within 25 mm of the ball's: |(1, 1, 25)| > 25.
        assert!((map.depth[(100, 80)] - 477.0).abs() < 1e-3);
        assert!(map.depth[(2, 2)].is_infinite());
        assert!((map.behind(&camera, DVec3::ZERO).unwrap() - 23.0).abs() < 1e-3);
        // No pinholes: every pixel within the silhouette sees the ball's front half.
        for (x, y) in (0..200).flat_map(|x| (0..160).map(move |y| (x, y))) {
            let from_centre = ((x as f64 - 99.5).powi(2) + (y as f64 - 79.5).powi(2)).sqrt();
            if from_centre < 47.0 {
                assert!(map.depth[(x, y)] < 502.0, "{x} {y}");
            }
        }
    }
}
