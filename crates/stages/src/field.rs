//! Stage 7: the dense line field of the hair volume, diffused from the sparse lines as tensors.
//!
//! The hair volume lies between the scalp and the hull, where hair can be: a ray that shows skin meets no hair before the
//! skin, and one that shows hair meets the body some way behind it. Reference: Paris et al. 2008, section 5; Zhang et al. 2012,
//! section 4.

use std::collections::VecDeque;

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use strandflow_core::{
    Camera, Grid, Mask, Occupancy, Place, Plane, Report, Rig, RigidTransform, SparseVoxels, TriMesh,
};
use strandflow_geometry::{
    project::{depth, project_with_depth},
    signed_distance::SignedDistance,
};
use strandflow_volume::{
    diffuse::{Constraint, Solver, diffuse},
    tensor::Tensor,
    visibility::{DepthMap, surface_voxels, without_layers},
};

use crate::{Mode, SettingViolation, StageError, hull::bodies, lift::Line};

pub mod motion;

/// The line at a voxel of the hair volume.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FieldVoxel {
    /// Unit direction; sign without meaning.
    pub direction: Vec3,
    /// 1 − λ₂/λ₁ of the tensor, times what reached the voxel from observed lines, 0 to 1.
    pub trust: f32,
    /// Whether the voxel itself was observed.
    pub observed: bool,
}

/// What one frame needs.
pub struct FieldInput<'a> {
    /// The cameras.
    pub rig: &'a Rig,
    /// The frame, for messages.
    pub frame: usize,
    /// The hull.
    pub hull: &'a Occupancy,
    /// Observed lines.
    pub lines: &'a SparseVoxels<Line>,
    /// Hair masks, one a view.
    pub hairs: &'a [&'a Mask],
    /// Distance to the scalp in head space, as [`head_distance`] samples it.
    pub head: &'a SignedDistance,
    /// The head's motion.
    pub world_from_head: RigidTransform,
}

/// Settings of stage `field`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FieldSettings {
    /// Jacobi sweeps at full resolution, paper mode.
    pub paper_sweeps: usize,
    /// Resolutions of the solver.
    pub levels: usize,
    /// Sweeps at each resolution.
    pub sweeps: usize,
    /// Weight of a fully trusted line against one neighbouring voxel.
    pub line_weight: f32,
    /// Length over which evidence fades \[mm\].
    pub fade_mm: f64,
    /// Length over which motion seen in the images fades into that of the head \[mm\].
    pub motion_fade_mm: f64,
    /// Patches without hair smaller than this do not open the hair volume: markers and holes in masks \[mm²\].
    pub bare_patch_mm2: f64,
    /// Layers of voxels taken off the hull, robust mode. The hull holds all hair by construction and is larger than it
    /// everywhere: hulls of seven views lay 6 mm outside the hair in the median. Measured on two rendered captures, F1 of
    /// the strands at 3 mm/30° with 1 and 2 layers: 0.74 and 0.78 (short straight), 0.74 and 0.76 (long wavy).
    pub shell_voxels: usize,
    /// How deep behind the hull a bare pixel opens the hair volume where no scalp is known \[mm\].
    pub bare_depth_mm: f64,
    /// How deep behind the hull hair can be where a view shows hair \[mm\], robust mode; before the head, at any depth. Where six
    /// views or more show hair, two must show it there. What lies deeper is the body (measured: `docs/steps.md`, "Shoulders").
    pub hair_depth_mm: f64,
}

impl Default for FieldSettings {
    fn default() -> Self {
        Self {
            paper_sweeps: 300,
            levels: 5,
            sweeps: 8,
            line_weight: 2.0,
            fade_mm: 30.0,
            motion_fade_mm: 400.0,
            bare_patch_mm2: 300.0,
            shell_voxels: 2,
            bare_depth_mm: 10.0,
            hair_depth_mm: 60.0,
        }
    }
}

