//! Stage 2: the take's grid, and the visual hull of each frame on it.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use strandflow_core::{Grid, Mask, Occupancy, Place, Report, Rig};
use strandflow_geometry::triangulate::meeting_of_axes;
use strandflow_volume::carve::{CarvingView, carve, carve_touching, largest_component, occupied_box};
use strandflow_volume::parts::parts;
use strandflow_volume::silhouette::Silhouette;

use crate::{SettingViolation, StageError};

/// Voxels of a grid beyond which memory and time are out of proportion (a metre cubed at 2 mm has 1.25e8).
pub const MOST_VOXELS: usize = 500_000_000;

/// Settings of stage `hull`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HullSettings {
    /// Edge of a voxel \[mm\].
    pub voxel_mm: f64,
    /// Least coverage, of 255, of a pixel that counts as subject. Low, because single strands cover a pixel in part.
    pub threshold: u8,
    /// Growth of the silhouettes \[px\], beside half a voxel (which keeps voxels whose centre just misses).
    pub grow_px: f64,
    /// Views that must see a voxel; with fewer cameras than that, all of them. Two views that face each other confine
    /// nothing along their common axis; with four, hair that hangs out of some images is lost.
    pub least_views: usize,
    /// Room around the hulls of all frames \[mm\].
    pub margin_mm: f64,
}

impl Default for HullSettings {
    fn default() -> Self {
        Self { voxel_mm: 2.0, threshold: 40, grow_px: 1.0, least_views: 3, margin_mm: 6.0 }
    }
}

impl HullSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        let mut found = Vec::new();
        SettingViolation::unless(
            (0.25..=20.0).contains(&self.voxel_mm),
            &mut found,
            ("hull.voxel_mm", self.voxel_mm),
            ("0.25..=20", "a head is 200 mm wide; below 0.25 mm no image has that detail"),
        );
        SettingViolation::unless(
            self.threshold >= 1,
            &mut found,
            ("hull.threshold", self.threshold),
            ("1..=255", "at 0 every pixel is subject and nothing is carved"),
        );
        SettingViolation::unless(
            (0.0..=50.0).contains(&self.grow_px),
            &mut found,
            ("hull.grow_px", self.grow_px),
            ("0..=50", "growth covers what masks miss at the border, a few pixels"),
        );
        SettingViolation::unless(
            self.least_views >= 1,
            &mut found,
            ("hull.least_views", self.least_views),
            ("1..", "space that no view sees cannot be occupied"),
        );
        SettingViolation::unless(
            (0.0..=200.0).contains(&self.margin_mm),
            &mut found,
            ("hull.margin_mm", self.margin_mm),
            ("0..=200", "the margin only keeps neighbourhoods of hull voxels inside the grid"),
        );
        found
    }
}

/// The grid that holds the hulls of all frames: the coarse hull of the union of each view's subject masks over all
/// frames, plus a margin. `unions`: one mask a view.
///
/// Errors: masks and cameras that do not match, non-finite calibration, an empty hull (with the view that empties it), a
/// grid that would be too large.
pub fn grid_of_take(
    rig: &Rig,
    unions: &[Mask],
    settings: &HullSettings,
    report: &mut Report,
) -> Result<Grid, StageError> {
    let place = Place::default();
    let masks: Vec<&Mask> = unions.iter().collect();
    check_input(rig, &masks, &place, report)?;
    let (centre, distance) = subject_place(rig);
    let domain = cube(centre, 0.75 * distance, 16.0_f64.max(settings.voxel_mm * 2.0));
    let coarse = bounded(rig, &masks, settings, &domain)
        .ok_or_else(|| empty_hull(rig, &masks, &domain, place.clone(), settings))?;
    let refined = Grid { origin: coarse.0, voxel_mm: (domain.voxel_mm / 4.0).max(settings.voxel_mm), dims: [1; 3] };
    let refined = fitted(refined.origin, coarse.1, refined.voxel_mm);
    let (low, high) = bounded(rig, &masks, settings, &refined)
        .ok_or_else(|| empty_hull(rig, &masks, &domain, place.clone(), settings))?;
    let grid = fitted(low - settings.margin_mm, high + settings.margin_mm, settings.voxel_mm);
    if grid.dims.iter().try_fold(1usize, |n, &d| n.checked_mul(d)).is_none_or(|n| n > MOST_VOXELS) {
        return Err(StageError::Input {
            place,
            fact: format!("the hull of the take needs {:?} voxels of {} mm", grid.dims, settings.voxel_mm),
            hint: "raise hull.voxel_mm, or check the units of the calibration (millimetres) and the subject masks"
                .into(),
        });
    }
    Ok(grid)
}

