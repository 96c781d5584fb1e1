//! What each view sees first: depth maps of sets of voxels, by splatting them into a z-buffer.

use glam::{DVec2, DVec3};
use strandflow_core::{Camera, Grid, Occupancy, Plane, grid::floor};
use strandflow_geometry::project::{depth, project, project_with_depth};

/// Distance along the optical axis to the first voxel of a set, one value a pixel \[mm\]; infinite where there is none.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    /// Depths \[mm\], shape (height, width).
    pub depth: Plane<f32>,
}

impl DepthMap {
    /// The depth map of a set of voxels, each drawn as the outline of its cube: what they close is closed, at any angle. Depths
    /// are those of the voxel centres, so the map is right to about half a voxel.
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
    (0..layers).fold(occupancy.clone(), |rest, _| inner_voxels(&rest))
}

/// Draws one voxel into the z-buffer: the pixel that its centre falls in, and those whose centres its cube covers.
fn splat(camera: &Camera, centre: DVec3, voxel_mm: f64, map: &mut Plane<f32>) {
    let Some((pixel, z)) = project_with_depth(camera, centre) else { return };
    let depth = z as f32;
    if map.at_point(pixel.x, pixel.y).is_some_and(|&first| depth < first) {
        map[(pixel.x as usize, pixel.y as usize)] = depth;
    }
    let half = 0.5 * WIDENED * voxel_mm;
    let to_face = |axis: DVec3| Some(project(camera, centre + half * axis)? - pixel);
    let [Some(a), Some(b), Some(c)] = DVec3::AXES.map(to_face) else { return };
    let outline = Outline::of(a, b, c);
    let down = a.y.abs() + b.y.abs() + c.y.abs();
    for y in first_from(pixel.y - down, map.height)..first_from(pixel.y + down, map.height) {
        let (left, right) = outline.row(y as f64 + 0.5 - pixel.y);
        let (x0, x1) = (first_from(pixel.x + left, map.width), first_from(pixel.x + right, map.width));
        for first in &mut map.data[y * map.width + x0.min(x1)..y * map.width + x1] {
            *first = first.min(depth);
        }
    }
}

/// How large cubes are drawn, of their size. Outlines are found as if the edges along an axis were parallel; perspective opens
/// gaps between neighbours then, far narrower than this.
const WIDENED: f64 = 1.01;

/// The outline of a cube in an image, around its centre \[px\]: where three strips overlap, each along the image of one axis.
struct Outline([Strip; 3]);

/// The points between two lines along `along`, on both sides of the centre.
struct Strip {
    along: DVec2,
    /// Largest |along × point|.
    most: f64,
}

impl Outline {
    /// From the ways from the centre to three faces.
    fn of(a: DVec2, b: DVec2, c: DVec2) -> Self {
        let strip =
            |along: DVec2, [p, q]: [DVec2; 2]| Strip { along, most: along.perp_dot(p).abs() + along.perp_dot(q).abs() };
        Self([strip(a, [b, c]), strip(b, [c, a]), strip(c, [a, b])])
    }

    /// The columns it covers in a row, from and to; the second below the first where there are none.
    fn row(&self, down: f64) -> (f64, f64) {
        self.0.iter().fold((f64::NEG_INFINITY, f64::INFINITY), |(left, right), Strip { along, most }| {
            if along.y.abs() < 1e-9 {
                return (left, right);
            }
            let (middle, half) = (along.x * down / along.y, (most / along.y).abs());
            (left.max(middle - half), right.min(middle + half))
        })
    }
}

/// The first pixel of a line whose centre is not before `at`.
fn first_from(at: f64, size: usize) -> usize {
    floor(at + 0.5).clamp(0, size as i64) as usize
}

/// The voxels of an occupancy with at least one of their six neighbours empty (or outside the grid), rising.
pub fn surface_voxels(occupancy: &Occupancy) -> Vec<u32> {
    let inner = inner_voxels(occupancy);
    let words = occupancy.words.iter().zip(&inner.words).map(|(all, inner)| all & !inner).collect();
    Occupancy { grid: occupancy.grid, words }.indices().map(|index| index as u32).collect()
}