impl FieldSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        let mut found = Vec::new();
        let mut unless = |ok, field: &str, value: f64, range: &str, reason: &str| {
            SettingViolation::unless(ok, &mut found, (field, value), (range, reason));
        };
        let (paper, levels, sweeps) = (self.paper_sweeps as f64, self.levels as f64, self.sweeps as f64);
        let weight = f64::from(self.line_weight);
        let (patch, deep) = (self.bare_patch_mm2, self.bare_depth_mm);
        unless((1.0..=1e5).contains(&paper), "field.paper_sweeps", paper, "1..=100000", "none leaves the field blank");
        unless((1.0..=12.0).contains(&levels), "field.levels", levels, "1..=12", "each halves the resolution");
        unless((1.0..=1e4).contains(&sweeps), "field.sweeps", sweeps, "1..=10000", "none leaves the field coarse");
        unless(weight > 0.0 && weight <= 1e6, "field.line_weight", weight, "above 0, to 1e6", "lines must count");
        unless(
            (2.0..=1e4).contains(&self.fade_mm),
            "field.fade_mm",
            self.fade_mm,
            "2..=10000",
            "of the order of a head",
        );
        let fade = self.motion_fade_mm;
        unless((2.0..=1e4).contains(&fade), "field.motion_fade_mm", fade, "2..=10000", "of the order of a head");
        unless((0.0..=1e5).contains(&patch), "field.bare_patch_mm2", patch, "0..=100000", "an area on the head");
        let shell = self.shell_voxels as f64;
        unless(shell <= 20.0, "field.shell_voxels", shell, "0..=20", "more leaves nothing of thin hair");
        unless((0.0..=500.0).contains(&deep), "field.bare_depth_mm", deep, "0..=500", "a depth inside the head");
        let deep = self.hair_depth_mm;
        unless((10.0..=1000.0).contains(&deep), "field.hair_depth_mm", deep, "10..=1000", "the thickness of hair");
        found
    }
}

/// The line field of one frame over its hair volume (between scalp and hull, where hair can be).
pub fn field(
    input: &FieldInput,
    mode: Mode,
    settings: &FieldSettings,
    report: &mut Report,
) -> Result<SparseVoxels<FieldVoxel>, StageError> {
    let grid = input.hull.grid;
    let head = Head::new(input);
    let indices = hair_volume(input, &head, mode, settings);
    say_blind_views(input, report);
    if indices.is_empty() {
        return Err(StageError::Input {
            place: Place::frame(input.frame),
            fact: "no hair volume between scalp and hull".into(),
            hint: "check the hair masks, the scalp and the head pose of this frame".into(),
        });
    }
    if input.lines.is_empty() {
        let fact = "no observed line";
        report.warn(Place::frame(input.frame), fact, "the field has no direction; no strand will grow");
    }

    let weight = |line: &Line| match mode {
        Mode::Paper => 1e6,
        Mode::Robust => settings.line_weight * line.confidence,
    };
    let observed: Vec<Option<&Line>> = indices.par_iter().map(|&index| input.lines.get(index as usize)).collect();
    let constraint = |line: &Option<&Line>| {
        line.map_or(Constraint::default(), |line| Constraint::on(Tensor::of_line(line.direction), weight(line)))
    };
    let constraints: Vec<Constraint<Tensor>> = observed.iter().map(constraint).collect();
    let even = vec![(); indices.len()];
    let tensors = diffuse(&grid, &indices, &constraints, &even, &solver(mode, settings, grid.voxel_mm));
    let values = tensors.par_iter().zip(&observed).map(|(tensor, line)| voxel(tensor, line.is_some())).collect();
    Ok(SparseVoxels { grid, indices, values })
}

fn solver(mode: Mode, settings: &FieldSettings, voxel_mm: f64) -> Solver {
    match mode {
        Mode::Paper => Solver { levels: 1, sweeps: settings.paper_sweeps, relaxation: 1.0, leak: 0.0 },
        Mode::Robust => Solver {
            levels: settings.levels,
            sweeps: settings.sweeps,
            relaxation: 1.5,
            leak: (voxel_mm / settings.fade_mm).powi(2) as f32,
        },
    }
}

/// Direction and trust of a diffused tensor; a voxel that nothing reached has no direction.
fn voxel(tensor: &Tensor, observed: bool) -> FieldVoxel {
    let reach = tensor.trace().clamp(0.0, 1.0);
    if reach < 1e-9 {
        return FieldVoxel::default();
    }
    let normalised = *tensor * (1.0 / tensor.trace());
    let (direction, purity) = normalised.principal(normalised.rough_direction());
    FieldVoxel { direction, trust: purity * reach, observed }
}

/// The scalp as a distance field, and the way from the world into head space.
struct Head<'a> {
    distance: &'a SignedDistance,
    head_from_world: RigidTransform,
}

/// The distance to a scalp, sampled as finely as a field of voxels of this edge needs it. The same for all frames of a take.
pub fn head_distance(scalp: &TriMesh, voxel_mm: f64) -> SignedDistance {
    // A head's radius is 80 mm: trilinear samples 4 mm apart are right to 0.03 mm, and eight times faster than 2 mm.
    let sample_mm = (2.0 * voxel_mm).clamp(1.0, 4.0);
    SignedDistance::from_mesh(scalp, sample_mm, 3.0 * sample_mm)
}

