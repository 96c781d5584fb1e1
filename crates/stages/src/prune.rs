//! Stage 9: outliers by reprojection against the orientation maps, and by iterative weighting in the voxel field.
//!
//! A strand that lies on the surface must run along the orientations of the images that see it; and within a voxel strands
//! run in one direction: each strand weighs as much as it agrees with the direction most common in its voxels, the
//! direction of a voxel is the weighted mean of its strands, in turns. Reference: Zhang et al. 2012, section 4; Wang et
//! al. 2009 (the weighting).

use glam::{Vec2, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use strandflow_core::{Camera, Grid, Occupancy, Place, Plane, Report, Rig, Strands};
use strandflow_geometry::{
    order::map_places,
    project::{project_direction, project_with_depth},
};
use strandflow_volume::{
    tensor::Tensor,
    visibility::{DepthMap, surface_voxels},
};

use crate::{Mode, SettingViolation, StageError, orient::OrientationMap};

/// What one frame needs.
pub struct PruneInput<'a> {
    /// The cameras.
    pub rig: &'a Rig,
    /// The frame, for messages.
    pub frame: usize,
    /// The hull (visibility, and the grid of the voxel field).
    pub hull: &'a Occupancy,
    /// Strands as grown.
    pub strands: &'a Strands,
    /// Orientation maps, one a view.
    pub maps: &'a [&'a OrientationMap],
}

/// Strands after the outlier tests: same numbering, field-consistent, outliers emptied or cut short, and flagged.
#[derive(Clone, Debug, PartialEq)]
pub struct Pruned {
    /// The strands; a rejected strand is empty.
    pub strands: Strands,
    /// Why a strand was rejected: 0 kept, 1 reprojection, 2 voxel field, 3 too short or absent. Length N.
    pub flags: Vec<u8>,
}

/// Settings of stage `prune`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PruneSettings {
    /// How far behind the first surface a point counts as seen \[mm\].
    pub visible_mm: f32,
    /// Largest mean angle between a seen piece of a strand and the orientations under it \[degrees\].
    pub max_error_deg: f32,
    /// Length over which that mean is taken \[mm\]; a strand is cut where it begins to be too large.
    pub window_mm: f32,
    /// Turns of the weighting in the voxel field.
    pub turns: usize,
    /// Angle to the common direction at which a strand weighs half \[degrees\].
    pub half_weight_deg: f32,
    /// A strand below this mean weight is rejected, 0 to 1.
    pub min_weight: f32,
    /// Shortest strand that is kept \[mm\].
    pub min_length_mm: f32,
}

impl Default for PruneSettings {
    fn default() -> Self {
        Self {
            visible_mm: 6.0,
            max_error_deg: 25.0,
            window_mm: 30.0,
            turns: 4,
            half_weight_deg: 25.0,
            min_weight: 0.35,
            min_length_mm: 20.0,
        }
    }
}

impl PruneSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        let mut found = Vec::new();
        let mut unless = |ok, field: &str, value: f32, range: &str, reason: &str| {
            SettingViolation::unless(ok, &mut found, (field, value), (range, reason));
        };
        let (seen, error, window) = (self.visible_mm, self.max_error_deg, self.window_mm);
        let (half, weight, shortest) = (self.half_weight_deg, self.min_weight, self.min_length_mm);
        unless((0.0..=100.0).contains(&seen), "prune.visible_mm", seen, "0..=100", "a depth in the hair");
        unless((1.0..=90.0).contains(&error), "prune.max_error_deg", error, "1..=90", "random lines differ by 45°");
        unless((1.0..=1000.0).contains(&window), "prune.window_mm", window, "1..=1000", "a piece of a strand");
        unless(self.turns <= 100, "prune.turns", self.turns as f32, "0..=100", "it settles within ten");
        unless((1.0..=90.0).contains(&half), "prune.half_weight_deg", half, "1..=90", "lines differ by 90° at most");
        unless((0.0..1.0).contains(&weight), "prune.min_weight", weight, "0..1", "weights lie between 0 and 1");
        unless((0.0..=1000.0).contains(&shortest), "prune.min_length_mm", shortest, "0..=1000", "a length of hair");
        found
    }
}

const KEPT: u8 = 0;
const REPROJECTION: u8 = 1;
const VOXEL_FIELD: u8 = 2;
const SHORT: u8 = 3;

/// The strands of one frame that survive both tests.
pub fn prune(
    input: &PruneInput,
    mode: Mode,
    settings: &PruneSettings,
    report: &mut Report,
) -> Result<Pruned, StageError> {
    let count = input.strands.strand_count();
    let mut flags = vec![KEPT; count];
    let mut lengths: Vec<usize> = (0..count).map(|n| input.strands.range(n).len()).collect();

    let kept_by_images = against_images(input, mode, settings);
    for (n, kept) in kept_by_images.into_iter().enumerate() {
        if kept < lengths[n] {
            (lengths[n], flags[n]) =
                (kept, if too_short(input.strands, n, kept, settings) { REPROJECTION } else { KEPT });
        }
    }
    for (n, flag) in flags.iter_mut().enumerate() {
        if *flag == KEPT && too_short(input.strands, n, lengths[n], settings) {
            *flag = SHORT;
        }
    }
    against_voxel_field(input, settings, &lengths, &mut flags);

    let strands = cut(input.strands, &lengths, &flags);
    let kept = flags.iter().filter(|&&flag| flag == KEPT).count();
    if 2 * kept < count {
        let fact = format!("{kept} of {count} strands passed the outlier tests");
        report.warn(Place::frame(input.frame), fact, "the others are completed from their neighbours in later stages");
    }
    Ok(Pruned { strands, flags })
}

