//! Stage 7, second part: how the hair moved since the frame before, at every voxel of its volume.
//!
//! Every pixel of every view that shows hair says how far the hair there moved across its strands in the image: the
//! brightness of the frame before, where the motion so far would have the pixel's hair, less that of this frame, over the
//! gradient across the strand. Along a strand hair looks the same a little further on, so nothing is asked there. The
//! equations of all views meet in the voxels they show and are diffused through the volume as vectors with matrix weights,
//! which is the window they are pooled in; then images are compared anew, from blurred to sharp. Everything is relative to
//! the head's motion, so that what nobody saw moves with the head. Hair does not stretch: what it does along itself comes
//! from its roots.
//!
//! Images are normalised by the mean and deviation of the hair around each pixel first: highlights and shading stay
//! where light and head are while hair moves through them, and pull plain flow towards no motion.
//!
//! Much of what is seen of hair in one frame is not there in the next, being under other hair. Gradients of a single frame
//! count that as texture, and the motion comes out too small, by half on rendered hair; what both frames show of the
//! gradient does not.
//!
//! Reference: Lucas & Kanade 1981; Vedula et al. 2005 (scene flow); Horn & Schunck 1981 (aperture).
//! *Deviation*: Zhang et al. 2012 §4 grow every frame by itself, because correspondence of strands is not reliable where
//! motion is large. Here correspondence comes from the images, not from the strands.