/// The visual hull of one frame on the take's grid. `subjects`: one mask a view. Voxels that no view sees are not
/// occupied; a view in which a voxel falls outside the image says nothing about it.
///
/// Errors: as [`grid_of_take`].
///
/// Reference: Laurentini 1994; Zhang et al. 2012 §4.
pub fn hull(
    rig: &Rig,
    subjects: &[&Mask],
    grid: &Grid,
    frame: usize,
    settings: &HullSettings,
    report: &mut Report,
) -> Result<Occupancy, StageError> {
    let place = Place::frame(frame);
    check_input(rig, subjects, &place, report)?;
    let silhouettes = silhouettes(rig, subjects, grid, settings);
    let occupancy = carve(&views_of(rig, &silhouettes), grid, least_views(rig, settings));
    if occupancy.words.iter().all(|&word| word == 0) {
        return Err(empty_hull(rig, subjects, grid, place, settings));
    }
    let bodies = bodies(&occupancy);
    if bodies.len() > 1 {
        let litres = |body: &Vec<usize>| format!("{:.2}", body.len() as f64 * grid.voxel_mm.powi(3) / 1e6);
        let sizes: Vec<String> = bodies.iter().map(litres).collect();
        let fact = format!("the hull falls into bodies of {} litres", sizes.join(" and "));
        report.warn(place, fact, "another person or thing is in view; hair is sought in the body that holds the head");
    }
    Ok(occupancy)
}

/// Width of a gap between bodies \[mm\]: under it hair that hangs clear of the rest would count as a body.
const GAP_MM: f64 = 8.0;
/// Size of a body against the largest; smaller ones are locks of hair and corners where few views look.
const BODY: f64 = 0.1;

/// The large separate parts of a hull, the largest first; one where one person is in view.
pub(crate) fn bodies(hull: &Occupancy) -> Vec<Vec<usize>> {
    let mut bodies = parts(hull, (GAP_MM / hull.grid.voxel_mm).round() as usize);
    let largest = bodies.first().map_or(0, Vec::len);
    bodies.retain(|body| body.len() as f64 >= BODY * largest as f64);
    bodies
}

fn least_views(rig: &Rig, settings: &HullSettings) -> usize {
    settings.least_views.min(rig.view_count())
}

/// Each view's silhouette, grown by the setting and by half a voxel at the distance of the grid's centre, so that a voxel
/// whose centre lies just outside is kept with the hair in its inner half.
fn silhouettes(rig: &Rig, masks: &[&Mask], grid: &Grid, settings: &HullSettings) -> Vec<Silhouette> {
    let middle = grid.origin + DVec3::from_array(grid.dims.map(|n| n as f64 * 0.5 * grid.voxel_mm));
    let one = |(camera, mask): (&strandflow_core::Camera, &&Mask)| {
        let distance = camera.centre_in_world().distance(middle).max(1.0);
        let half_voxel_px = 0.5 * settings.voxel_mm * camera.focal[0].max(camera.focal[1]) / distance;
        Silhouette::from_mask(mask, settings.threshold, settings.grow_px + half_voxel_px)
    };
    rig.cameras.iter().zip(masks).map(one).collect()
}

fn views_of<'a>(rig: &'a Rig, silhouettes: &'a [Silhouette]) -> Vec<CarvingView<'a>> {
    rig.cameras.iter().zip(silhouettes).map(|(camera, silhouette)| CarvingView { camera, silhouette }).collect()
}

/// World box of the largest piece of what the masks leave of a grid \[mm\]; smaller ones are where few views look.
fn bounded(rig: &Rig, masks: &[&Mask], settings: &HullSettings, grid: &Grid) -> Option<(DVec3, DVec3)> {
    let silhouettes = silhouettes(rig, masks, grid, settings);
    let touched = carve_touching(&views_of(rig, &silhouettes), grid, least_views(rig, settings));
    let (low, high) = occupied_box(&largest_component(&touched))?;
    let corner = |voxel: [usize; 3]| grid.origin + DVec3::from_array(voxel.map(|k| k as f64)) * grid.voxel_mm;
    Some((corner(low), corner(high)))
}

/// The point nearest to all optical axes and the median distance of the cameras to it \[mm\].
fn subject_place(rig: &Rig) -> (DVec3, f64) {
    let axes = || rig.cameras.iter().map(|c| (c.centre_in_world(), c.camera_from_world.rotation.row(2)));
    let centres = || axes().map(|(o, _)| o).sum::<DVec3>() / rig.view_count() as f64;
    // Parallel axes do not meet: then take a point a metre ahead of the cameras.
    let ahead = || centres() + axes().map(|(_, d)| d).sum::<DVec3>().normalize_or_zero() * 1000.0;
    let point = meeting_of_axes(rig).unwrap_or_else(ahead);
    let mut distances: Vec<f64> = axes().map(|(o, _)| o.distance(point)).collect();
    distances.sort_by(f64::total_cmp);
    (point, distances[distances.len() / 2].max(100.0))
}

