//! Subject masks of a few frames, and whether the views' silhouettes fit together.
//!
//! The hull of all silhouettes is drawn back into every view. Where it leaves a part of one mask empty, that mask shows
//! what the others do not (a leak). Where it leaves parts of several masks empty, some view has cut the hull: the one
//! without which the others are filled.

use rayon::prelude::*;
use strandflow_core::{Camera, Grid, Mask, Occupancy, Plane, Report, Rig};
use strandflow_geometry::project::project;
use strandflow_image::morph::{components, eroded};
use strandflow_stages::{
    StageError,
    hull::{HullSettings, grid_of_take, hull},
};

/// Edge of the voxels that are compared \[mm\]: a pixel and a half of the captures we know; finer costs time and tells no more.
pub const VOXEL_MM: f64 = 4.0;

/// The views' silhouettes at one moment.
pub struct Moment {
    /// The frame.
    pub frame: usize,
    /// The cameras that take part.
    pub rig: Rig,
    /// One subject mask a camera.
    pub subjects: Vec<Mask>,
}

/// How the hull of a moment fills the masks.
#[derive(Clone, Debug, PartialEq)]
pub struct Filled {
    /// Pixels of each mask that the hull leaves empty, as a share of the mask.
    pub empty: Vec<f64>,
    /// The largest connected empty part of each mask \[px\].
    pub largest: Vec<usize>,
    /// For each view left out: the empty shares of the others (its own is 0).
    pub without: Vec<Vec<f64>>,
}

/// The grid that holds the hulls of all moments.
///
/// # Errors
/// As of stage `hull`: the view that empties it is named.
pub fn grid(moments: &[Moment], settings: &HullSettings) -> Result<Grid, StageError> {
    let rig = moments.first().map(|moment| moment.rig.clone()).unwrap_or_default();
    let mut unions: Vec<Mask> = moments.first().map(|moment| moment.subjects.clone()).unwrap_or_default();
    for moment in &moments[1.min(moments.len())..] {
        for (union, mask) in unions.iter_mut().zip(&moment.subjects) {
            union.data.iter_mut().zip(&mask.data).for_each(|(all, &one)| *all = one.max(*all));
        }
    }
    grid_of_take(&rig, &unions, settings, &mut Report::default())
}

/// Settings of the hull for comparing: coarse voxels.
pub fn coarse(settings: &HullSettings) -> HullSettings {
    HullSettings { voxel_mm: settings.voxel_mm.max(VOXEL_MM), ..settings.clone() }
}

/// Compares the hull of a moment with its masks.
///
/// # Errors
/// As of stage `hull`.
pub fn filled(moment: &Moment, grid: &Grid, settings: &HullSettings) -> Result<Filled, StageError> {
    let all: Vec<usize> = (0..moment.rig.view_count()).collect();
    let whole = hull_of(moment, &all, grid, settings)?;
    let mut found = Filled { empty: Vec::new(), largest: Vec::new(), without: Vec::new() };
    let empties: Vec<Plane<bool>> = all.par_iter().map(|&view| empty(moment, view, &whole)).collect();
    for (empty, mask) in empties.iter().zip(&moment.subjects) {
        found.empty.push(share(empty, mask));
        found.largest.push(components(empty).1.into_iter().skip(1).max().unwrap_or(0));
    }
    found.without = all
        .par_iter()
        .map(|&left_out| {
            let rest: Vec<usize> = all.iter().copied().filter(|&view| view != left_out).collect();
            // On a grid of its own: a view that cuts the hull cuts the grid that it helps to make.
            let (rig, masks) = part(moment, &rest);
            let masks: Vec<Mask> = masks.into_iter().cloned().collect();
            let grid = grid_of_take(&rig, &masks, settings, &mut Report::default());
            let Ok(hull) = grid.and_then(|grid| hull_of(moment, &rest, &grid, settings)) else {
                return vec![1.0; all.len()];
            };
            let of = |&view: &usize| match view == left_out {
                true => 0.0,
                false => share(&empty(moment, view, &hull), &moment.subjects[view]),
            };
            all.iter().map(of).collect()
        })
        .collect();
    Ok(found)
}