impl<'a> Head<'a> {
    fn new(input: &FieldInput<'a>) -> Self {
        Self { distance: input.head, head_from_world: input.world_from_head.inverse() }
    }

    fn signed_distance(&self, point_in_world: DVec3) -> f64 {
        self.distance.distance(self.head_from_world.point(point_in_world))
    }
}

/// The voxels of the hull outside the scalp in which hair can be, rising. The layer of one voxel below the scalp stays:
/// roots lie on the surface and need a field on both sides.
fn hair_volume(input: &FieldInput, head: &Head, mode: Mode, settings: &FieldSettings) -> Vec<u32> {
    let grid = input.hull.grid;
    let layers = if mode == Mode::Robust { settings.shell_voxels } else { 0 };
    let mut rest = without_layers(input.hull, layers);
    others(input.hull, head).into_iter().for_each(|voxel| rest.set(voxel, false));
    let hull: Vec<u32> = rest.indices().map(|index| index as u32).collect();
    let distances: Vec<f32> =
        hull.par_iter().map(|&voxel| head.signed_distance(grid.centre_of_index(voxel as usize)) as f32).collect();
    let inside_head: Vec<u32> = hull.iter().zip(&distances).filter(|&(_, &d)| d < 0.0).map(|(&v, _)| v).collect();
    let skin = surface_of(&grid, &inside_head);
    let outside = surface_voxels(input.hull);
    let windows: Vec<BareView> = (0..input.rig.view_count())
        .into_par_iter()
        .filter(|&view| sees_hair(input.hairs[view]))
        .map(|view| BareView::new(&input.rig.cameras[view], input.hairs[view], &grid, [&outside, &skin], settings))
        .collect();
    // Where no view shows hair at all, none can tell.
    let witnesses = match windows.len() {
        0 => 0,
        _ if mode == Mode::Paper => 0,
        views => 1 + usize::from(views >= MANY_VIEWS),
    };
    let holds_hair = |point: DVec3, distance: f32| {
        let mut shown = 0;
        for window in &windows {
            match window.says(point, settings) {
                Says::NoHair if distance > 0.0 => return false,
                Says::Hair => shown += 1,
                _ => {}
            }
        }
        shown >= witnesses
    };
    let below = -grid.voxel_mm as f32;
    hull.par_iter()
        .zip(&distances)
        .filter(|&(&voxel, &distance)| {
            let point = grid.centre_of_index(voxel as usize);
            distance > below && holds_hair(point, distance)
        })
        .map(|(&voxel, _)| voxel)
        .collect()
}

/// Views from which on single ones are not believed alone: the hairs that lie over a shoulder would open it.
const MANY_VIEWS: usize = 6;

/// Whether a view shows hair anywhere. One that shows none says nothing of where hair is: its mask may be lost, and a
/// view that is blind to all hair would empty the whole volume before it.
fn sees_hair(hair: &Mask) -> bool {
    hair.data.iter().any(|&coverage| coverage >= 128)
}

fn say_blind_views(input: &FieldInput, report: &mut Report) {
    for (camera, _) in input.rig.cameras.iter().zip(input.hairs).filter(|(_, hair)| !sees_hair(hair)) {
        let place = Place::view_frame(&camera.name, input.frame);
        report.warn(place, "the hair mask is empty", "the view does not bound the hair volume");
    }
}

/// The voxels of the hull's other bodies where one of them holds the head: other people have no place in the volume.
fn others(hull: &Occupancy, head: &Head) -> Vec<usize> {
    let bodies = bodies(hull);
    if bodies.len() < 2 {
        return Vec::new();
    }
    let of_head = |body: &Vec<usize>| {
        let inside = |&&voxel: &&usize| head.signed_distance(hull.grid.centre_of_index(voxel)) < 0.0;
        body.iter().filter(inside).count()
    };
    let inside: Vec<usize> = bodies.iter().map(of_head).collect();
    let holder = (0..bodies.len()).max_by_key(|&body| inside[body]).filter(|&body| inside[body] > 0);
    let Some(holder) = holder else { return Vec::new() };
    bodies.into_iter().enumerate().filter(|(body, _)| *body != holder).flat_map(|(_, voxels)| voxels).collect()
}

fn surface_of(grid: &Grid, voxels: &[u32]) -> Vec<u32> {
    let mut occupancy = Occupancy::empty(*grid);
    voxels.iter().for_each(|&voxel| occupancy.set(voxel as usize, true));
    surface_voxels(&occupancy)
}