use glam::{DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;
use strandflow_core::{Camera, Mask, Occupancy, Plane, RgbImage, Rig, RigidTransform, SparseVoxels};
use strandflow_geometry::project::{project, ray};
use strandflow_image::{
    colour::luma_of,
    filter::{Spread, Window, gradients},
    region::Region,
    sample::bilinear_of,
};
use strandflow_volume::{
    diffuse::{Constraint, Diffusion, Inextensible, Solver},
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

/// Blur of the images, coarse to fine \[px\], and how often they are compared at it.
const SCALES: [(f32, usize); 3] = [(4.0, 1), (2.0, 1), (1.0, 2)];
/// Deviation of the window in which a view's equations are pooled \[px\]. Texture of hair says little in smaller ones.
const WINDOW_PX: f32 = 24.0;
/// Least deviation of the neighbourhood that brightness is normalised by \[px\].
const AROUND_PX: f32 = 8.0;
/// Deviation of brightness below which there is only noise \[code values\].
const DARK: f32 = 2.0;
/// Scale of the robust function of normalised brightness, in local deviations.
const MISS_SCALE: f32 = 1.0;
/// Weight of a pixel's pooled equations against the pull of one neighbouring voxel.
const PIXEL_WEIGHT: f32 = 15.0;
/// Least share of the texture that both frames have; less is a matter of chance.
const LEAST_SHARED: f32 = 0.3;
/// Weight of the head's motion across the hair at a root, against one neighbouring voxel. Hair may slide from its root on.
const ROOT_WEIGHT: f32 = 0.1;
/// The same along the hair.
const ROOT_WEIGHT_ALONG: f32 = 30.0;
/// How much stiffer hair is along itself than neighbouring voxels are tied to each other.
const STIFFNESS: f32 = 50.0;

/// The displacement \[mm\] of every voxel of the field from where its hair was in the frame before, world.
pub fn motion(input: &MotionInput, settings: &FieldSettings) -> SparseVoxels<Vec3> {
    let grid = input.field.grid;
    let before_from_now = input.world_from_head_before.after(&input.world_from_head.inverse());
    let leak = (grid.voxel_mm / settings.motion_fade_mm).powi(2) as f32;
    let solver = Solver { levels: settings.levels, sweeps: settings.sweeps, relaxation: 1.5, leak };
    let rooted = root_constraints(input);
    let strands: Vec<Inextensible> =
        input.field.values.iter().map(|voxel| Inextensible::along(voxel.direction, STIFFNESS)).collect();
    let diffusion = Diffusion::new(&grid, &input.field.indices, &strands, &solver);
    let views = View::all(input);
    // Hair is slow to follow the head: where the camera saw it a frame ago is the better start.
    let still = |&index: &u32| {
        let point = grid.centre_of_index(index as usize);
        (point - before_from_now.point(point)).as_vec3()
    };
    let mut back: Vec<Vec3> = input.field.indices.par_iter().map(still).collect();
    let hairs: Vec<[Hair; 2]> = views.par_iter().map(|view| view.hairs(input)).collect();
    for (scale, times) in SCALES {
        let images: Vec<Images> = hairs.par_iter().map(|hairs| Images::blurred(hairs, scale)).collect();
        for _ in 0..times {
            let equations = |(view, images): (&View, &Images)| view.equations(input, images, before_from_now, &back);
            let seen: Vec<Vec<Equations>> = views.par_iter().zip(&images).map(equations).collect();
            let mut constraints = rooted.clone();
            for (rank, seen) in seen.iter().flatten() {
                constraints[*rank as usize].weight += seen.weight * PIXEL_WEIGHT;
                constraints[*rank as usize].pull += seen.pull * PIXEL_WEIGHT;
            }
            back = diffusion.solve(&constraints);
        }
    }
    let displacement = |(&index, back): (&u32, Vec3)| {
        let point = grid.centre_of_index(index as usize);
        (point - before_from_now.point(point)).as_vec3() - back
    };
    let values = input.field.indices.par_iter().zip(back).map(displacement).collect();
    SparseVoxels { grid, indices: input.field.indices.clone(), values }
}

/// At the roots hair moves with the head: surely along itself, where it does not stretch, less surely across.
fn root_constraints(input: &MotionInput) -> Vec<Constraint<Vec3>> {
    let grid = input.field.grid;
    let mut rooted = Occupancy::empty(grid);
    for root in input.roots {
        if let Some(voxel) = grid.voxel_at(input.world_from_head.point(*root)) {
            rooted.set(grid.index(voxel), true);
        }
    }
    let all = Tensor([ROOT_WEIGHT, ROOT_WEIGHT, ROOT_WEIGHT, 0.0, 0.0, 0.0]);
    let of = |(&index, voxel): (&u32, &FieldVoxel)| {
        let weight = if rooted.get(index as usize) {
            all + Tensor::of_line(voxel.direction) * ROOT_WEIGHT_ALONG
        } else {
            Tensor::default()
        };
        Constraint { pull: Vec3::ZERO, weight }
    };
    input.field.indices.iter().zip(&input.field.values).map(of).collect()
}

/// What a pixel says about the voxel that it shows: position of the voxel in the field, equations in u \[mm\].
type Equations = (u32, Constraint<Vec3>);

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
    x: usize,
    y: usize,
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
                Some(Shown { x, y, rank: rank as u32, point })
            };
            let pixels = (region.y..region.y + region.height)
                .flat_map(|y| (region.x..region.x + region.width).map(move |x| (x, y)));
            Some(Self { camera, view, region, shown: pixels.filter_map(shown).collect() })
        };
        (0..input.rig.view_count()).into_par_iter().filter_map(of).collect()
    }

    /// The view's hair in this frame and in the one before.
    fn hairs(&self, input: &MotionInput) -> [Hair; 2] {
        let (view, region) = (self.view, self.region);
        [(input.images, input.hairs), (input.images_before, input.hairs_before)]
            .map(|(images, hairs)| Hair::new(images[view], hairs[view], region))
    }

    /// What the view's images say; `back` is the motion so far.
    fn equations(
        &self,
        input: &MotionInput,
        images: &Images,
        before_from_now: RigidTransform,
        back: &[Vec3],
    ) -> Vec<Equations> {
        let (view, region) = (self.view, self.region);
        let expected = |shown: &Shown| {
            let point = before_from_now.point(shown.point) + back[shown.rank as usize].as_dvec3();
            Some((point, project(self.camera, point)?))
        };
        let pixels: Vec<Option<(DVec3, DVec2)>> = self.shown.iter().map(expected).collect();
        let pooled = self.pooled(input.maps[view], images, &pixels);
        let equations = |(shown, at): (&Shown, &Option<(DVec3, DVec2)>)| {
            let (point, pixel) = (*at)?;
            let rows = self.image_motion(point, pixel, input.field.values[shown.rank as usize].direction)?;
            let normal = pooled.at(shown.x - region.x, shown.y - region.y);
            Some((shown.rank, lifted(rows, normal, back[shown.rank as usize])))
        };
        self.shown.iter().zip(&pixels).filter_map(equations).collect()
    }

    /// The normal equations of the image motion across the strands, pooled around every pixel.
    fn pooled(
        &self,
        map: &OrientationMap,
        Images { now, before }: &Images,
        expected: &[Option<(DVec3, DVec2)>],
    ) -> Pooled {
        let region = self.region;
        let said = |(shown, expected): (&Shown, &Option<(DVec3, DVec2)>)| {
            let (_, pixel) = (*expected)?;
            let (here, there) = ((shown.x - region.x, shown.y - region.y), pixel - region.corner());
            let confidence = map.confidence[(shown.x, shown.y)];
            (confidence > 0.0 && region.holds(pixel)).then_some(())?;
            let [image_before, x_before, y_before, hair_before] = bilinear_of(before, there.x as f32, there.y as f32);
            let across = Vec2::from_angle(map.angle[(shown.x, shown.y)]).perp();
            let slope_now = across.dot(Vec2::new(now.gradient[0][here], now.gradient[1][here]));
            let slope_before = across.dot(Vec2::new(x_before, y_before));
            let slope = across * (0.5 * (slope_now + slope_before));
            let miss = image_before - now.image[here];
            let robust = (1.0 + (miss / MISS_SCALE).powi(2)).powi(2).recip();
            let weight = robust * confidence * hair_before;
            let [xx, xy, yy] = [slope.x * slope.x, slope.x * slope.y, slope.y * slope.y];
            let [xx, xy, yy, x_miss, y_miss, common] =
                [xx, xy, yy, slope.x * miss, slope.y * miss, slope_now * slope_before].map(|value| weight * value);
            Some(([here.0, here.1], [xx, xy, yy, x_miss, y_miss, common, 1.0]))
        };
        let pixels = self.shown.iter().zip(expected).filter_map(said);
        Pooled(Spread::new((region.width, region.height), pixels, WINDOW_PX))
    }

    /// How the image point of a world point moves with it, shape (2, 3) \[px/mm\]; nothing along the strand: the image's
    /// strand and the voxel's line differ a little, and that must not pass for motion along the line.
    fn image_motion(&self, point: DVec3, pixel: DVec2, line: Vec3) -> Option<[Vec3; 2]> {
        let column = |axis: DVec3| -> Option<DVec2> { Some(project(self.camera, point + axis)? - pixel) };
        let columns = [column(DVec3::X)?, column(DVec3::Y)?, column(DVec3::Z)?];
        let row = |k: usize| Vec3::from_array(columns.map(|c| c[k] as f32));
        let across = |row: Vec3| row - line * row.dot(line);
        Some([across(row(0)), across(row(1))])
    }
}

