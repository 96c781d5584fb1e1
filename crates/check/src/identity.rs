//! The check `identity`: whether footage, plate and labels of a name are of one camera.

use std::sync::Arc;

use rayon::prelude::*;
use strandflow_core::RgbImage;
use strandflow_image::{blob::Blob, colour::luma_of};

use crate::{Evidence, Finding, Outcome, labels::median};

/// Share of a view's labels that must lie on something that stands out like a marker.
const ON_MARKERS: f64 = 0.5;
/// By how much more of the labels must be met when two views' footage is exchanged.
const MORE: f64 = 0.3;
/// Median difference in luma between footage and plate at the image's border above which they are not of one camera or
/// light \[codes\]: noise is 3, a lamp that drifts 10.
const OTHER_PLATE: f64 = 20.0;

/// The check `identity`.
pub(crate) fn check(evidence: &mut Evidence) -> Outcome {
    let labelled: Vec<Option<Arc<RgbImage>>> =
        (0..evidence.views.len()).into_par_iter().map(|view| evidence.image(view, evidence.labelled)).collect();
    let met = met_labels(evidence, &labelled);
    let apart = plates_apart(evidence, &labelled);
    let own = |table: &[Vec<Option<f64>>]| (0..table.len()).filter_map(|v| table[v][v]).collect::<Vec<f64>>();
    let (labels, plates) = (own(&met), own(&apart));
    if labels.is_empty() && plates.is_empty() {
        return Outcome::unjudged("no view has footage with labels or a plate");
    }
    let lowest = labels.iter().copied().fold(1.0, f64::min);
    let farthest = plates.iter().copied().fold(0.0, f64::max);
    let measured = format!(
        "at least {:.0} % of a view's labels lie on markers; plates within {farthest:.0} codes of the footage's border",
        100.0 * lowest
    );
    let mut findings = Vec::new();
    let pairs = exchanged(&met, &apart);
    for &(a, b) in &pairs {
        let share = |v: usize, w: usize| met[v][w].map_or_else(|| "?".into(), |s| format!("{:.0} %", 100.0 * s));
        let fact = format!(
            "their footage is exchanged: {} and {} of their labels lie on markers, exchanged {} and {}",
            share(a, a),
            share(b, b),
            share(a, b),
            share(b, a)
        );
        findings.push(
            Finding::cannot("swapped-footage", format!("view {}", evidence.names(&[a, b])), fact)
                .suffers("masks, hull: each is compared with the other's plate and carves with the other's camera")
                .hint("exchange the two sources in the manifest"),
        );
    }
    // What comes after looks at the clips as they belong.
    for &(a, b) in &pairs {
        let (head, tail) = evidence.views.split_at_mut(b);
        std::mem::swap(&mut head[a].source, &mut tail[0].source);
        std::mem::swap(&mut head[a].info, &mut tail[0].info);
    }
    let explained = |view: usize| pairs.iter().any(|&(a, b)| a == view || b == view);
    for view in (0..met.len()).filter(|&view| !explained(view)) {
        let place = format!("view {}", evidence.name(view));
        if met[view][view].is_some_and(|share| share < ON_MARKERS) {
            let share = 100.0 * met[view][view].unwrap_or(0.0);
            findings.push(
                Finding::look(
                    "labels-off-markers",
                    place.clone(),
                    format!("{share:.0} % of its labels lie on something like a marker"),
                )
                .suffers("pose: the view's markers are not followed")
                .hint(
                    "are the labels of this clip and of this frame, and is pose.marker_radius_px the markers' radius?",
                ),
            );
        }
        if apart[view][view].is_some_and(|codes| codes > OTHER_PLATE) {
            let codes = apart[view][view].unwrap_or(0.0);
            findings.push(
                Finding::look(
                    "other-plate",
                    place,
                    format!("at the image's border plate and footage differ by {codes:.0} of 255 codes"),
                )
                .suffers("masks: background is taken for subject")
                .hint("is it this camera's plate, taken with the same light, exposure and position?"),
            );
        }
    }
    Outcome::of(measured, findings)
}

