//! The checks `coverage` and `resolution`: from where the subject is seen, and how finely.

use glam::DVec3;
use rayon::prelude::*;
use strandflow_core::{Camera, Occupancy, Place, Report, Rig};
use strandflow_geometry::project::project;
use strandflow_stages::{Mode, orient::orient};

use crate::{Evidence, Finding, Outcome, labels::median};

/// Views that must see a place for lines to be lifted there.
const LIFTED_BY: usize = 3;
/// Share of the subject that fewer views may see without a word.
const UNSEEN: f64 = 0.05;
/// Largest angle between two views below which depth is hardly told \[°\]: at 20° a pixel across is three in depth.
const NARROW_DEG: f64 = 20.0;

/// The views that are used.
fn used(evidence: &Evidence) -> Rig {
    let views = (0..evidence.views.len()).filter(|&v| !evidence.views[v].held_out && !evidence.distrusted.contains(&v));
    Rig { cameras: views.map(|v| evidence.mended.cameras[v].clone()).collect() }
}

/// The middle of a hull \[mm\].
fn middle(hull: &Occupancy) -> Option<DVec3> {
    let (sum, count) =
        hull.indices().fold((DVec3::ZERO, 0.0), |(sum, n), i| (sum + hull.grid.centre_of_index(i), n + 1.0));
    (count > 0.0).then(|| sum / count)
}

/// The check `coverage`.
pub(crate) fn coverage(evidence: &mut Evidence) -> Outcome {
    let Some((hull, at)) = evidence.hull.as_ref().and_then(|hull| Some((hull, middle(hull)?))) else {
        return Outcome::unjudged("there is no hull to be covered");
    };
    let rig = used(evidence);
    let share = share_seen(&rig, hull);
    let (widest, gap) = angles(&rig, at, evidence.gravity);
    let measured = format!(
        "{:.1} % of the hull is in {LIFTED_BY} images or more; views up to {widest:.0}° apart, widest gap around {gap:.0}°",
        100.0 * share
    );
    let mut findings = Vec::new();
    if share < 1.0 - UNSEEN {
        let fact = format!("{:.0} % of the subject is in fewer than {LIFTED_BY} images", 100.0 * (1.0 - share));
        findings.push(
            Finding::look("coverage", "all views", fact)
                .suffers("lift: no line is made there; hull: what fewer see is not occupied")
                .hint("move cameras back, turn them to the hair, or add one where few look"),
        );
    }
    if widest < NARROW_DEG {
        let fact = format!("all views look from within {widest:.0}°");
        findings.push(
            Finding::look("narrow-rig", "all views", fact)
                .suffers("hull, lift: depth is hardly told")
                .hint("spread the cameras around back and sides"),
        );
    }
    Outcome::of(measured, findings)
}

/// Share of a hull's voxels that enough views have in their image.
fn share_seen(rig: &Rig, hull: &Occupancy) -> f64 {
    let sees = |camera: &&Camera, place: DVec3| {
        project(camera, place)
            .is_some_and(|p| p.x >= 0.0 && p.y >= 0.0 && p.x < camera.width as f64 && p.y < camera.height as f64)
    };
    let (mut seen, mut all) = (0usize, 0usize);
    for index in hull.indices() {
        let place = hull.grid.centre_of_index(index);
        let views = rig.cameras.iter().filter(|camera| sees(camera, place)).count();
        (seen, all) = (seen + usize::from(views >= LIFTED_BY.min(rig.view_count())), all + 1);
    }
    seen as f64 / all.max(1) as f64
}

/// The largest angle between two views, and the widest gap between neighbours around the vertical, seen from a place \[°\].
fn angles(rig: &Rig, at: DVec3, gravity: DVec3) -> (f64, f64) {
    let directions: Vec<DVec3> = rig.cameras.iter().map(|c| (c.centre_in_world() - at).normalize_or_zero()).collect();
    let pairs = directions.iter().enumerate().flat_map(|(i, a)| directions[..i].iter().map(|b| a.angle_between(*b)));
    let widest = pairs.fold(0.0, f64::max).to_degrees();
    let up = (-gravity).normalize_or(DVec3::Z);
    let (x, y) = up.any_orthonormal_pair();
    let mut around: Vec<f64> = directions.iter().map(|d| d.dot(y).atan2(d.dot(x)).to_degrees()).collect();
    around.sort_by(f64::total_cmp);
    let steps = around.windows(2).map(|pair| pair[1] - pair[0]);
    let last = around.first().zip(around.last()).map_or(360.0, |(first, last)| 360.0 - (last - first));
    (widest, steps.fold(last, f64::max))
}

/// Width of hair that the finest filter may span \[mm\]: the captures that the program was measured on have 5, at half of their
/// size 10, where wisps run together.
const FINEST_MM: f64 = 11.0;
/// Mean confidence of orientations below which strands are not told from noise: sharp hair has 0.5 to 0.6.
const CONFIDENCE: f64 = 0.3;

