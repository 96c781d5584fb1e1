//! The check `distortion`: whether one radial term more lets followed markers agree.
//!
//! Lenses of one rig are mostly of one kind, so one term is shared by all views. Markers in a few frames of the swing reach
//! more of the image than the labels of one frame.

use glam::DVec2;
use strandflow_core::{Camera, Distortion, FrameRange, Rig};
use strandflow_geometry::{project::project, triangulate::triangulate};

use crate::{Evidence, Finding, Outcome, follow::Followed};

/// Frames whose markers are compared.
const FRAMES: usize = 8;
/// Reprojection beyond which an observation is an outlier \[px\].
const OUTLIER_PX: f64 = 8.0;
/// Largest shift of the image's corner that is tried, against its distance from the middle.
const MOST: f64 = 0.25;
/// Steps tried from none to the most, to either side.
const STEPS: i32 = 25;
/// What the residual must fall to for the term to count, of what it is.
const FALLS_TO: f64 = 0.8;
/// Shift of the corner that matters, against its distance from the middle: below a hundredth other errors are larger.
const MATTERS: f64 = 0.015;

/// The observations of a marker in one frame.
type Seen = Vec<(usize, DVec2)>;

/// The check `distortion`.
pub(crate) fn check(evidence: &mut Evidence) -> Outcome {
    let frames = FrameRange { start: 0, end: evidence.followed.iter().map(|f| f.change.len()).max().unwrap_or(0) };
    let observations = observations(evidence, frames);
    if observations.len() < 10 {
        return Outcome::unjudged("too few markers are followed in three views of known calibration and clock");
    }
    let rig = &evidence.mended;
    let given = rms(rig, &observations);
    let tried = (-STEPS..=STEPS).map(|k| MOST * f64::from(k) / f64::from(STEPS));
    let tried: Vec<(f64, f64)> = tried.map(|shift| (shift, rms(&bent(rig, shift), &observations))).collect();
    let Some(&(shift, best)) = tried.iter().min_by(|a, b| a.1.total_cmp(&b.1)) else {
        return Outcome::unjudged("nothing to compare");
    };
    let measured =
        format!("followed markers reproject to {given:.2} px; with the best further radial term {best:.2} px");
    let mut findings = Vec::new();
    let mended = (best < FALLS_TO * given && shift.abs() >= MATTERS).then(|| bent(rig, shift));
    if mended.is_some() {
        let (k1, corner) = in_numbers(&rig.cameras[0], shift);
        let fact = format!(
            "one radial term more lets the markers agree: {given:.2} px fall to {best:.2} px with k1 = {k1:+.3} in all views, which moves the corner of the image by {corner:.0} px"
        );
        let has = rig.cameras.iter().any(|camera| camera.distortion != Distortion::None);
        let hint = if has {
            "the distortion given is not that of this footage: is it of another lens, another image size, or of footage that was undistorted?"
        } else {
            "the footage is distorted and the calibration says it is not: give the distortion, or undistort the footage"
        };
        let fault = if has { "distortion-other" } else { "distortion-missing" };
        findings.push(
            Finding::look(fault, "all views", fact)
                .suffers("hull, lift: rays go astray towards the image's border, where the hair ends")
                .hint(hint),
        );
    }
    evidence.mended = mended.unwrap_or_else(|| evidence.mended.clone());
    Outcome::of(measured, findings)
}

/// Markers in a few frames, seen by three views or more that are in time.
fn observations(evidence: &Evidence, frames: FrameRange) -> Vec<Seen> {
    let views: Vec<usize> = (0..evidence.views.len())
        .filter(|view| !evidence.distrusted.contains(view) && !evidence.out_of_time.contains(view))
        .collect();
    let step = frames.len().div_ceil(FRAMES).max(1);
    let at = |view: usize, marker: usize, frame: usize| {
        let followed: &Followed = evidence.followed.get(view)?;
        followed.tracks.get(&marker)?.get(frame).copied().flatten()
    };
    let mut all = Vec::new();
    for frame in (frames.start..frames.end).step_by(step) {
        for marker in 0..evidence.labels.len() {
            let seen: Seen = views.iter().filter_map(|&view| Some((view, at(view, marker, frame)?))).collect();
            if seen.len() >= 3 {
                all.push(seen);
            }
        }
    }
    all
}

/// Root mean square reprojection of the observations, each at most an outlier's \[px\].
fn rms(rig: &Rig, observations: &[Seen]) -> f64 {
    let (mut sum, mut count) = (0.0, 0usize);
    for seen in observations {
        let all: Vec<(&Camera, DVec2)> = seen.iter().map(|&(view, at)| (&rig.cameras[view], at)).collect();
        let point = triangulate(&all, OUTLIER_PX).map(|t| t.point);
        for (camera, at) in &all {
            let off = point.and_then(|point| project(camera, point)).map_or(OUTLIER_PX, |p| p.distance(*at));
            sum += off.min(OUTLIER_PX).powi(2);
            count += 1;
        }
    }
    (sum / count.max(1) as f64).sqrt()
}

/// The rig with a radial term more in all views, which shifts the corner of each image by a share of its distance.
fn bent(rig: &Rig, shift: f64) -> Rig {
    let bend = |camera: &Camera| {
        let k1 = in_numbers(camera, shift).0;
        let mut bent = camera.clone();
        match &mut bent.distortion {
            Distortion::None => bent.distortion = Distortion::BrownConrady([k1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
            Distortion::BrownConrady(terms) => terms[0] += k1,
            Distortion::Tilted(terms) => terms[0] += k1,
            Distortion::Polynomial(lens) => lens.radial[0] += k1,
            // One angle is the whole lens: there is no term to miss.
            Distortion::Fov(_) => {}
        }
        bent
    };
    Rig { cameras: rig.cameras.iter().map(bend).collect() }
}

/// k1, and the shift of the corner \[px\], of a shift given as a share of the corner's distance.
fn in_numbers(camera: &Camera, shift: f64) -> (f64, f64) {
    let half = DVec2::new(camera.width as f64, camera.height as f64) * 0.5;
    let corner = DVec2::new(half.x / camera.focal[0], half.y / camera.focal[1]);
    (shift / corner.length_squared(), shift.abs() * half.length())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::labels::tests::{labels, rig};

    #[test]
    fn a_missing_term_is_found_by_its_fall() {
        let bent_rig = bent(&rig(), -0.1);
        let points = |rig: &Rig| {
            let agreement = crate::labels::Agreement::of(&super::tests::rig(), &labels(), 2.5);
            let seen = |point: glam::DVec3| {
                let far = point * 1.6;
                rig.cameras.iter().enumerate().map(|(v, c)| (v, project(c, far).unwrap())).collect::<Seen>()
            };
            agreement.points.into_iter().flatten().map(seen).collect::<Vec<_>>()
        };
        let observed = points(&bent_rig);
        assert!(rms(&rig(), &observed) > 0.2 && rms(&bent_rig, &observed) < 1e-6);
        assert!(rms(&rig(), &points(&rig())) < 1e-6);
        assert!((in_numbers(&rig().cameras[0], 0.1).1 - 40.0).abs() < 1e-9);
    }
}