/// Share of the labels of one view (column) that lie on markers in the footage of another (row).
fn met_labels(evidence: &Evidence, images: &[Option<Arc<RgbImage>>]) -> Vec<Vec<Option<f64>>> {
    let views = evidence.views.len();
    let radius = evidence.settings.pose.marker_radius_px;
    let of = |footage: usize, labels: usize| {
        let image = images[footage].as_ref()?;
        let points: Vec<_> = evidence.labels.iter().filter_map(|label| label.views.get(&labels).copied()).collect();
        let on_marker = |&&at: &&glam::DVec2| {
            let blob = Blob::learn(image, at, radius);
            blob.is_some_and(|blob| {
                let centre = blob.centroid(image, at);
                centre.distance(at) <= 0.6 * radius && blob.score(image, centre) > 0.35
            })
        };
        let met = points.iter().filter(on_marker).count();
        (points.len() >= 3).then(|| met as f64 / points.len() as f64)
    };
    (0..views).into_par_iter().map(|v| (0..views).map(|w| of(v, w)).collect()).collect()
}

/// Median difference in luma between the border of one view's footage (row) and of another's plate (column) \[codes\].
fn plates_apart(evidence: &Evidence, images: &[Option<Arc<RgbImage>>]) -> Vec<Vec<Option<f64>>> {
    let views = evidence.views.len();
    let of = |footage: usize, plate: usize| {
        let (image, plate) = (images[footage].as_ref()?, evidence.views[plate].plate.as_ref()?);
        ((image.width, image.height) == (plate.width, plate.height)).then_some(())?;
        let (w, h) = (image.width, image.height);
        // A tenth at the top and at both sides: the subject rarely reaches there.
        let (mx, my) = (w / 10, h / 10);
        let border = (0..h).step_by(2).flat_map(|y| (0..w).map(move |x| (x, y)));
        let border = border.filter(|&(x, y)| y < my || x < mx || x + mx >= w);
        median(border.map(|at| f64::from((luma_of(image[at]) - luma_of(plate[at])).abs())))
    };
    (0..views).into_par_iter().map(|v| (0..views).map(|w| of(v, w)).collect()).collect()
}

/// Pairs of views whose footage is exchanged: labels are met clearly better that way, and plates do not speak against it.
fn exchanged(met: &[Vec<Option<f64>>], apart: &[Vec<Option<f64>>]) -> Vec<(usize, usize)> {
    let both = |table: &[Vec<Option<f64>>], (a, b): (usize, usize)| Some(0.5 * (table[a][b]? + table[b][a]?));
    let own = |table: &[Vec<Option<f64>>], (a, b): (usize, usize)| Some(0.5 * (table[a][a]? + table[b][b]?));
    let better = |pair: (usize, usize)| {
        let labels = both(met, pair).zip(own(met, pair)).map_or(0.0, |(exchanged, given)| exchanged - given);
        let plates = both(apart, pair).zip(own(apart, pair)).map_or(0.0, |(exchanged, given)| given - exchanged);
        (labels > MORE && plates > -OTHER_PLATE).then_some(labels)
    };
    let pairs = (0..met.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
    let mut found: Vec<((usize, usize), f64)> = pairs.filter_map(|pair| Some((pair, better(pair)?))).collect();
    found.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut chosen: Vec<(usize, usize)> = Vec::new();
    for (pair, _) in found {
        if chosen.iter().all(|&(a, b)| ![a, b].contains(&pair.0) && ![a, b].contains(&pair.1)) {
            chosen.push(pair);
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exchanged_footage_is_found_by_labels() {
        let table = |rows: [[f64; 3]; 3]| rows.map(|row| row.map(Some).to_vec()).to_vec();
        let plates = table([[3.0, 40.0, 40.0], [40.0, 3.0, 40.0], [40.0, 40.0, 3.0]]);
        let sound = table([[1.0, 0.1, 0.3], [0.2, 0.9, 0.0], [0.1, 0.2, 1.0]]);
        assert!(exchanged(&sound, &plates).is_empty());
        let swapped = table([[0.1, 0.2, 0.9], [0.2, 0.9, 0.0], [1.0, 0.2, 0.1]]);
        let swapped_plates = table([[40.0, 40.0, 3.0], [40.0, 3.0, 40.0], [3.0, 40.0, 40.0]]);
        assert_eq!(exchanged(&swapped, &swapped_plates), [(0, 2)]);
        assert!(exchanged(&swapped, &plates).is_empty());
    }
}
