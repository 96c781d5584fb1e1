//! The table of checks, in the order in which they are made: each may rest on those before it.

use serde::Serialize;

use crate::{
    Evidence, Finding, Outcome, Verdict, calibration, conventions, cost, coverage, epipolar, files, footage, identity,
    lens, masks, time,
};

/// One check.
pub struct Check {
    /// Its name.
    pub name: &'static str,
    /// What it looks at.
    pub looks_at: &'static str,
    /// The first stage it protects.
    pub protects: &'static str,
    /// Whether `run` makes it too: it decodes no image.
    pub quick: bool,
    /// Looks; may leave behind what later checks rest on.
    run: fn(&mut Evidence) -> Outcome,
}

/// What a check said.
#[derive(Clone, Debug, Serialize)]
pub struct Said {
    /// The check.
    pub check: &'static str,
    /// The first stage it protects.
    pub protects: &'static str,
    /// The gravest verdict.
    pub verdict: Verdict,
    /// What was measured, with numbers.
    pub measured: String,
    /// What is wrong.
    pub findings: Vec<Finding>,
}

macro_rules! checks {
    ($($name:literal, $looks_at:literal, $protects:literal, $quick:literal, $run:expr;)*) => {
        &[$(Check { name: $name, looks_at: $looks_at, protects: $protects, quick: $quick, run: $run }),*]
    };
}

/// All checks.
pub const CHECKS: &[Check] = checks! {
    "files", "footage, plates, labels and first hair masks are there, readable, of one size and length", "masks", true, files::check;
    "markers", "how many are labelled, in how many views, and whether they lie in space rather than on a line", "pose", true, calibration::markers;
    "calibration", "reprojection of the labelled markers, view by view and marker by marker; repairs that mend it", "hull", true, calibration::calibration;
    "epipolar", "pairs of views by the labelled markers that both see: a view that disagrees with the others, or was turned", "lift", true, epipolar::by_labels;
    "aim", "cameras look at the subject, and it lies in front of them", "hull", true, conventions::aim;
    "units", "distances of the cameras and of the markers", "hull", true, conventions::units;
    "lenses", "focal lengths and principal points for the image's size", "lift", true, conventions::lenses;
    "gravity", "its size, and its direction against the cameras' and the head's upright", "fit", true, conventions::gravity;
    "identity", "labels lie on markers in their footage, plates look like their footage: exchanged clips and plates", "masks", false, identity::check;
    "time", "markers followed in every view: delays between views, frames lost, frames shown twice", "lift", false, time::check;
    "distortion", "followed markers with one radial term more", "hull", false, lens::check;
    "followed", "pairs of views once more, by the followed markers", "lift", false, epipolar::by_followed;
    "masks", "subject masks of three frames: empty ones, holes, given hair outside the subject", "masks", false, masks::check;
    "hull", "the hull of these masks, drawn back into every view: leaks, cuts, views that empty it", "hull", false, masks::hull;
    "footage", "focus, exposure and brightness of the hair in every view's first frame", "orient", false, footage::check;
    "coverage", "directions the views look from, and how much of the subject three or more of them see", "lift", false, coverage::coverage;
    "resolution", "how much hair a pixel spans against the filters' wavelengths, and how well orientations agree", "orient", false, coverage::resolution;
    "cost", "voxels, memory, disk and time of a whole run; an estimate", "masks", false, cost::check;
};

/// The check that needs no calibration, and says why there is none.
const FIRST: &str = "files";

/// Makes all checks.
pub fn check(evidence: &mut Evidence) -> Vec<Said> {
    CHECKS.iter().map(|check| made(check, evidence)).collect()
}

/// Makes the checks up to the named one; all where there is none of that name.
pub fn check_to(evidence: &mut Evidence, last: &str) -> Vec<Said> {
    let count = CHECKS.iter().position(|check| check.name == last).map_or(CHECKS.len(), |at| at + 1);
    CHECKS[..count].iter().map(|check| made(check, evidence)).collect()
}

/// Makes the checks that decode no image.
pub fn check_quick(evidence: &mut Evidence) -> Vec<Said> {
    CHECKS.iter().filter(|check| check.quick).map(|check| made(check, evidence)).collect()
}

fn made(check: &Check, evidence: &mut Evidence) -> Said {
    let blind = evidence.mended.cameras.is_empty() && check.name != FIRST;
    let outcome = if blind { Outcome::unjudged("the calibration cannot be read") } else { (check.run)(evidence) };
    let (verdict, measured) = (outcome.verdict(), outcome.measured);
    let findings = said_once(outcome.findings, evidence.views.len());
    Said { check: check.name, protects: check.protects, verdict, measured, findings }
}

/// Findings that differ in the view only become one.
fn said_once(findings: Vec<Finding>, views: usize) -> Vec<Finding> {
    let mut once: Vec<(Finding, Vec<String>)> = Vec::new();
    for finding in findings {
        let view = finding.place.strip_prefix("view ").filter(|name| !name.contains([',', ' '])).map(str::to_owned);
        let same = once.iter_mut().find(|(other, names)| {
            (other.fault, &other.fact, &other.hint) == (finding.fault, &finding.fact, &finding.hint)
                && !names.is_empty()
                && view.is_some()
        });
        match (same, view) {
            (Some((_, names)), Some(view)) => names.push(view),
            (_, view) => once.push((finding, view.into_iter().collect())),
        }
    }
    let place = |(finding, names): (Finding, Vec<String>)| match names.len() {
        0 | 1 => finding,
        n if n == views => Finding { place: "all views".into(), ..finding },
        _ => Finding { place: format!("view {}", names.join(" and ")), ..finding },
    };
    once.into_iter().map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use strandflow_engine::stage_index;

    #[test]
    fn every_check_protects_a_stage() {
        assert!(CHECKS.iter().all(|check| stage_index(check.protects).is_ok()));
    }

    #[test]
    fn what_is_said_of_several_views_is_said_once() {
        let of = |view: &str, fact: &str| Finding::look("blurred", format!("view {view}"), fact);
        let places = |findings, views| said_once(findings, views).into_iter().map(|f| f.place).collect::<Vec<_>>();
        let found = vec![of("a", "x"), of("b", "y"), of("c", "x"), of("d", "x")];
        assert_eq!(places(found.clone(), 9), ["view a and c and d", "view b"]);
        assert_eq!(places(found.clone(), 3), ["all views", "view b"]);
        assert_eq!(places(vec![of("a, frame 3", "x"), of("b, frame 3", "x")], 2).len(), 2);
    }
}
