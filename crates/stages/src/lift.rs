//! Stage 6: sparse undirected 3D lines from orientation maps of several views.
//!
//! An orientation at a pixel spans a plane with the camera's centre; the line d that lies in all planes of a voxel
//! minimises Σ w (n·d)². Reference: Wei et al. 2005; Zhang et al. 2012, section 4.
//!
//! Deviation (robust mode): the paper takes voxels on the hull's surface. The hull is larger than the hair wherever the
//! hair is concave (on rendered captures the hair lies 6 mm behind it in the median), so a band behind the surface is
//! examined and a voxel takes part wherever three views agree on a line; and one wrong view does not spoil a line,
//! because the line is chosen among the intersections of all pairs of planes before it is refined.

use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use strandflow_core::{Camera, Grid, Mask, Occupancy, Place, Plane, Report, Rig, SparseVoxels};
use strandflow_geometry::project::{plane_normal, project_with_depth};
use strandflow_volume::{
    tensor::Tensor,
    visibility::{DepthMap, surface_voxels},
};

use crate::{Mode, SettingViolation, StageError, orient::OrientationMap};

/// An undirected 3D line at a voxel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Line {
    /// Unit direction; sign without meaning.
    pub direction: Vec3,
    /// Trust 0 to 1.
    pub confidence: f32,
    /// Root mean square angle between the line and its planes \[rad\].
    pub residual: f32,
    /// Views that took part.
    pub views: u8,
}

/// What one frame needs.
pub struct LiftInput<'a> {
    /// The cameras.
    pub rig: &'a Rig,
    /// The frame, for messages.
    pub frame: usize,
    /// The hull.
    pub hull: &'a Occupancy,
    /// Orientation maps, one a view.
    pub maps: &'a [&'a OrientationMap],
    /// Hair masks, one a view.
    pub hairs: &'a [&'a Mask],
}

/// Settings of stage `lift`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LiftSettings {
    /// How far behind the hull's first surface a voxel may lie and still count as seen by a view \[voxels\], paper mode.
    pub surface_voxels: f64,
    /// The same in robust mode \[mm\]: how deep the hair may lie behind the hull.
    pub band_mm: f64,
    /// Orientations below this confidence are ignored.
    pub min_confidence: f32,
    /// Largest root mean square angle between a line and its planes \[degrees\].
    pub max_residual_deg: f32,
    /// Smallest middle eigenvalue of the mean of n nᵀ: how much the planes must differ.
    pub min_gap: f32,
    /// Trust in a line that only two views see, robust mode: nothing but the images' own confidence speaks for it. 0: none.
    pub pair_trust: f32,
    /// Confidence that the orientations of both views must have then.
    pub pair_confidence: f32,
}

impl Default for LiftSettings {
    fn default() -> Self {
        Self {
            surface_voxels: 1.5,
            band_mm: 16.0,
            min_confidence: 0.1,
            max_residual_deg: 10.0,
            min_gap: 0.06,
            pair_trust: 0.25,
            pair_confidence: 0.5,
        }
    }
}

impl LiftSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        let mut found = Vec::new();
        let mut unless = |ok, field: &str, value: f64, range: &str, reason: &str| {
            SettingViolation::unless(ok, &mut found, (field, value), (range, reason));
        };
        let (c, r, g) = (f64::from(self.min_confidence), f64::from(self.max_residual_deg), f64::from(self.min_gap));
        let s = self.surface_voxels;
        unless((0.5..=20.0).contains(&s), "lift.surface_voxels", s, "0.5..=20", "depth maps are right to half a voxel");
        unless((0.0..=100.0).contains(&self.band_mm), "lift.band_mm", self.band_mm, "0..=100", "a head is 200 mm wide");
        unless((0.0..1.0).contains(&c), "lift.min_confidence", c, "0..1", "confidences lie between 0 and 1");
        unless((0.1..=45.0).contains(&r), "lift.max_residual_deg", r, "0.1..=45", "random planes meet at 33°");
        unless((0.0..=0.5).contains(&g), "lift.min_gap", g, "0..=0.5", "the middle of three that sum to 1");
        let (t, c) = (f64::from(self.pair_trust), f64::from(self.pair_confidence));
        unless((0.0..=1.0).contains(&t), "lift.pair_trust", t, "0..=1", "two views say no more than three");
        unless((0.0..=1.0).contains(&c), "lift.pair_confidence", c, "0..=1", "confidences lie between 0 and 1");
        found
    }
}

