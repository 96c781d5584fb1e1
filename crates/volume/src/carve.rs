//! The visual hull by hierarchical carving: blocks of voxels against summed-area tables of the silhouettes, halved until
//! every view has decided or single voxels are left.
//!
//! Reference: Laurentini 1994 (visual hull); Szeliski 1993 (octrees from silhouettes).

use glam::{DVec2, DVec3};
use rayon::prelude::*;
use strandflow_core::{Camera, Distortion, Grid, Occupancy};
use strandflow_geometry::project::project;

use crate::silhouette::{Coverage, Silhouette};

/// Edge of the coarsest blocks [voxels]. Halved down to `LEAF`; 8 and 32 are within 10 % of the time.
const BLOCK: usize = 16;
/// Edge of the blocks whose voxels are tested one by one [voxels].
const LEAF: usize = 4;

/// A camera and its silhouette.
#[derive(Clone, Copy, Debug)]
pub struct CarvingView<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Its silhouette, of the image's size.
    pub silhouette: &'a Silhouette,
}

/// The voxels whose centre lies in no view outside the silhouette and in the image of at least `least_views` views. A view
/// in which a centre falls outside the image, or behind the camera, says nothing about it.
///
/// Equal to testing every voxel in every view, for pinholes and for any lens that bends a block's outline by less than a
/// tenth of its size.
pub fn carve(views: &[CarvingView], grid: &Grid, least_views: usize) -> Occupancy {
    carved(&Carver::new(views, grid, least_views, Test::Centres))
}

/// The voxels of which some part may be occupied: no view sees the whole voxel outside its silhouette, and at least
/// `least_views` views may see it. Holds every voxel that holds an occupied point; for coarse grids.
pub fn carve_touching(views: &[CarvingView], grid: &Grid, least_views: usize) -> Occupancy {
    carved(&Carver::new(views, grid, least_views, Test::Touch))
}

/// The largest set of occupied voxels that touch by a face, an edge or a corner (the first in linear order of equals).
pub fn largest_component(occupancy: &Occupancy) -> Occupancy {
    let mut out = Occupancy::empty(occupancy.grid);
    let components = components(occupancy);
    let largest = components.iter().rev().max_by_key(|members| members.len());
    largest.into_iter().flatten().for_each(|&index| out.set(index, true));
    out
}

/// The sets of occupied voxels that touch by a face, an edge or a corner, by their first voxels in linear order.
pub(crate) fn components(occupancy: &Occupancy) -> Vec<Vec<usize>> {
    let grid = occupancy.grid;
    let mut left = occupancy.clone();
    let mut found = Vec::new();
    for seed in occupancy.indices() {
        if !left.get(seed) {
            continue;
        }
        left.set(seed, false);
        let (mut members, mut next) = (vec![seed], 0);
        while next < members.len() {
            let voxel = grid.coordinates(members[next]);
            next += 1;
            let span = |k: usize| voxel[k].saturating_sub(1)..(voxel[k] + 2).min(grid.dims[k]);
            for (z, y) in span(2).flat_map(|z| span(1).map(move |y| (z, y))) {
                for x in span(0) {
                    let index = grid.index([x, y, z]);
                    if left.get(index) {
                        left.set(index, false);
                        members.push(index);
                    }
                }
            }
        }
        found.push(members);
    }
    found
}

/// The half-open box of voxels that holds all occupied voxels; `None` where none is.
pub fn occupied_box(occupancy: &Occupancy) -> Option<([usize; 3], [usize; 3])> {
    let (mut low, mut high) = ([usize::MAX; 3], [0; 3]);
    for index in occupancy.indices() {
        let voxel = occupancy.grid.coordinates(index);
        for k in 0..3 {
            low[k] = low[k].min(voxel[k]);
            high[k] = high[k].max(voxel[k] + 1);
        }
    }
    (high[0] > 0).then_some((low, high))
}

fn carved(carver: &Carver) -> Occupancy {
    let grid = carver.grid;
    let plane = grid.dims[0] * grid.dims[1];
    let slabs: Vec<(usize, Vec<u64>)> = (0..grid.dims[2].div_ceil(BLOCK))
        .into_par_iter()
        .map(|slab| {
            let (z0, z1) = (slab * BLOCK, ((slab + 1) * BLOCK).min(grid.dims[2]));
            let first_word = z0 * plane / 64;
            let mut bits = Bits { first: first_word * 64, words: vec![0; (z1 * plane).div_ceil(64) - first_word] };
            for y in (0..grid.dims[1]).step_by(BLOCK) {
                for x in (0..grid.dims[0]).step_by(BLOCK) {
                    carver.block([x, y, z0], BLOCK, &carver.all, 0, &mut bits);
                }
            }
            (first_word, bits.words)
        })
        .collect();
    let mut occupancy = Occupancy::empty(*grid);
    for (first, words) in slabs {
        for (target, word) in occupancy.words[first..].iter_mut().zip(words) {
            *target |= word;
        }
    }
    occupancy
}