/// The equations in space of the normal equations S w + s = 0 of an image motion w beyond the one so far.
fn lifted([jx, jy]: [Vec3; 2], [xx, xy, yy, x, y]: [f32; 5], so_far: Vec3) -> Constraint<Vec3> {
    let (p, q) = (jx * xx + jy * xy, jx * xy + jy * yy);
    let entry = |i: usize, j: usize| p[i] * jx[j] + q[i] * jy[j];
    let weight = Tensor([entry(0, 0), entry(1, 1), entry(2, 2), entry(0, 1), entry(0, 2), entry(1, 2)]);
    Constraint { pull: weight.apply(so_far) - jx * x - jy * y, weight }
}

/// Normal equations of the image motion, pooled in a Gaussian window: sums of gₓ², gₓgᵧ, gᵧ², gₓr, gᵧr, of the product of the
/// slopes of both frames, and of the pixels that said so.
struct Pooled(Spread<7>);

impl Pooled {
    /// The equations: gₓ², gₓgᵧ, gᵧ², and gₓr, gᵧr over the share of the texture that both frames have.
    fn at(&self, x: usize, y: usize) -> [f32; 5] {
        let [sums @ .., used] = self.0.at(x, y);
        let [xx, xy, yy, x_miss, y_miss, common] = sums.map(|sum| sum / used.max(1e-3));
        let shared = (common / (xx + yy).max(1e-9)).clamp(LEAST_SHARED, 1.0);
        [xx, xy, yy, x_miss / shared, y_miss / shared]
    }
}