/// Planes that miss a line by more than this do not speak for it (sine of 15°: twice a good orientation error of 7°).
const INLIER_SINE: f32 = 0.26;
/// Two planes closer than this have no usable intersection (sine of 12°).
const PAIR_SINE: f32 = 0.2;
/// Most views that are weighed for one voxel; a multiple of [`LANES`].
const MAX_VIEWS: usize = 32;

/// Share of the lines of several views that a view must agree with, to be believed where only one other sees the place.
const RELIABLE: f32 = 0.5;

/// The lines that three or more views agree on; in robust mode also those that two sure views see where no third does, unless
/// one of the two mostly disagrees where there are more.
///
/// *Deviation*: the paper asks for three views. Beside the face, and with few cameras everywhere, only two see the hair; what the
/// field makes of places without a line is worse (F1 of seen strands from 0.57 to 0.66 with four views; `docs/steps.md`, "Lines
/// of two views").
pub fn lift(
    input: &LiftInput,
    mode: Mode,
    settings: &LiftSettings,
    report: &mut Report,
) -> Result<SparseVoxels<Line>, StageError> {
    let grid = input.hull.grid;
    let surface = surface_voxels(input.hull);
    let views: Vec<View> = (0..input.rig.view_count()).into_par_iter().map(|v| View::new(input, &surface, v)).collect();
    let lifter = Lifter { views, mode, settings, band_mm: band_mm(mode, settings, grid.voxel_mm) };

    let in_brick = |corner: [usize; 3]| brick(input.hull, corner).filter_map(|voxel| lifter.line_in(&grid, voxel));
    let bricks = near_surface(input.hull, f64::from(lifter.band_mm));
    let mut found: Vec<(u32, Lifted)> = bricks.into_par_iter().flat_map_iter(in_brick).collect();
    found.sort_unstable_by_key(|(voxel, _)| *voxel);
    let reliable = reliable(found.iter().map(|(_, lifted)| lifted));
    found.retain(|(_, lifted)| lifted.line.views > 2 || lifted.asked & !reliable == 0);
    if found.is_empty() {
        let fact = "no voxel has a line on which views agree";
        report.warn(Place::frame(input.frame), fact, "the field of this frame rests on the scalp alone");
    }
    let (indices, values) = found.into_iter().map(|(voxel, lifted)| (voxel, lifted.line)).unzip();
    Ok(SparseVoxels { grid, indices, values })
}

/// A line, and the views that were asked and that agree, a bit each.
struct Lifted {
    line: Line,
    asked: u32,
    agree: u32,
}

/// The views, a bit each, that agree with most lines of several views; one that no such line tells of is among them.
fn reliable<'a>(found: impl Iterator<Item = &'a Lifted>) -> u32 {
    let (mut asked, mut agree) = ([0u32; MAX_VIEWS], [0u32; MAX_VIEWS]);
    for lifted in found.filter(|lifted| lifted.line.views > 2) {
        for view in 0..MAX_VIEWS {
            asked[view] += lifted.asked >> view & 1;
            agree[view] += lifted.agree >> view & 1;
        }
    }
    (0..MAX_VIEWS)
        .filter(|&view| agree[view] as f32 >= RELIABLE * asked[view] as f32)
        .fold(0, |views, view| views | 1 << view)
}