/// The hull of a moment by all its views, also where only two of them see.
///
/// # Errors
/// As of stage `hull`.
pub fn whole(moment: &Moment, grid: &Grid, settings: &HullSettings) -> Result<Occupancy, StageError> {
    let views: Vec<usize> = (0..moment.rig.view_count()).collect();
    hull_of(moment, &views, grid, &HullSettings { least_views: 2, ..settings.clone() })
}

fn hull_of(moment: &Moment, views: &[usize], grid: &Grid, settings: &HullSettings) -> Result<Occupancy, StageError> {
    let (rig, masks) = part(moment, views);
    hull(&rig, &masks, grid, moment.frame, settings, &mut Report::default())
}

/// Cameras and masks of some views.
fn part<'a>(moment: &'a Moment, views: &[usize]) -> (Rig, Vec<&'a Mask>) {
    let cameras = views.iter().map(|&view| moment.rig.cameras[view].clone()).collect();
    (Rig { cameras }, views.iter().map(|&view| &moment.subjects[view]).collect())
}

/// Pixels from a mask's border that are not compared: voxels and matte are coarser than that.
const BORDER_PX: usize = 2;

/// Pixels of a mask that a hull does not cover.
fn empty(moment: &Moment, view: usize, hull: &Occupancy) -> Plane<bool> {
    let mask = &moment.subjects[view];
    let covered = drawn(&moment.rig.cameras[view], hull);
    let inside = eroded(&mask.map(|&m| m >= 128), BORDER_PX);
    Plane {
        data: inside.data.iter().zip(&covered.data).map(|(&inside, &covered)| inside && !covered).collect(),
        ..inside
    }
}

fn share(empty: &Plane<bool>, mask: &Mask) -> f64 {
    let count = empty.data.iter().filter(|&&is| is).count();
    let area = mask.data.iter().filter(|&&m| m >= 128).count();
    count as f64 / area.max(1) as f64
}

/// The pixels that the voxels of a hull cover: squares around their centres, as large as a voxel seen from its corner.
fn drawn(camera: &Camera, hull: &Occupancy) -> Plane<bool> {
    let grid = &hull.grid;
    let mut covered = Plane::filled(camera.width, camera.height, false);
    let eye = camera.centre_in_world();
    let focal = camera.focal[0].max(camera.focal[1]);
    for index in hull.indices() {
        let centre = grid.centre_of_index(index);
        let Some(at) = project(camera, centre) else { continue };
        let half = 0.87 * grid.voxel_mm * focal / centre.distance(eye).max(1.0);
        let range = |middle: f64, side: usize| {
            let low = (middle - half).max(0.0) as usize;
            low.min(side)..((middle + half).ceil().max(0.0) as usize).min(side)
        };
        let columns = range(at.x, camera.width);
        for y in range(at.y, camera.height) {
            covered.data[y * camera.width..][columns.clone()].fill(true);
        }
    }
    covered
}

/// What the masks of a moment have against one another.
#[derive(Clone, Debug, PartialEq)]
pub enum Blame {
    /// This view's mask shows more than the others leave room for: share of it, and largest part \[px\].
    Leak(usize, f64, usize),
    /// This view's mask cuts away what the others show: the share of all of theirs that it costs, and how many views lose.
    Cut(usize, f64, usize),
    /// Several masks are not filled, and no single view is to blame: the largest share.
    Several(f64),
}

/// Share of a mask that may be empty without a word. What stands alone in a view, hidden in all others or out of their
/// images, is less.
pub const EMPTY: f64 = 0.02;

