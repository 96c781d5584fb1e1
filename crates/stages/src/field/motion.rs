//! Stage 7, second part: how the hair moved since the frame before, at every voxel of its volume.
//!
//! Every pixel of every view that shows hair says how far the hair there moved across its strands in the image: the
//! brightness of the frame before, where the motion so far would have the pixel's hair, less that of this frame, over the
//! gradient across the strand. Along a strand hair looks the same a little further on, so nothing is asked there. The
//! equations of all views meet in the voxels they show and are diffused through the volume as vectors with matrix weights,
//! which is the window they are pooled in; then images are compared anew, from blurred to sharp. Everything is relative to
//! the head's motion, so that what nobody saw moves with the head.
//!
//! Images are normalised by the mean and deviation of the hair around each pixel first: highlights and shading stay
//! where light and head are while hair moves through them, and pull plain flow towards no motion.
//!
//! Reference: Lucas & Kanade 1981; Vedula et al. 2005 (scene flow); Horn & Schunck 1981 (aperture).
//! *Deviation*: Zhang et al. 2012 §4 grow every frame by itself, because correspondence of strands is not reliable where
//! motion is large. Here correspondence comes from the images, not from the strands.

use glam::{DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;
use strandflow_core::{Camera, Mask, Occupancy, Plane, RgbImage, Rig, RigidTransform, SparseVoxels};
use strandflow_geometry::project::{project, ray};
use strandflow_image::{
    filter::{gaussian, gaussian_where, gradients},
    region::Region,
    sample::bilinear,
};
use strandflow_volume::{
    diffuse::{Constraint, Solver, diffuse},
    tensor::Tensor,
    velocity::VoxelIndex,
    visibility::{DepthMap, surface_voxels},
};

use super::{FieldSettings, FieldVoxel};
use crate::orient::OrientationMap;

/// What one frame needs, beside the frame before.
pub struct MotionInput<'a> {
    /// The cameras.
    pub rig: &'a Rig,
    /// The line field; motion is defined on its voxels.
    pub field: &'a SparseVoxels<FieldVoxel>,
    /// Orientation maps, one a view.
    pub maps: &'a [&'a OrientationMap],
    /// This frame, one image a view.
    pub images: &'a [&'a RgbImage],
    /// The frame before.
    pub images_before: &'a [&'a RgbImage],
    /// Hair masks of this frame, one a view.
    pub hairs: &'a [&'a Mask],
    /// Hair masks of the frame before.
    pub hairs_before: &'a [&'a Mask],
    /// Roots in head space \[mm\].
    pub roots: &'a [DVec3],
    /// The head's motion in this frame.
    pub world_from_head: RigidTransform,
    /// The head's motion in the frame before.
    pub world_from_head_before: RigidTransform,
}

fn knob(name: &str, default: f32) -> f32 {
    std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(default)
}

/// Blur of the images, coarse to fine \[px\].
const SCALES: [f32; 3] = [4.0, 2.0, 1.0];

/// The displacement \[mm\] of every voxel of the field from where its hair was in the frame before, world.
pub fn motion(input: &MotionInput, settings: &FieldSettings) -> SparseVoxels<Vec3> {
    let grid = input.field.grid;
    let before_from_now = input.world_from_head_before.after(&input.world_from_head.inverse());
    let leak = (grid.voxel_mm / settings.motion_fade_mm).powi(2) as f32;
    let solver = Solver { levels: settings.levels, sweeps: settings.sweeps, relaxation: 1.5, leak };
    let rooted = root_constraints(input);
    let views = View::all(input);
    let start = |&index: &u32| {
        let point = grid.centre_of_index(index as usize);
        (point - before_from_now.point(point)).as_vec3() * knob("INIT", 0.0)
    };
    let mut back: Vec<Vec3> = input.field.indices.iter().map(start).collect();
    let line_weight = knob("LW", 0.05);
    let finest = knob("FINEST", 1.0);
    let repeats = knob("REP", 1.0) as usize;
    for scale in SCALES.into_iter().filter(|s| *s >= finest).flat_map(|s| std::iter::repeat_n(s, repeats)) {
        let seen: Vec<Vec<(u32, Constraint<Vec3>)>> =
            views.par_iter().map(|view| view.equations(input, scale, before_from_now, &back)).collect();
        let mut constraints = rooted.clone();
        for (rank, e) in seen.iter().flatten() {
            let c = &mut constraints[*rank as usize];
            c.weight += e.weight * line_weight;
            c.pull += e.pull * line_weight;
        }
        back = diffuse(&grid, &input.field.indices, &constraints, &solver);
    }
    let displacement = |(&index, back): (&u32, Vec3)| {
        let point = grid.centre_of_index(index as usize);
        (point - before_from_now.point(point)).as_vec3() - back
    };
    let values = input.field.indices.par_iter().zip(back).map(displacement).collect();
    SparseVoxels { grid, indices: input.field.indices.clone(), values }
}

