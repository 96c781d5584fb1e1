//! Stage 7, second part: how the hair moved since the frame before, at every voxel of its volume.
//!
//! Image flow says how every pixel moved. A voxel on the hair's surface is seen by several views, and its displacement u
//! is the one whose projections agree with their flows across the strands: Σ_v w (n_v·(J_v u − f_v))², n_v the image
//! normal of the strand there. Along a strand flow says next to nothing: hair looks the same a little further on. What the
//! surface says is diffused through the volume as vectors with matrix weights; at the roots hair moves with the head.
//! Everything is relative to the head's motion, so that what nobody saw moves with the head.
//!
//! Reference: Vedula et al. 2005 (scene flow from several views' image flows); Horn & Schunck 1981 (aperture).
//! *Deviation*: Zhang et al. 2012 §4 grow every frame by itself, because correspondence of strands is not reliable where
//! motion is large. Here correspondence comes from the images, not from the strands.

use glam::{DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;
use strandflow_core::{Camera, Mask, Occupancy, RgbImage, Rig, RigidTransform, SparseVoxels};
use strandflow_geometry::project::{depth, project};
use strandflow_image::{
    flow::{Flow, flow_of_region},
    region::Region,
};
use strandflow_volume::{
    diffuse::{Constraint, Solver, diffuse},
    tensor::Tensor,
    visibility::{DepthMap, surface_voxels},
};

use super::{FieldSettings, FieldVoxel};
use crate::{lift::Line, orient::OrientationMap};

/// What one frame needs, beside the frame before.
pub struct MotionInput<'a> {
    /// The cameras.
    pub rig: &'a Rig,
    /// The hull.
    pub hull: &'a Occupancy,
    /// Observed lines.
    pub lines: &'a SparseVoxels<Line>,
    /// The line field; motion is defined on its voxels.
    pub field: &'a SparseVoxels<FieldVoxel>,
    /// Orientation maps, one a view.
    pub maps: &'a [&'a OrientationMap],
    /// This frame, one image a view.
    pub images: &'a [&'a RgbImage],
    /// The frame before.
    pub images_before: &'a [&'a RgbImage],
    /// Subject masks of this frame, one a view.
    pub subjects: &'a [&'a Mask],
    /// Subject masks of the frame before.
    pub subjects_before: &'a [&'a Mask],
    /// Roots in head space \[mm\].
    pub roots: &'a [DVec3],
    /// The head's motion in this frame.
    pub world_from_head: RigidTransform,
    /// The head's motion in the frame before.
    pub world_from_head_before: RigidTransform,
}

/// Scale of the disagreement of views on a displacement \[px\]: flow is right to half a pixel where it is right.
const FLOW_SCALE_PX: f32 = 1.0;
/// A voxel farther behind the hull than this is not what a view's pixel shows \[mm\].
const SEEN_MM: f32 = 16.0;
/// Weight of a fully trusted voxel's equations of one pixel to a millimetre, against one neighbouring voxel.
const LINE_WEIGHT: f32 = 3.0;
/// Weight of the head's motion at a root, against one neighbouring voxel.
const ROOT_WEIGHT: f32 = 4.0;

/// The displacement \[mm\] of every voxel of the field from where its hair was in the frame before, world.
pub fn motion(input: &MotionInput, settings: &FieldSettings) -> SparseVoxels<Vec3> {
    let surface = surface_voxels(input.hull);
    let views: Vec<View> = (0..input.rig.view_count()).into_par_iter().map(|v| View::new(input, &surface, v)).collect();
    let before_from_now = input.world_from_head_before.after(&input.world_from_head.inverse());
    let grid = input.field.grid;
    let rooted = roots_by_voxel(input);
    let constraint = |(&index, _): (&u32, &FieldVoxel)| {
        let point = grid.centre_of_index(index as usize);
        let seen =
            input.lines.get(index as usize).map(|line| observed(&views, point, before_from_now.point(point), line));
        let mut constraint = seen.unwrap_or_default();
        if rooted.get(index as usize) {
            constraint.weight += Tensor([ROOT_WEIGHT, ROOT_WEIGHT, ROOT_WEIGHT, 0.0, 0.0, 0.0]);
        }
        constraint
    };
    let constraints: Vec<Constraint<Vec3>> =
        input.field.indices.par_iter().zip(&input.field.values).map(constraint).collect();
    let leak = (grid.voxel_mm / settings.motion_fade_mm).powi(2) as f32;
    let solver = Solver { levels: settings.levels, sweeps: settings.sweeps, relaxation: 1.5, leak };
    let relative = diffuse(&grid, &input.field.indices, &constraints, &solver);
    let displacement = |(&index, back): (&u32, Vec3)| {
        let point = grid.centre_of_index(index as usize);
        (point - before_from_now.point(point)).as_vec3() - back
    };
    let values = input.field.indices.par_iter().zip(relative).map(displacement).collect();
    SparseVoxels { grid, indices: input.field.indices.clone(), values }
}