/// Edge of a brick \[voxels\]. The voxels of a brick show small patches of all images, which stay in the cache while it is
/// worked on; along a row of the grid every voxel would wait for memory.
const BRICK: usize = 8;

/// The first corners of the bricks of a hull in which a voxel can be seen within `band_mm` behind the first surface.
fn near_surface(hull: &Occupancy, band_mm: f64) -> Vec<[usize; 3]> {
    let grid = &hull.grid;
    let counts = grid.dims.map(|n| n.div_ceil(BRICK));
    let number = |[x, y, z]: [usize; 3]| (z * counts[1] + y) * counts[0] + x;
    let all = || {
        let [nx, ny, nz] = counts;
        (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])))
    };
    let full: Vec<bool> = all().map(|at| is_full(hull, at.map(|c| c * BRICK))).collect();
    // Depth maps are right to about a voxel.
    let reach = ((band_mm / grid.voxel_mm + 2.0) / BRICK as f64).ceil() as usize;
    let is_near = |at: &[usize; 3]| {
        let range = |axis: usize| at[axis].saturating_sub(reach)..=(at[axis] + reach).min(counts[axis] - 1);
        let within = (0..3).all(|axis| at[axis] >= reach && at[axis] + reach < counts[axis]);
        let deep = || range(2).all(|z| range(1).all(|y| range(0).all(|x| full[number([x, y, z])])));
        !(within && deep())
    };
    all().filter(is_near).map(|at| at.map(|c| c * BRICK)).collect()
}

/// Whether all voxels of a brick are occupied; one that stands over the grid is not.
fn is_full(hull: &Occupancy, [x, y, z]: [usize; 3]) -> bool {
    const ROW: u64 = (1 << BRICK) - 1;
    let grid = &hull.grid;
    let within = [x, y, z].iter().zip(grid.dims).all(|(c, n)| c + BRICK <= n);
    let row = |y: usize, z: usize| hull.bits_from(grid.index([x, y, z]) as isize) & ROW;
    within && (z..z + BRICK).all(|z| (y..y + BRICK).all(|y| row(y, z) == ROW))
}

/// The occupied voxels of a brick.
fn brick(hull: &Occupancy, [x0, y0, z0]: [usize; 3]) -> impl Iterator<Item = usize> + '_ {
    let [nx, ny, nz] = hull.grid.dims;
    let along = |from: usize, n: usize| from..(from + BRICK).min(n);
    along(z0, nz)
        .flat_map(move |z| along(y0, ny).flat_map(move |y| along(x0, nx).map(move |x| hull.grid.index([x, y, z]))))
        .filter(|&voxel| hull.get(voxel))
}

fn band_mm(mode: Mode, settings: &LiftSettings, voxel_mm: f64) -> f32 {
    match mode {
        Mode::Paper => (settings.surface_voxels * voxel_mm) as f32,
        Mode::Robust => settings.band_mm as f32,
    }
}

/// One view: its planes, and what it sees of the hull.
struct View<'a> {
    camera: &'a Camera,
    centre: Vec3,
    /// Unit plane normal, zero where there is no orientation; and its confidence.
    planes: Plane<(Vec3, f32)>,
    depth: DepthMap,
}

impl<'a> View<'a> {
    fn new(input: &LiftInput<'a>, surface: &[u32], view: usize) -> Self {
        let (camera, map, hair) = (&input.rig.cameras[view], input.maps[view], input.hairs[view]);
        let planes = Plane::from_fn(camera.width, camera.height, |x, y| {
            let confidence = map.confidence[(x, y)];
            if hair[(x, y)] < 128 || confidence <= 0.0 || !confidence.is_finite() {
                return (Vec3::ZERO, 0.0);
            }
            let pixel = glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            let direction = glam::DVec2::from_angle(f64::from(map.angle[(x, y)]));
            (plane_normal(camera, pixel, direction).as_vec3(), confidence)
        });
        Self {
            camera,
            centre: camera.centre_in_world().as_vec3(),
            planes,
            depth: DepthMap::of_voxels(camera, &input.hull.grid, surface),
        }
    }
}