/// The check `resolution`.
pub(crate) fn resolution(evidence: &mut Evidence) -> Outcome {
    let rig = used(evidence);
    let at = evidence.hull.as_ref().and_then(middle);
    let mm = at.and_then(|at| median(rig.cameras.iter().map(|c| mm_of_pixel(c, at))));
    let confidences = confidences(evidence);
    let waves = &evidence.settings.orient.wavelengths_px;
    let finest = f64::from(waves.iter().copied().fold(f32::INFINITY, f32::min));
    let mut findings = Vec::new();
    let Some(mm) = mm else { return Outcome::unjudged("there is no hull to measure pixels at") };
    let lowest = confidences.iter().map(|c| c.1).fold(f64::INFINITY, f64::min);
    let trust = if lowest.is_finite() { format!("; orientations agree to {lowest:.2} or more") } else { String::new() };
    let measured = format!("a pixel spans {mm:.2} mm, the finest filter ({finest:.1} px) {:.1} mm{trust}", finest * mm);
    if finest * mm > FINEST_MM {
        let fact = format!(
            "a pixel spans {mm:.1} mm of hair: the finest filter ({finest:.1} px) sees wisps of {:.0} mm, a strand is a {:.0}th of a pixel",
            finest * mm,
            mm / STRAND_MM
        );
        findings.push(
            Finding::look("thin-hair", "all views", fact)
                .suffers("orient: strands run together in a pixel, and their direction is that of the whole lock")
                .hint(
                    "longer lenses, cameras nearer to the head, or more pixels: a millimetre of hair a pixel is good",
                ),
        );
    }
    for (view, confidence) in confidences.into_iter().filter(|c| c.1 < CONFIDENCE && finest * mm <= FINEST_MM) {
        let fact =
            format!("orientations agree to {confidence:.2} only, from {CONFIDENCE} on strands are told from noise");
        findings.push(
            Finding::look("no-texture", format!("view {}", evidence.name(view)), fact)
                .suffers("orient: no direction that other stages could believe")
                .hint("light that grazes the hair, focus, less noise; or `orient.wavelengths_px` nearer to the width of its wisps"),
        );
    }
    Outcome::of(measured, findings)
}

/// Thickness of human hair \[mm\].
const STRAND_MM: f64 = 0.08;

/// Millimetres that a pixel spans at a place.
fn mm_of_pixel(camera: &Camera, at: DVec3) -> f64 {
    camera.centre_in_world().distance(at) / camera.focal[0].max(1e-9)
}

/// Mean confidence of the orientations of each view's first frame, by the stage itself.
fn confidences(evidence: &Evidence) -> Vec<(usize, f64)> {
    let frame = evidence.frames.start;
    let of = |view: usize| {
        let (image, hair) = (evidence.image(view, frame)?, evidence.views[view].hair.as_ref()?);
        let subject = evidence.sampled.iter().find(|s| s.view == view && s.frame == frame).map(|s| &s.subject)?;
        let place = Place::view_frame(evidence.name(view), frame);
        let settings = &evidence.settings.orient;
        let map = orient(&place, &image, hair, subject, Mode::Robust, settings, &mut Report::default()).ok()?;
        let on_hair = map.confidence.data.iter().zip(&hair.data).filter(|(_, h)| **h >= 128);
        let (sum, count) = on_hair.fold((0.0, 0usize), |(sum, n), (c, _)| (sum + f64::from(*c), n + 1));
        (count > 0).then(|| (view, sum / count as f64))
    };
    let views: Vec<usize> = (0..evidence.views.len()).collect();
    views.into_par_iter().filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::labels::tests::rig;
    use strandflow_core::Grid;

    fn ball() -> Occupancy {
        let grid = Grid { origin: DVec3::splat(-100.0), voxel_mm: 10.0, dims: [20; 3] };
        let mut ball = Occupancy::empty(grid);
        (0..grid.len())
            .filter(|&i| ball.grid.centre_of_index(i).length() < 90.0)
            .collect::<Vec<_>>()
            .into_iter()
            .for_each(|i| ball.set(i, true));
        ball
    }

    #[test]
    fn what_few_views_see_is_counted() {
        let ball = ball();
        assert!(middle(&ball).unwrap().length() < 1e-9);
        assert_eq!(share_seen(&rig(), &ball), 1.0);
        let mut turned = rig();
        turned.cameras[..4].iter_mut().for_each(|camera| camera.principal[0] = -2000.0);
        assert_eq!(share_seen(&turned, &ball), 0.0);
    }

    #[test]
    fn angles_between_views() {
        let (widest, gap) = angles(&rig(), DVec3::ZERO, DVec3::NEG_Z * 9810.0);
        assert!(
            (100.0..180.0).contains(&widest) && (gap - (360.0 - 3.5f64.to_degrees())).abs() < 1e-6,
            "{widest} {gap}"
        );
        assert!((mm_of_pixel(&rig().cameras[0], DVec3::ZERO) - 1500.0 / 1400.0).abs() < 1e-9);
    }
}