/// At the roots hair moves with the head.
fn root_constraints(input: &MotionInput) -> Vec<Constraint<Vec3>> {
    let grid = input.field.grid;
    let mut rooted = Occupancy::empty(grid);
    for root in input.roots {
        if let Some(voxel) = grid.voxel_at(input.world_from_head.point(*root)) {
            rooted.set(grid.index(voxel), true);
        }
    }
    let weight = knob("RW", 4.0);
    let of = |&index: &u32| {
        let weight = if rooted.get(index as usize) { weight } else { 0.0 };
        Constraint { pull: Vec3::ZERO, weight: Tensor([weight, weight, weight, 0.0, 0.0, 0.0]) }
    };
    input.field.indices.iter().map(of).collect()
}

/// One view: its pixels of hair and the voxels they show.
struct View<'a> {
    camera: &'a Camera,
    view: usize,
    region: Region,
    shown: Vec<Shown>,
}

/// A pixel of hair.
#[derive(Clone, Copy)]
struct Shown {
    x: u32,
    y: u32,
    /// Position of the voxel in the field.
    rank: u32,
    /// The world point it shows \[mm\].
    point: DVec3,
}

impl<'a> View<'a> {
    fn all(input: &MotionInput<'a>) -> Vec<Self> {
        let grid = input.field.grid;
        let mut volume = Occupancy::empty(grid);
        input.field.indices.iter().for_each(|&index| volume.set(index as usize, true));
        let (surface, lookup) = (surface_voxels(&volume), VoxelIndex::new(&volume));
        let of = |view: usize| {
            let camera = &input.rig.cameras[view];
            let region = Region::bounding(input.hairs[view], |&m| m >= 128)?.grown(24, camera.width, camera.height);
            let first = DepthMap::of_voxels(camera, &grid, &surface);
            let shown = |(x, y): (usize, usize)| {
                let z = first.depth[(x, y)];
                (input.hairs[view][(x, y)] >= 128 && z.is_finite()).then_some(())?;
                let ray = ray(camera, DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
                let per_depth = 1.0 / camera.camera_from_world.rotation.row(2).dot(ray.direction);
                let point = ray.origin + ray.direction * (f64::from(z) * per_depth);
                let rank = lookup.rank(grid.index(grid.voxel_at(point)?))?;
                Some(Shown { x: x as u32, y: y as u32, rank: rank as u32, point })
            };
            let pixels = (region.y..region.y + region.height)
                .flat_map(|y| (region.x..region.x + region.width).map(move |x| (x, y)));
            Some(Self { camera, view, region, shown: pixels.filter_map(shown).collect() })
        };
        (0..input.rig.view_count()).into_par_iter().filter_map(of).collect()
    }

    /// What the pixels say across their strands, images blurred by `scale` \[px\], pooled over a window.
    fn equations(
        &self,
        input: &MotionInput,
        scale: f32,
        before_from_now: RigidTransform,
        back: &[Vec3],
    ) -> Vec<(u32, Constraint<Vec3>)> {
        let (view, region) = (self.view, self.region);
        let now = Normalised::new(input.images[view], input.hairs[view], region, scale);
        let before = Normalised::new(input.images_before[view], input.hairs_before[view], region, scale);
        let map = input.maps[view];
        let (robust_scale, use_conf, reject) = (knob("ROB", 1.0), knob("CONF", 1.0), knob("REJ", 0.0));
        let across = knob("ACROSS", 1.0);
        let mut sums: [Plane<f32>; 5] =
            std::array::from_fn(|_| Plane::filled(region.width, region.height, 0.0f32));
        let mut used = Plane::filled(region.width, region.height, 0.0f32);
        for shown in &self.shown {
            let at = (shown.x as usize, shown.y as usize);
            let confidence = if use_conf > 0.0 { map.confidence[at].powf(use_conf) } else { 1.0 };
            if confidence <= 0.0 {
                continue;
            }
            let so_far = back[shown.rank as usize];
            let moved = before_from_now.point(shown.point) + so_far.as_dvec3();
            let Some(expected) = project(self.camera, moved) else { continue };
            let (x, y) = (expected.x as f32 - region.x as f32, expected.y as f32 - region.y as f32);
            if !(x > 0.0 && y > 0.0 && x < region.width as f32 && y < region.height as f32) {
                continue;
            }
            let here = (at.0 - region.x, at.1 - region.y);
            let there = bilinear(&before.weight, x, y);
            let gradient = 0.5
                * (Vec2::new(now.gx[here], now.gy[here])
                    + Vec2::new(bilinear(&before.gx, x, y), bilinear(&before.gy, x, y)));
            let miss = bilinear(&before.image, x, y) - now.image[here];
            let n = Vec2::from_angle(map.angle[at]).perp();
            let g = if across > 0.0 { n * n.dot(gradient) } else { gradient };
            let weight = (1.0 + (miss / robust_scale).powi(2)).powi(2).recip() * confidence * there;
            let all = [g.x * g.x, g.x * g.y, g.y * g.y, g.x * miss, g.y * miss];
            sums.iter_mut().zip(all).for_each(|(sum, value)| sum[here] = weight * value);
            used[here] = 1.0;
        }
        let window = knob("WIN", 16.0);
        let sums = sums.map(|sum| gaussian(&sum, window));
        let used = gaussian(&used, window);
        let of = |shown: &Shown| -> Option<(u32, Constraint<Vec3>)> {
            let here = (shown.x as usize - region.x, shown.y as usize - region.y);
            let [xx, xy, yy, xr, yr] = sums.each_ref().map(|sum| sum[here] / used[here].max(1e-3));
            let so_far = back[shown.rank as usize];
            let moved = before_from_now.point(shown.point) + so_far.as_dvec3();
            let expected = project(self.camera, moved)?;
            let column =
                |axis: DVec3| -> Option<Vec2> { Some((project(self.camera, moved + axis)? - expected).as_vec2()) };
            let columns = [column(DVec3::X)?, column(DVec3::Y)?, column(DVec3::Z)?];
            let mut rows = [0, 1].map(|k| Vec3::from_array(columns.map(|c| c[k])));
            if reject > 0.0 {
                let d = input.field.values[shown.rank as usize].direction;
                if d.length_squared() > 0.5 {
                    rows = rows.map(|row| row.reject_from_normalized(d));
                }
            }
            // JᵀSJ and Jᵀ(SJu − s).
            let [jx, jy] = rows;
            let (p, q) = (jx * xx + jy * xy, jx * xy + jy * yy);
            let weight = Tensor([
                p.x * jx.x + q.x * jy.x,
                p.y * jx.y + q.y * jy.y,
                p.z * jx.z + q.z * jy.z,
                p.x * jx.y + q.x * jy.y,
                p.x * jx.z + q.x * jy.z,
                p.y * jx.z + q.y * jy.z,
            ]);
            let pull = weight.apply(so_far) - jx * xr - jy * yr;
            Some((shown.rank, Constraint { pull, weight }))
        };
        self.shown.iter().filter_map(of).collect()
    }
}

/// Luminance of a region, less the local mean of the hair and over its local deviation, with its gradient.
struct Normalised {
    image: Plane<f32>,
    gx: Plane<f32>,
    gy: Plane<f32>,
    /// Coverage by hair, blurred as the image.
    weight: Plane<f32>,
}

impl Normalised {
    fn new(image: &RgbImage, hair: &Mask, region: Region, scale: f32) -> Self {
        let luma = region.crop(image, |c| 0.299 * f32::from(c[0]) + 0.587 * f32::from(c[1]) + 0.114 * f32::from(c[2]));
        let hair = region.crop(hair, |&m| if m >= 128 { 1.0 } else { 0.0 });
        let around = (knob("NORM", 8.0)).max(3.0 * scale);
        let smooth = gaussian_where(&luma, &hair, scale);
        let mean = gaussian_where(&luma, &hair, around);
        let zip = |a: &Plane<f32>, b: &Plane<f32>, f: &dyn Fn(f32, f32) -> f32| Plane {
            width: a.width,
            height: a.height,
            data: a.data.iter().zip(&b.data).map(|(a, b)| f(*a, *b)).collect(),
        };
        let off = zip(&smooth, &mean, &|s, m| s - m);
        let deviation = gaussian_where(&off.map(|o| o * o), &hair, around);
        let image = zip(&off, &deviation, &|o, d| o / (d.sqrt() + 2.0));
        let image = zip(&image, &hair, &|i, h| i * h);
        let weight = gaussian(&hair, scale);
        let (gx, gy) = gradients(&image);
        Self { image, gx, gy, weight }
    }
}