/// A view in this frame and in the one before.
struct Images {
    now: Normalised,
    /// Image, gradient along x and y, and hair, side by side: it is asked between pixels.
    before: Plane<[f32; 4]>,
}

impl Images {
    /// Blurred by `scale` \[px\].
    fn blurred([now, before]: &[Hair; 2], scale: f32) -> Self {
        Self { now: now.normalised(scale), before: before.normalised(scale).side_by_side() }
    }
}

/// Luminance of a region and its coverage by hair.
struct Hair {
    luma: Plane<f32>,
    coverage: Plane<f32>,
    /// The local mean of the hair's luminance, in the smallest neighbourhood.
    around: Around,
}

/// The neighbourhoods of all pixels of hair.
struct Around {
    window: Window,
    mean: Plane<f32>,
}

impl Around {
    fn new(luma: &Plane<f32>, coverage: &Plane<f32>, sigma: f32) -> Self {
        let window = Window::new(coverage, sigma);
        Self { mean: window.mean(luma, coverage), window }
    }
}

/// Luminance less the local mean of the hair and over its local deviation; zero beside the hair.
struct Normalised {
    image: Plane<f32>,
    /// Along x and y \[1/px\].
    gradient: [Plane<f32>; 2],
    /// Coverage by hair, blurred as the image.
    hair: Plane<f32>,
}

impl Normalised {
    fn side_by_side(&self) -> Plane<[f32; 4]> {
        let [gx, gy] = &self.gradient;
        let at = |i: usize| [self.image.data[i], gx.data[i], gy.data[i], self.hair.data[i]];
        Plane { width: self.image.width, height: self.image.height, data: (0..self.image.data.len()).map(at).collect() }
    }
}

impl Hair {
    fn new(image: &RgbImage, hair: &Mask, region: Region) -> Self {
        let luma = region.crop(image, |&colour| luma_of(colour));
        let coverage = region.crop(hair, |&m| if m >= 128 { 1.0 } else { 0.0 });
        Self { around: Around::new(&luma, &coverage, AROUND_PX), luma, coverage }
    }

    /// The image, blurred by `scale` \[px\].
    fn normalised(&self, scale: f32) -> Normalised {
        let Self { luma, coverage, around } = self;
        let wider = (3.0 * scale > AROUND_PX).then(|| Around::new(luma, coverage, 3.0 * scale));
        let Around { window, mean } = wider.as_ref().unwrap_or(around);
        let near = Window::new(coverage, scale);
        let off = together(&near.mean(luma, coverage), mean, |smooth, mean| smooth - mean);
        let variance = window.mean(&off.map(|o| o * o), coverage);
        let even = together(&off, &variance, |off, variance| off / (variance.sqrt() + DARK));
        let image = together(&even, coverage, |value, hair| value * hair);
        let (gx, gy) = gradients(&image);
        Normalised { image, gradient: [gx, gy], hair: near.weight }
    }
}

/// A plane of two, sample by sample.
fn together(a: &Plane<f32>, b: &Plane<f32>, f: impl Fn(f32, f32) -> f32) -> Plane<f32> {
    let data = a.data.iter().zip(&b.data).map(|(a, b)| f(*a, *b)).collect();
    Plane { width: a.width, height: a.height, data }
}