/// What a view says about a point: a plane, and the weight it has.
#[derive(Clone, Copy, Default)]
struct Vote {
    view: usize,
    normal: Vec3,
    towards_camera: Vec3,
    weight: f32,
    confidence: f32,
}

struct Lifter<'a> {
    views: Vec<View<'a>>,
    mode: Mode,
    settings: &'a LiftSettings,
    band_mm: f32,
}

impl Lifter<'_> {
    /// The number of a voxel, and its line.
    fn line_in(&self, grid: &Grid, voxel: usize) -> Option<(u32, Lifted)> {
        Some((voxel as u32, self.line_at(grid.centre_of_index(voxel))?))
    }

    fn line_at(&self, point: glam::DVec3) -> Option<Lifted> {
        let mut list = [Vote::default(); MAX_VIEWS];
        let mut count = 0;
        for view in 0..self.views.len().min(MAX_VIEWS) {
            if let Some(vote) = self.vote(view, point) {
                list[count] = vote;
                count += 1;
            }
        }
        let votes = &list[..count];
        let trust = self.trust(votes)?;
        let ballot = Ballot::new(votes);
        let direction = match self.mode {
            Mode::Paper => least_squares(votes, &ballot.given)?,
            Mode::Robust => {
                let mut line = ballot.best_intersection(votes)?;
                for _ in 0..2 {
                    line = least_squares(votes, &ballot.weights(line))?;
                }
                line
            }
        };
        self.accept(votes, direction, trust)
    }

    /// How far a line of so many views can be trusted, if at all: two planes always meet.
    fn trust(&self, votes: &[Vote]) -> Option<f32> {
        let sure = || votes.iter().all(|vote| vote.confidence >= self.settings.pair_confidence);
        match (votes.len(), self.mode) {
            (0 | 1, _) | (2, Mode::Paper) => None,
            (2, Mode::Robust) => (self.settings.pair_trust > 0.0 && sure()).then_some(self.settings.pair_trust),
            _ => Some(1.0),
        }
    }

    /// What one view says: nothing where the point is hidden, out of view, off the hair or has no sure orientation.
    fn vote(&self, number: usize, point: glam::DVec3) -> Option<Vote> {
        let view = &self.views[number];
        let (pixel, depth) = project_with_depth(view.camera, point)?;
        let &(normal, confidence) = view.planes.at_point(pixel.x, pixel.y)?;
        (confidence >= self.settings.min_confidence).then_some(())?;
        let behind = view.depth.behind_at(pixel, depth)?;
        (behind <= self.band_mm).then_some(())?;
        // A view that looks through more of the hull than others sees the surface at a more grazing angle.
        let slant = match self.mode {
            Mode::Paper => 1.0,
            Mode::Robust => (4.0 / (4.0 + behind.max(0.0))).powi(2),
        };
        let towards_camera = (view.centre - point.as_vec3()).normalize();
        Some(Vote { view: number, normal, towards_camera, weight: confidence * slant, confidence })
    }

    /// The line with its figures, if enough planes speak for it.
    fn accept(&self, votes: &[Vote], direction: Vec3, trust: f32) -> Option<Lifted> {
        let inliers = votes.iter().filter(|vote| vote.normal.dot(direction).abs() < INLIER_SINE);
        let mut agree = 0;
        let (mut views, mut weight, mut squares, mut confidence) = (0, 0.0f32, 0.0f32, 0.0f32);
        let mut spread = Tensor::default();
        for vote in inliers {
            agree |= 1 << vote.view;
            views += 1;
            weight += vote.weight;
            squares += vote.weight * vote.normal.dot(direction).powi(2);
            confidence += vote.weight * vote.confidence;
            spread += Tensor::of_line(vote.normal) * vote.weight;
        }
        (usize::from(views) >= votes.len().min(3) && weight > 0.0).then_some(())?;
        let residual = (squares / weight).sqrt().asin();
        (residual <= self.settings.max_residual_deg.to_radians()).then_some(())?;
        let gap = (spread * (1.0 / weight)).eigenvalues()[1];
        (gap >= self.settings.min_gap).then_some(())?;
        // Sure orientations, small residual, planes well apart, and no loud dissent.
        let all: f32 = votes.iter().map(|vote| vote.weight).sum();
        let agreement = (-(residual / 0.12).powi(2)).exp();
        let confidence = confidence / weight * agreement * (gap / 0.2).min(1.0).sqrt() * (weight / all);
        let line = Line { direction, confidence: trust * confidence.clamp(0.0, 1.0), residual, views };
        Some(Lifted { line, asked: votes.iter().fold(0, |views, vote| views | 1 << vote.view), agree })
    }
}