/// The voxels that hold a root.
fn roots_by_voxel(input: &MotionInput) -> Occupancy {
    let mut rooted = Occupancy::empty(input.field.grid);
    for root in input.roots {
        if let Some(voxel) = rooted.grid.voxel_at(input.world_from_head.point(*root)) {
            rooted.set(rooted.grid.index(voxel), true);
        }
    }
    rooted
}

/// One view: what it sees of the hull, how its pixels moved, and the strands' directions in it.
struct View<'a> {
    camera: &'a Camera,
    map: &'a OrientationMap,
    depth: DepthMap,
    flow: Option<(Region, Flow)>,
}

impl<'a> View<'a> {
    fn new(input: &MotionInput<'a>, surface: &[u32], view: usize) -> Self {
        let camera = &input.rig.cameras[view];
        let region = [input.subjects[view], input.subjects_before[view]]
            .into_iter()
            .filter_map(|mask| Region::bounding(mask, |&m| m >= 128))
            .reduce(|a, b| a.union(&b))
            .map(|region| region.grown(16, camera.width, camera.height));
        let flow =
            region.map(|region| (region, flow_of_region(input.images[view], input.images_before[view], region, 1)));
        Self { camera, map: input.maps[view], depth: DepthMap::of_voxels(camera, &input.hull.grid, surface), flow }
    }

    /// The displacement of an image point to the frame before \[px\].
    fn flow_at(&self, pixel: DVec2) -> Option<Vec2> {
        let (region, flow) = self.flow.as_ref()?;
        let (x, y) = (pixel.x - region.x as f64, pixel.y - region.y as f64);
        let inside = x >= 0.0 && y >= 0.0 && x < region.width as f64 && y < region.height as f64;
        inside.then(|| Vec2::from_array(flow.at(x as f32, y as f32)))
    }
}

/// One equation a·u = b \[px\] with its weight.
#[derive(Clone, Copy)]
struct Equation {
    a: Vec3,
    b: f32,
    weight: f32,
}

/// What the views that see a voxel say about its displacement to the frame before, relative to the head's.
///
/// `moved`: where the head's motion alone would have it in the frame before.
fn observed(views: &[View], point: DVec3, moved: DVec3, line: &Line) -> Constraint<Vec3> {
    let equations: Vec<Equation> = views.iter().filter_map(|view| across(view, point, moved, line)).collect();
    if equations.len() < 2 {
        return Constraint::default();
    }
    let mut solution = Vec3::ZERO;
    let mut sum: Constraint<Vec3> = Constraint::default();
    for turn in 0..4 {
        sum = Constraint::default();
        for e in &equations {
            let miss = (e.a.dot(solution) - e.b) / FLOW_SCALE_PX;
            let robust = if turn == 0 { 1.0 } else { (1.0 + miss * miss).powi(2).recip() };
            sum.weight += Tensor::of_line(e.a) * (robust * e.weight);
            sum.pull += e.a * (robust * e.weight * e.b);
        }
        // A millimetre is about a pixel; the small diagonal holds what no view measures with the head.
        let Some(inverse) = (sum.weight + Tensor([0.02, 0.02, 0.02, 0.0, 0.0, 0.0])).inverse() else {
            return Constraint::default();
        };
        solution = inverse.apply(sum.pull);
    }
    // Against the pull of one neighbour, an equation of one pixel to a millimetre counts as much as the line is trusted.
    sum.pull *= LINE_WEIGHT * line.confidence;
    sum.weight = sum.weight * (LINE_WEIGHT * line.confidence);
    sum
}

/// The equation of one view across the strands it shows there; `None` where it does not see the voxel.
fn across(view: &View, point: DVec3, moved: DVec3, line: &Line) -> Option<Equation> {
    let pixel = project(view.camera, point)?;
    let behind = view.depth.behind_at(pixel, depth(view.camera, point))?;
    (behind <= SEEN_MM).then_some(())?;
    let confidence = *view.map.confidence.at_point(pixel.x, pixel.y)?;
    (confidence > 0.0).then_some(())?;
    let flow = view.flow_at(pixel)?;
    let expected = project(view.camera, moved)?;
    let column = |axis: DVec3| -> Option<Vec2> { Some((project(view.camera, moved + axis)? - expected).as_vec2()) };
    let n = Vec2::from_angle(*view.map.angle.at_point(pixel.x, pixel.y)?).perp();
    let a = Vec3::new(n.dot(column(DVec3::X)?), n.dot(column(DVec3::Y)?), n.dot(column(DVec3::Z)?));
    // The image's strand and the voxel's line differ a little; that must not pass for motion along the line.
    let a = a.reject_from_normalized(line.direction);
    let weight = confidence * (4.0 / (4.0 + behind.max(0.0))).powi(2);
    Some(Equation { a, b: n.dot(flow - (expected - pixel).as_vec2()), weight })
}