/// Whom the empty parts blame.
pub fn blame(filled: &Filled) -> Option<Blame> {
    let lacking: Vec<usize> = (0..filled.empty.len()).filter(|&view| filled.empty[view] > EMPTY).collect();
    if lacking.is_empty() {
        return None;
    }
    let others = |view: usize, shares: &[f64]| {
        shares.iter().enumerate().filter(|(v, _)| *v != view).map(|(_, s)| s).sum::<f64>()
    };
    let gain = |view: usize| others(view, &filled.empty) - others(view, &filled.without[view]);
    let guilty = (0..filled.empty.len()).max_by(|&a, &b| gain(a).total_cmp(&gain(b)))?;
    let loss = others(guilty, &filled.empty);
    let losers = lacking.iter().filter(|&&view| view != guilty).count();
    // One mask alone that is not filled shows too much: a cut that costs a single view is rare.
    if losers > 1 && gain(guilty) > 0.6 * loss {
        let mean = gain(guilty) / (filled.empty.len() - 1) as f64;
        return Some(Blame::Cut(guilty, mean, losers));
    }
    match lacking.as_slice() {
        [one] => Some(Blame::Leak(*one, filled.empty[*one], filled.largest[*one])),
        several => Some(Blame::Several(several.iter().map(|&view| filled.empty[view]).fold(0.0, f64::max))),
    }
}

/// Parts of the background that a mask encloses: their areas \[px\], the largest first. No other view tells of a hole, because
/// there is subject before and behind it.
pub fn holes(mask: &Mask) -> Vec<usize> {
    let (labels, mut areas) = components(&mask.map(|&m| m < 128));
    let (w, h) = (mask.width, mask.height);
    let border = (0..w).flat_map(|x| [(x, 0), (x, h - 1)]).chain((0..h).flat_map(|y| [(0, y), (w - 1, y)]));
    border.for_each(|at| areas[labels[at] as usize] = 0);
    let mut holes: Vec<usize> = areas.into_iter().skip(1).filter(|&area| area > 0).collect();
    holes.sort_by(|a, b| b.cmp(a));
    holes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::labels::tests::rig;
    use strandflow_geometry::project::ray;

    /// A ball of 90 mm at the origin, as every view sees it.
    fn ball() -> Moment {
        let rig = rig();
        let mask = |camera: &Camera| {
            Mask::from_fn(camera.width, camera.height, |x, y| {
                let r = ray(camera, glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
                if r.origin.reject_from_normalized(r.direction).length() < 90.0 { 255 } else { 0 }
            })
        };
        let subjects = rig.cameras.iter().map(mask).collect();
        Moment { frame: 0, rig, subjects }
    }

    fn judged(moment: &Moment) -> Option<Blame> {
        let settings = coarse(&HullSettings::default());
        let grid = grid(std::slice::from_ref(moment), &settings).unwrap();
        blame(&filled(moment, &grid, &settings).unwrap())
    }

    #[test]
    fn masks_that_fit_blame_nobody() {
        assert_eq!(judged(&ball()), None);
    }

    #[test]
    fn a_leak_and_a_cut_blame_their_view() {
        let mut leak = ball();
        (180..300).for_each(|y| (420..560).for_each(|x| leak.subjects[2][(x, y)] = 255));
        assert!(matches!(judged(&leak), Some(Blame::Leak(2, ..))), "{:?}", judged(&leak));
        let mut cut = ball();
        (200..480).for_each(|y| (0..640).for_each(|x| cut.subjects[4][(x, y)] = 0));
        assert!(matches!(judged(&cut), Some(Blame::Cut(4, ..))), "{:?}", judged(&cut));
    }

    #[test]
    fn enclosed_background_is_a_hole() {
        let mut mask = Mask::from_fn(40, 30, |x, y| if (5..35).contains(&x) && y >= 4 { 255 } else { 0 });
        (10..14).for_each(|y| (10..15).for_each(|x| mask[(x, y)] = 0));
        (25..30).for_each(|y| (20..25).for_each(|x| mask[(x, y)] = 0));
        assert_eq!(holes(&mask), [20]);
    }

    #[test]
    fn an_empty_mask_is_an_error_that_names_it() {
        let mut moment = ball();
        moment.subjects[1].data.fill(0);
        let error = grid(&[moment], &coarse(&HullSettings::default())).unwrap_err();
        assert!(error.to_string().contains("cam01"), "{error}");
    }
}