/// The direction that minimises Σ w (n·d)².
fn least_squares(votes: &[Vote], weights: &[f32]) -> Option<Vec3> {
    let mut sum = Tensor::default();
    for (vote, &weight) in votes.iter().zip(weights) {
        sum += Tensor::of_line(vote.normal) * weight;
    }
    sum.trace().is_finite().then(|| sum.least_direction())
}

/// Votes side by side, so that a line is weighed against several at once. What lies beyond the last vote is zero.
struct Ballot {
    count: usize,
    normals: [[f32; MAX_VIEWS]; 3],
    towards_camera: [[f32; MAX_VIEWS]; 3],
    /// The weights that the votes came with.
    given: [f32; MAX_VIEWS],
}

/// Votes that are weighed at once.
const LANES: usize = 4;

impl Ballot {
    fn new(votes: &[Vote]) -> Self {
        let mut ballot = Self {
            count: votes.len(),
            normals: [[0.0; MAX_VIEWS]; 3],
            towards_camera: [[0.0; MAX_VIEWS]; 3],
            given: [0.0; MAX_VIEWS],
        };
        for (i, vote) in votes.iter().enumerate() {
            for axis in 0..3 {
                ballot.normals[axis][i] = vote.normal[axis];
                ballot.towards_camera[axis][i] = vote.towards_camera[axis];
            }
            ballot.given[i] = vote.weight;
        }
        ballot
    }

    /// The weights of the votes for a line: less where the line points at the camera (its image direction says little then)
    /// and where the plane misses it (Geman–McClure).
    fn weights(&self, line: Vec3) -> [f32; MAX_VIEWS] {
        let mut weights = [0.0; MAX_VIEWS];
        let Self { normals: [nx, ny, nz], towards_camera: [tx, ty, tz], given, .. } = self;
        // Whole packs, so that the loop runs on them.
        for i in 0..self.count.next_multiple_of(LANES).min(MAX_VIEWS) {
            let seen = 1.0 - (tx[i] * line.x + ty[i] * line.y + tz[i] * line.z).powi(2);
            let miss = (nx[i] * line.x + ny[i] * line.y + nz[i] * line.z) / (0.5 * INLIER_SINE);
            weights[i] = given[i] * (seen / (1.0 + miss * miss).powi(2));
        }
        weights
    }

    /// The intersection of two planes on which most of the weight agrees: a medoid of real candidates.
    fn best_intersection(&self, votes: &[Vote]) -> Option<Vec3> {
        let mut best = (0.0, None);
        for (i, a) in votes.iter().enumerate() {
            for b in &votes[..i] {
                let cross = a.normal.cross(b.normal);
                let sine = cross.length();
                if sine < PAIR_SINE {
                    continue;
                }
                let line = cross / sine;
                let support: f32 = self.weights(line)[..self.count].iter().sum();
                if support > best.0 {
                    best = (support, Some(line));
                }
            }
        }
        best.1
    }
}