fn too_short(strands: &Strands, n: usize, points: usize, settings: &PruneSettings) -> bool {
    let start = strands.range(n).start;
    strandflow_geometry::polyline::length(&strands.points[start..start + points]) < settings.min_length_mm || points < 2
}

/// How many points of each strand stand the comparison with the images, from the root on.
fn against_images(input: &PruneInput, mode: Mode, settings: &PruneSettings) -> Vec<usize> {
    let grid = &input.hull.grid;
    let (surface, dense) = (surface_voxels(input.hull), dense_voxels(grid, input.strands));
    let views: Vec<View> = (0..input.rig.view_count())
        .into_par_iter()
        .map(|view| View::new(&input.rig.cameras[view], input.maps[view], grid, [&surface, &dense]))
        .collect();
    let count_kept = |n: usize| {
        let points = input.strands.strand(n);
        let stride = if mode == Mode::Paper { 1 } else { per_way(points, VOTE_MM) };
        let asked = (0..points.len()).step_by(stride);
        let votes: Vec<(f32, f32)> = asked.map(|i| error_at(&views, points, i, settings)).collect();
        match mode {
            Mode::Paper if mean(&votes) > settings.max_error_deg.to_radians() => 0,
            Mode::Paper => points.len(),
            Mode::Robust => good_until(points, (&votes, stride), settings),
        }
    };
    let start = |n: usize| input.strands.strand(n).first().copied().unwrap_or(Vec3::NAN);
    let starts: Vec<Vec3> = (0..input.strands.strand_count()).map(start).collect();
    map_places(&starts, count_kept)
}

/// The voxels that hold two points or more, rising: a single strand does not hide what lies behind it.
fn dense_voxels(grid: &Grid, strands: &Strands) -> Vec<u32> {
    let mut counts = vec![0u8; grid.len()];
    for voxel in strands.points.iter().filter_map(|point| grid.voxel_at(point.as_dvec3())) {
        let count = &mut counts[grid.index(voxel)];
        *count = count.saturating_add(1);
    }
    (0..grid.len() as u32).filter(|&voxel| counts[voxel as usize] >= 2).collect()
}

/// One view: its orientations, and what it sees first.
struct View<'a> {
    camera: &'a Camera,
    centre: Vec3,
    pixels: Plane<Pixel>,
}

/// What a view knows at a pixel, side by side: strands ask all over the image, and each place that they ask for comes from
/// memory.
#[derive(Clone, Copy)]
struct Pixel {
    /// Distance along the optical axis to what is seen first \[mm\]; infinite where that is nothing.
    first: f32,
    angle: f32,
    confidence: f32,
}

impl<'a> View<'a> {
    /// What is seen first is the surface of the strands themselves (`dense`) where there are any, since the hull is larger
    /// than the hair, and else that of the hull.
    fn new(camera: &'a Camera, map: &OrientationMap, grid: &Grid, [surface, dense]: [&[u32]; 2]) -> Self {
        let [dense, hull] = [dense, surface].map(|voxels| DepthMap::of_voxels(camera, grid, voxels).depth);
        let pixel = |i: usize| {
            let first = if dense.data[i].is_finite() { dense.data[i] } else { hull.data[i] };
            Pixel { first, angle: map.angle.data[i], confidence: map.confidence.data[i] }
        };
        let (width, height) = (camera.width, camera.height);
        let pixels = Plane { width, height, data: (0..width * height).map(pixel).collect() };
        Self { camera, centre: camera.centre_in_world().as_vec3(), pixels }
    }

    /// Angle between a tangent at a point and the orientation there, and its weight; `None` where the view says nothing.
    fn error(&self, point: Vec3, tangent: Vec3, visible_mm: f32) -> Option<(f32, f32)> {
        let at = point.as_dvec3();
        let (pixel, depth) = project_with_depth(self.camera, at)?;
        let &Pixel { first, angle, confidence } = self.pixels.at_point(pixel.x, pixel.y)?;
        let seen = first.is_finite() && depth as f32 - first <= visible_mm;
        (confidence > 0.0 && seen).then_some(())?;
        let direction = project_direction(self.camera, at, tangent.as_dvec3())?.as_vec2();
        // A strand that points at the camera has no sure direction in the image.
        let towards = (self.centre - point).normalize();
        let cosine = direction.dot(Vec2::from_angle(angle)).abs().min(1.0);
        Some((cosine.acos(), confidence * (1.0 - towards.dot(tangent).powi(2))))
    }
}