/// Bits of a slab of voxels.
struct Bits {
    /// Linear index of the first bit.
    first: usize,
    words: Vec<u64>,
}

impl Bits {
    fn set_run(&mut self, start: usize, count: usize) {
        for bit in start - self.first..start - self.first + count {
            self.words[bit / 64] |= 1 << (bit % 64);
        }
    }
}

/// What of a voxel has to be inside.
#[derive(Clone, Copy, PartialEq)]
enum Test {
    /// Its centre.
    Centres,
    /// Any part, by the bounding rectangle of its projection.
    Touch,
}

struct Carver<'a> {
    views: &'a [CarvingView<'a>],
    /// Homogeneous pixel coordinates of the grid's corner and their steps along x, y, z, one a view.
    maps: Vec<[DVec3; 4]>,
    grid: &'a Grid,
    least_views: usize,
    test: Test,
    all: Vec<usize>,
}

impl<'a> Carver<'a> {
    fn new(views: &'a [CarvingView<'a>], grid: &'a Grid, least_views: usize, test: Test) -> Self {
        let map = |view: &CarvingView| {
            let camera = view.camera;
            let pixels = |p: DVec3| {
                let ([fx, fy], [cx, cy]) = (camera.focal, camera.principal);
                DVec3::new(fx * p.x + cx * p.z, fy * p.y + cy * p.z, p.z)
            };
            let step = |axis: DVec3| pixels(camera.camera_from_world.vector(axis * grid.voxel_mm));
            let corner = pixels(camera.camera_from_world.point(grid.origin));
            [corner, step(DVec3::X), step(DVec3::Y), step(DVec3::Z)]
        };
        let maps = views.iter().map(map).collect();
        Self { views, maps, grid, least_views, test, all: (0..views.len()).collect() }
    }

    /// Decides a block: `open` are the views that have not decided above, `inside` how many said inside.
    fn block(&self, low: [usize; 3], edge: usize, open: &[usize], inside: usize, bits: &mut Bits) {
        let high = [0, 1, 2].map(|k| (low[k] + edge).min(self.grid.dims[k]));
        if (0..3).any(|k| low[k] >= high[k]) {
            return;
        }
        let (mut undecided, mut inside, mut hopeful) = (Vec::with_capacity(open.len()), inside, 0);
        for &view in open {
            match self.coverage(view, low, high) {
                Coverage::Outside => return,
                Coverage::Inside => inside += 1,
                Coverage::Unsupported => undecided.push(view),
                Coverage::Mixed => {
                    undecided.push(view);
                    hopeful += 1;
                }
                Coverage::Unseen => {}
            }
        }
        if inside + hopeful < self.least_views {
            return;
        }
        if undecided.is_empty() || edge == 1 {
            for (z, y) in (low[2]..high[2]).flat_map(|z| (low[1]..high[1]).map(move |y| (z, y))) {
                bits.set_run(self.grid.index([low[0], y, z]), high[0] - low[0]);
            }
        } else if edge <= LEAF && self.test == Test::Centres {
            self.leaf(low, high, &undecided, inside, bits);
        } else {
            let half = edge / 2;
            for child in 0..8 {
                let corner = [0, 1, 2].map(|k| low[k] + half * (child >> k & 1));
                self.block(corner, half, &undecided, inside, bits);
            }
        }
    }

    fn leaf(&self, low: [usize; 3], high: [usize; 3], open: &[usize], inside: usize, bits: &mut Bits) {
        for z in low[2]..high[2] {
            for y in low[1]..high[1] {
                for x in low[0]..high[0] {
                    let (mut seen, mut carved) = (inside, false);
                    for &view in open {
                        match self.voxel(view, [x, y, z]) {
                            Some(false) => {
                                carved = true;
                                break;
                            }
                            Some(true) => seen += 1,
                            None => {}
                        }
                    }
                    if !carved && seen >= self.least_views {
                        bits.set_run(self.grid.index([x, y, z]), 1);
                    }
                }
            }
        }
    }

    /// What a view says about a voxel's centre.
    fn voxel(&self, view: usize, voxel: [usize; 3]) -> Option<bool> {
        let CarvingView { camera, silhouette } = self.views[view];
        let pixel = if camera.distortion == Distortion::None {
            let h = self.homogeneous(view, voxel.map(|k| k as f64 + 0.5));
            if h.z <= 1e-3 {
                return None;
            }
            DVec2::new(h.x / h.z, h.y / h.z)
        } else {
            project(camera, self.grid.centre(voxel))?
        };
        silhouette.at(pixel.x, pixel.y)
    }

    /// How a block (half-open box of voxels) lies to a view's silhouette: its corners' bounding rectangle, which holds the
    /// projection of the whole block (pinholes keep hulls convex; for lenses a tenth is added on every side).
    fn coverage(&self, view: usize, low: [usize; 3], high: [usize; 3]) -> Coverage {
        let CarvingView { camera, silhouette } = self.views[view];
        let straight = camera.distortion == Distortion::None;
        let (mut least, mut most) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let mut behind = 0u8;
        for corner in 0..8 {
            let at = [0, 1, 2].map(|k| if corner >> k & 1 == 1 { high[k] as f64 } else { low[k] as f64 });
            let h = self.homogeneous(view, at);
            if h.z <= 1.0 {
                behind += 1;
                continue;
            }
            let world = self.grid.origin + DVec3::from_array(at) * self.grid.voxel_mm;
            let pixel = if straight { Some(DVec2::new(h.x / h.z, h.y / h.z)) } else { project(camera, world) };
            let Some(pixel) = pixel else { return Coverage::Mixed };
            (least, most) = (least.min(pixel), most.max(pixel));
        }
        match behind {
            8 => return Coverage::Unseen,
            0 => {}
            _ => return Coverage::Mixed,
        }
        // A hundredth of a pixel covers the rounding between this and the voxels' own projection.
        let slack = if straight { DVec2::splat(0.01) } else { (most - least) * 0.1 + 0.5 };
        silhouette.coverage((least - slack).to_array(), (most + slack).to_array())
    }

    fn homogeneous(&self, view: usize, [x, y, z]: [f64; 3]) -> DVec3 {
        let [corner, dx, dy, dz] = &self.maps[view];
        *corner + *dx * x + *dy * y + *dz * z
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use strandflow_core::{Mask, Plane, RigidTransform};

    fn camera(angle: f64, distortion: Distortion) -> Camera {
        Camera {
            name: format!("{angle}"),
            width: 160,
            height: 120,
            focal: [350.0, 345.0],
            principal: [81.0, 59.0],
            distortion,
            camera_from_world: RigidTransform {
                rotation: glam::DMat3::from_rotation_x(0.3) * glam::DMat3::from_rotation_y(angle),
                translation: DVec3::new(4.0, -9.0, 1000.0),
            },
        }
    }

    /// A ragged blob that touches the image's lower border.
    fn mask() -> Mask {
        Plane::from_fn(160, 120, |x, y| {
            let (dx, dy) = (x as f64 - 80.0, y as f64 - 75.0);
            let reach = 30.0 + 9.0 * (7.0 * dy.atan2(dx)).sin() + if y > 90 { 9.0 } else { 0.0 };
            if dx.hypot(dy) < reach { 255 } else { 0 }
        })
    }

    #[test]
    fn carving_equals_testing_every_voxel_in_every_view() {
        let lens = Distortion::BrownConrady([-0.25, 0.1, 1e-3, -1e-3, 0.0, 0.0, 0.0, 0.0]);
        for distortion in [Distortion::None, lens] {
            let cameras: Vec<Camera> = (0..5).map(|i| camera(i as f64 * 0.6, distortion)).collect();
            let silhouette = Silhouette::from_mask(&mask(), 40, 1.5);
            let views: Vec<_> = cameras.iter().map(|camera| CarvingView { camera, silhouette: &silhouette }).collect();
            let grid = Grid { origin: DVec3::new(-130.0, -90.0, -120.0), voxel_mm: 3.0, dims: [83, 77, 79] };
            for least in [1, 2, 5] {
                let found = carve(&views, &grid, least);
                let touching = carve_touching(&views, &grid, least);
                let mut occupied = 0;
                for index in 0..grid.len() {
                    let says = |view: &CarvingView| {
                        let pixel = project(view.camera, grid.centre_of_index(index))?;
                        view.silhouette.at(pixel.x, pixel.y)
                    };
                    let verdicts: Vec<bool> = views.iter().filter_map(says).collect();
                    let expected = verdicts.len() >= least && verdicts.iter().all(|&inside| inside);
                    assert_eq!(found.get(index), expected, "voxel {index}");
                    assert!(touching.get(index) || !expected);
                    occupied += usize::from(expected);
                }
                assert!(occupied > 1000);
            }
        }
    }

    #[test]
    fn the_occupied_box_is_tight() {
        let grid = Grid { origin: DVec3::ZERO, voxel_mm: 1.0, dims: [9, 8, 7] };
        let mut occupancy = Occupancy::empty(grid);
        assert_eq!(occupied_box(&occupancy), None);
        occupancy.set(grid.index([2, 3, 4]), true);
        occupancy.set(grid.index([5, 3, 1]), true);
        assert_eq!(occupied_box(&occupancy), Some(([2, 3, 1], [6, 4, 5])));
        occupancy.set(grid.index([6, 4, 2]), true);
        assert_eq!(occupied_box(&largest_component(&occupancy)), Some(([5, 3, 1], [7, 5, 3])));
    }
}