/// What a view says of a point.
enum Says {
    /// It sees through it.
    NoHair,
    /// Hair that it shows can reach so deep.
    Hair,
    Nothing,
}

/// A view in which some pixels of the subject show no hair: skin, mostly.
struct BareView<'a> {
    camera: &'a Camera,
    pixels: Plane<Pixel>,
}

/// What a view knows at a pixel, side by side: voxels ask all over the image, and each place that they ask for comes from memory.
#[derive(Clone, Copy)]
struct Pixel {
    /// Distances along the optical axis to the hull and to the skin \[mm\]; infinite where there is none.
    hull: f32,
    skin: f32,
    shows: Shows,
}

#[derive(Clone, Copy)]
enum Shows {
    /// Bare, as its four neighbours are.
    Bare,
    /// Bare, beside one that is not.
    Border,
    Rest,
}

impl<'a> BareView<'a> {
    fn new(
        camera: &'a Camera,
        hair: &Mask,
        grid: &Grid,
        [outside, skin]: [&[u32]; 2],
        settings: &FieldSettings,
    ) -> Self {
        let [hull, skin] = [outside, skin].map(|voxels| DepthMap::of_voxels(camera, grid, voxels).depth);
        let bare = Plane::from_fn(camera.width, camera.height, |x, y| hair[(x, y)] < 128 && hull[(x, y)].is_finite());
        let distance = depth(camera, grid.centre(grid.dims.map(|n| n / 2))).max(1.0);
        let least_pixels = settings.bare_patch_mm2 * (camera.focal[0] / distance).powi(2);
        let bare = without_small_patches(bare, least_pixels as usize);
        let shows = |x: usize, y: usize| {
            let within = x > 0 && y > 0 && x + 1 < bare.width && y + 1 < bare.height;
            let near = || [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)];
            match bare[(x, y)] {
                true if within && near().iter().all(|&at| bare[at]) => Shows::Bare,
                true => Shows::Border,
                false => Shows::Rest,
            }
        };
        let pixel = |x, y| Pixel { hull: hull[(x, y)], skin: skin[(x, y)], shows: shows(x, y) };
        Self { camera, pixels: Plane::from_fn(camera.width, camera.height, pixel) }
    }

    /// What the view says of a point. A bare pixel sees through it where skin lies behind, and close behind the hull where no skin
    /// is known; the pixel's neighbours must be bare too, for masks are right to a pixel. Hair that is shown can reach all the way
    /// to the head, or some way behind the hull.
    fn says(&self, point: DVec3, settings: &FieldSettings) -> Says {
        let Some((pixel, depth)) = project_with_depth(self.camera, point) else { return Says::Nothing };
        let Some(&Pixel { hull, skin, shows }) = self.pixels.at_point(pixel.x, pixel.y) else { return Says::Nothing };
        let behind = |first: f32| first.is_finite().then_some(depth as f32 - first);
        let skin = behind(skin);
        let is_within = |mm: f64| behind(hull).is_some_and(|behind| f64::from(behind) < mm);
        let sees_through = || skin.map_or_else(|| is_within(settings.bare_depth_mm), |behind| behind < 0.0);
        match shows {
            Shows::Bare if sees_through() => Says::NoHair,
            Shows::Rest if skin.is_some_and(|behind| behind < 0.0) || is_within(settings.hair_depth_mm) => Says::Hair,
            _ => Says::Nothing,
        }
    }
}

/// Clears 4-connected patches of fewer than `least_pixels` pixels.
fn without_small_patches(mut map: Plane<bool>, least_pixels: usize) -> Plane<bool> {
    let (width, height) = (map.width, map.height);
    let mut seen = vec![false; map.data.len()];
    for start in 0..map.data.len() {
        if seen[start] || !map.data[start] {
            continue;
        }
        let (mut patch, mut queue) = (Vec::new(), VecDeque::from([start]));
        seen[start] = true;
        while let Some(at) = queue.pop_front() {
            patch.push(at);
            let (x, y) = (at % width, at / width);
            let near = [(x > 0, -1), (x + 1 < width, 1), (y > 0, -(width as isize)), (y + 1 < height, width as isize)];
            for next in near.iter().filter(|(inside, _)| *inside).map(|&(_, step)| at.wrapping_add_signed(step)) {
                if map.data[next] && !seen[next] {
                    seen[next] = true;
                    queue.push_back(next);
                }
            }
        }
        if patch.len() < least_pixels {
            patch.iter().for_each(|&at| map.data[at] = false);
        }
    }
    map
}