/// Weighted sum of the angles between a strand at one of its points and the orientations in the views that see it, and
/// the sum of the weights.
fn error_at(views: &[View], points: &[Vec3], i: usize, settings: &PruneSettings) -> (f32, f32) {
    let tangent = tangent(points, i);
    let errors = views.iter().filter_map(|view| view.error(points[i], tangent, settings.visible_mm));
    errors.fold((0.0, 0.0), |(sum, weight), (angle, share)| (sum + share * angle, weight + share))
}

fn tangent(points: &[Vec3], i: usize) -> Vec3 {
    let (a, b) = (points[i.saturating_sub(1)], points[(i + 1).min(points.len() - 1)]);
    (b - a).normalize_or(Vec3::Z)
}

fn mean(votes: &[(f32, f32)]) -> f32 {
    let (sum, weight) = votes.iter().fold((0.0, 0.0), |(s, w), vote| (s + vote.0, w + vote.1));
    if weight > 0.0 { sum / weight } else { 0.0 }
}

/// Way along a strand between two points that are compared with the images \[mm\]; the window of a decision holds several.
const VOTE_MM: f32 = 4.0;

/// How many points of a strand, evenly spaced, make up a way \[mm\]; at least one.
fn per_way(points: &[Vec3], way_mm: f32) -> usize {
    let step = if points.len() > 1 { points[0].distance(points[1]).max(0.1) } else { 1.0 };
    ((way_mm / step).round() as usize).max(1)
}

/// The number of points before the first window whose mean error is too large; one in `stride` points has a vote. Windows
/// that are hardly seen pass.
fn good_until(points: &[Vec3], (votes, stride): (&[(f32, f32)], usize), settings: &PruneSettings) -> usize {
    let limit = settings.max_error_deg.to_radians();
    let window = per_way(points, settings.window_mm);
    let bad = |i: &usize| {
        let part = &votes[*i..(i + (window / stride).max(1)).min(votes.len())];
        let seen: f32 = part.iter().map(|vote| vote.1).sum();
        seen > 0.25 * part.len() as f32 && mean(part) > limit
    };
    // The window's first points are those that entered it last.
    (0..votes.len()).find(bad).map_or(points.len(), |i| (i * stride + window / 4).min(points.len()))
}

/// Rejects the strands that keep disagreeing with the direction most common in their voxels.
fn against_voxel_field(input: &PruneInput, settings: &PruneSettings, lengths: &[usize], flags: &mut [u8]) {
    let grid = &input.hull.grid;
    let strands = input.strands;
    let mut entries: Vec<(u32, Vec3)> = Vec::new();
    // The voxel in the upper half, the entry in the lower.
    let mut places: Vec<u64> = Vec::new();
    for n in (0..strands.strand_count()).filter(|&n| flags[n] == KEPT) {
        let points = &strands.strand(n)[..lengths[n]];
        for (i, point) in points.iter().enumerate() {
            if let Some(voxel) = grid.voxel_at(point.as_dvec3()) {
                places.push((grid.index(voxel) as u64) << 32 | entries.len() as u64);
                entries.push((n as u32, tangent(points, i)));
            }
        }
    }
    places.sort_unstable();
    let entries: Vec<(u32, Vec3)> = places.iter().map(|&place| entries[place as u32 as usize]).collect();
    let same_voxel = |a: &u64, b: &u64| a >> 32 == b >> 32;
    let in_voxels: Vec<usize> = places.chunk_by(same_voxel).map(<[u64]>::len).collect();
    let half = settings.half_weight_deg.to_radians().sin().powi(2);
    let mut weights = vec![1.0f32; strands.strand_count()];
    for _ in 0..settings.turns {
        let (mut sums, mut counts) = (vec![0.0f32; weights.len()], vec![0u32; weights.len()]);
        let mut rest = &entries[..];
        for &count in &in_voxels {
            let voxel;
            (voxel, rest) = rest.split_at(count);
            let mut field = Tensor::default();
            voxel.iter().for_each(|&(n, d)| field += Tensor::of_line(d) * weights[n as usize]);
            let (common, _) = field.principal(field.rough_direction());
            for &(n, d) in voxel {
                let sine_squared = 1.0 - common.dot(d).powi(2);
                sums[n as usize] += 1.0 / (1.0 + sine_squared / half);
                counts[n as usize] += 1;
            }
        }
        for (weight, (sum, count)) in weights.iter_mut().zip(sums.iter().zip(&counts)) {
            *weight = if *count > 0 { sum / *count as f32 } else { 0.0 };
        }
    }
    for (flag, weight) in flags.iter_mut().zip(&weights) {
        if *flag == KEPT && *weight < settings.min_weight {
            *flag = VOXEL_FIELD;
        }
    }
}

/// The strands cut to their lengths; those with a flag are emptied.
fn cut(strands: &Strands, lengths: &[usize], flags: &[u8]) -> Strands {
    let mut out = Strands::new();
    for n in 0..strands.strand_count() {
        let start = strands.range(n).start;
        let range = start..start + if flags[n] == KEPT { lengths[n] } else { 0 };
        out.push(&strands.points[range.clone()], &strands.provenance[range.clone()], &strands.confidence[range]);
    }
    out
}