fn cube(centre: DVec3, half: f64, voxel_mm: f64) -> Grid {
    let n = (2.0 * half / voxel_mm).ceil().clamp(4.0, 400.0);
    Grid { origin: centre - half, voxel_mm: 2.0 * half / n, dims: [n as usize; 3] }
}

/// The smallest grid from `low` on that holds `high`.
fn fitted(low: DVec3, high: DVec3, voxel_mm: f64) -> Grid {
    let dims = ((high - low) / voxel_mm).ceil().to_array().map(|n| (n as usize).max(1));
    Grid { origin: low, voxel_mm, dims }
}

fn check_input(rig: &Rig, masks: &[&Mask], place: &Place, report: &mut Report) -> Result<(), StageError> {
    let input = |place, fact: String, hint: &str| Err(StageError::Input { place, fact, hint: hint.into() });
    if rig.cameras.is_empty() || rig.view_count() != masks.len() {
        let fact = format!("{} subject masks for {} cameras", masks.len(), rig.view_count());
        return input(place.clone(), fact, "every view needs one subject mask and one calibrated camera");
    }
    for (camera, mask) in rig.cameras.iter().zip(masks) {
        let at = Place { view: Some(camera.name.clone()), ..place.clone() };
        let pose = &camera.camera_from_world;
        let lens = camera.focal.iter().chain(&camera.principal).all(|n| n.is_finite()) && camera.distortion.is_finite();
        if !pose.rotation.is_finite() || !pose.translation.is_finite() || !lens {
            return Err(StageError::NonFinite { place: at, what: "the calibration".into() });
        }
        if (mask.width, mask.height) != (camera.width, camera.height) {
            let fact = format!(
                "the subject mask is {}×{} pixels, the camera {}×{}",
                mask.width, mask.height, camera.width, camera.height
            );
            return input(at, fact, "give masks of the image's size");
        }
        let covered = mask.data.iter().filter(|&&coverage| coverage >= 128).count();
        if covered * 100 > mask.data.len() * 95 {
            let share = 100 * covered / mask.data.len();
            report.warn(at, format!("the subject covers {share} % of the image"), "the view hardly carves the hull");
        }
    }
    Ok(())
}

/// The error of an empty hull: names the view without which the most volume would be left.
fn empty_hull(rig: &Rig, masks: &[&Mask], grid: &Grid, place: Place, settings: &HullSettings) -> StageError {
    let named = |view: usize| Place { view: Some(rig.cameras[view].name.clone()), ..place.clone() };
    let blank = |mask: &&Mask| mask.data.iter().all(|&coverage| coverage < settings.threshold);
    if let Some(view) = masks.iter().position(blank) {
        return StageError::Input {
            place: named(view),
            fact: "the subject mask is empty, and with it the visual hull".into(),
            hint: "look at this view's mask and clean plate, or give its mask by hand".into(),
        };
    }
    // A coarse grid is enough to compare volumes.
    let extent = DVec3::from_array(grid.dims.map(|n| n as f64)) * grid.voxel_mm;
    let coarse = fitted(grid.origin, grid.origin + extent, (extent.max_element() / 64.0).max(grid.voxel_mm));
    let silhouettes = silhouettes(rig, masks, &coarse, settings);
    let views = views_of(rig, &silhouettes);
    let without = |left_out: usize| {
        let rest: Vec<_> = views.iter().enumerate().filter(|(i, _)| *i != left_out).map(|(_, v)| *v).collect();
        carve(&rest, &coarse, least_views(rig, settings).min(rest.len().max(1))).count()
    };
    let volumes: Vec<usize> = (0..views.len()).map(without).collect();
    let worst = (0..volumes.len()).rev().max_by_key(|&view| volumes[view]);
    match worst.filter(|&view| volumes[view] > 0) {
        Some(view) => StageError::Input {
            place: named(view),
            fact: format!(
                "the silhouettes share no volume; without this view {:.0} cm³ are left",
                volumes[view] as f64 * coarse.voxel_mm.powi(3) / 1000.0
            ),
            hint:
                "look at this view's subject mask, clean plate and calibration; exclude the view if it cannot be mended"
                    .into(),
        },
        None => StageError::Input {
            place,
            fact: "the silhouettes share no volume, and no single view is to blame".into(),
            hint: "check the calibration (units, world-to-camera direction, order of the views) and the subject masks"
                .into(),
        },
    }
}