/// The voxels whose six neighbours are all occupied; 64 at a time.
fn inner_voxels(occupancy: &Occupancy) -> Occupancy {
    let grid = occupancy.grid;
    let [nx, ny, _] = grid.dims.map(|n| n as isize);
    let all_around = |(word, &here): (usize, &u64)| {
        let at = 64 * word as isize;
        let around = [-1, 1, -nx, nx, -nx * ny, nx * ny];
        if here == 0 { 0 } else { around.iter().fold(here, |bits, step| bits & occupancy.bits_from(at + step)) }
    };
    let mut inner = Occupancy { grid, words: occupancy.words.iter().enumerate().map(all_around).collect() };
    // At the border of the grid the voxels at these steps are those of other rows.
    let [nx, ny, nz] = grid.dims;
    for (z, y) in (0..nz).flat_map(|z| (0..ny).map(move |y| (z, y))) {
        if z == 0 || y == 0 || z + 1 == nz || y + 1 == ny {
            (0..nx).for_each(|x| inner.set(grid.index([x, y, z]), false));
        } else {
            [0, nx.saturating_sub(1)]
                .into_iter()
                .filter(|&x| x < nx)
                .for_each(|x| inner.set(grid.index([x, y, z]), false));
        }
    }
    inner
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DQuat};
    use strandflow_core::{Distortion, RigidTransform};

    use super::*;

    #[test]
    fn the_surface_is_what_has_an_empty_neighbour() {
        // Rows that are no multiple of a word, voxels by chance with many inner ones, and full rows up to every border.
        let grid = Grid { origin: DVec3::ZERO, voxel_mm: 2.0, dims: [37, 11, 9] };
        let mut occupancy = Occupancy::empty(grid);
        (0..grid.len()).for_each(|index| occupancy.set(index, index * index % 23 != 3));
        let expected = |index: &usize| {
            let [x, y, z] = grid.coordinates(*index).map(|c| c as i64);
            let around = [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]];
            let there = |[i, j, k]: [i64; 3]| {
                let at = [x + i, y + j, z + k];
                let inside = (0..3).all(|axis| at[axis] >= 0 && at[axis] < grid.dims[axis] as i64);
                inside && occupancy.get(grid.index(at.map(|c| c as usize)))
            };
            !around.into_iter().all(there)
        };
        let surface = surface_voxels(&occupancy);
        assert_eq!(surface, occupancy.indices().filter(expected).map(|i| i as u32).collect::<Vec<_>>());
        let rest = without_layers(&occupancy, 1);
        assert_eq!(rest.count() + surface.len(), occupancy.count());
        assert!(rest.count() > 300 && surface.iter().all(|&voxel| !rest.get(voxel as usize)));
    }

    /// A ball of 25 mm and its grid.
    fn ball() -> (Grid, Occupancy) {
        let grid = Grid { origin: DVec3::splat(-30.0), voxel_mm: 2.0, dims: [30; 3] };
        let mut ball = Occupancy::empty(grid);
        (0..grid.len()).for_each(|index| ball.set(index, grid.centre_of_index(index).length() < 25.0));
        (grid, ball)
    }

    /// Looks at the origin from 500 mm, 2 px a millimetre there.
    fn camera(rotation: DMat3) -> Camera {
        Camera {
            name: "c".into(),
            width: 200,
            height: 160,
            focal: [1000.0; 2],
            principal: [100.0, 80.0],
            distortion: Distortion::None,
            camera_from_world: RigidTransform { rotation, translation: DVec3::Z * 500.0 },
        }
    }

    /// Towards faces, edges, corners and between them, upright and rolled.
    fn turns() -> impl Iterator<Item = DMat3> {
        let towards = [DVec3::Z, DVec3::new(1.0, 1.0, 0.0), DVec3::ONE, DVec3::new(-0.3, 0.8, 0.5)];
        towards.into_iter().flat_map(|from| {
            let turn = DQuat::from_rotation_arc(from.normalize(), DVec3::Z);
            [0.0f64, 0.4, 0.785].map(|roll| DMat3::from_quat(DQuat::from_rotation_z(roll) * turn))
        })
    }

    fn pixels(camera: &Camera) -> impl Iterator<Item = (usize, usize)> {
        let (width, height) = (camera.width, camera.height);
        (0..height).flat_map(move |y| (0..width).map(move |x| (x, y)))
    }

    #[test]
    fn a_ball_is_seen_from_the_front() {
        let ((grid, ball), camera) = (ball(), camera(DMat3::IDENTITY));
        let map = DepthMap::of_voxels(&camera, &grid, &surface_voxels(&ball));
        // Of the centres beside the axis, those at z = −23 are the first within 25 mm of the ball's: |(1, 1, 25)| > 25.
        assert!((map.depth[(100, 80)] - 477.0).abs() < 1e-3);
        assert!(map.depth[(2, 2)].is_infinite());
        assert!((map.behind(&camera, DVec3::ZERO).unwrap() - 23.0).abs() < 1e-3);
    }

    #[test]
    fn nothing_is_seen_through_a_surface() {
        let (grid, ball) = ball();
        let surface = surface_voxels(&ball);
        for turn in turns() {
            let camera = camera(turn);
            let map = DepthMap::of_voxels(&camera, &grid, &surface);
            for (x, y) in pixels(&camera) {
                let from_centre = (x as f64 - 99.5).hypot(y as f64 - 79.5);
                let depth = map.depth[(x, y)];
                assert!(from_centre >= 47.0 || depth < 502.0, "{turn}: ({x}, {y}) sees {depth} mm");
            }
        }
    }

    #[test]
    fn a_voxel_covers_the_pixels_whose_rays_meet_its_cube() {
        // 20 px an edge and off the axis; the perspective of a cube this large is two hundredths.
        let grid = Grid { origin: DVec3::new(6.0, -9.0, 3.0), voxel_mm: 10.0, dims: [1; 3] };
        for turn in turns() {
            let camera = camera(turn);
            let map = DepthMap::of_voxels(&camera, &grid, &[0]);
            let world_from_camera = turn.transpose();
            let eye = world_from_camera * -camera.camera_from_world.translation;
            // Whether the ray through a pixel's centre meets the cube, made larger or smaller.
            let meets = |(x, y): (usize, usize), scale: f64| {
                let ray = DVec3::new((x as f64 - 99.5) / 1000.0, (y as f64 - 79.5) / 1000.0, 1.0);
                let (ray, to_centre) = (world_from_camera * ray, grid.centre_of_index(0) - eye);
                let (mut enters, mut leaves) = (f64::NEG_INFINITY, f64::INFINITY);
                for axis in 0..3 {
                    let faces = [-5.0, 5.0].map(|half| (to_centre[axis] + scale * half) / ray[axis]);
                    (enters, leaves) = (enters.max(faces[0].min(faces[1])), leaves.min(faces[0].max(faces[1])));
                }
                enters <= leaves
            };
            let mut covered = 0;
            for at in pixels(&camera) {
                let drawn = map.depth[at].is_finite();
                covered += usize::from(drawn);
                assert!(drawn || !meets(at, 0.97), "{turn}: {at:?} is left out");
                assert!(!drawn || meets(at, 1.05), "{turn}: {at:?} is beyond the cube");
            }
            assert!(covered > 350, "{turn}: {covered}");
        }
    }
}
