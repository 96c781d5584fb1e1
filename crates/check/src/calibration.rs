//! Labelled markers, and what they say of the calibration.

use glam::{DMat3, DVec3};
use strandflow_core::Rig;

use crate::{
    Evidence, Finding, Outcome,
    labels::{Agreement, Label, Residual},
    repair::{Mend, Repair, best_mend},
    turn::{Seen, Turn, sightings, turn_of},
};

/// Fewest markers a pose rests on, each in two views or more; `run` refuses fewer.
pub(crate) const MARKERS_NEEDED: usize = strandflow_engine::sources::MARKERS_NEEDED;
/// Thickness of the markers' cloud against its length below which they lie on a line: turning about it is not seen.
const LINE: f64 = 0.05;

/// The check `markers`.
pub(crate) fn markers(evidence: &mut Evidence) -> Outcome {
    let usable = evidence.labels.iter().filter(|label| label.views.len() >= 2).count();
    let labels: usize = evidence.labels.iter().map(|label| label.views.len()).sum();
    let mean = labels as f64 / evidence.labels.len().max(1) as f64;
    let measured = format!("{usable} markers in two views or more, each in {mean:.1} views on average");
    let mut findings = Vec::new();
    if usable < MARKERS_NEEDED {
        let fact = format!("{usable} markers are labelled in two or more views, at least {MARKERS_NEEDED} are needed");
        let hint = "label more markers in one frame of the take, each in every view that sees it";
        findings
            .push(Finding::cannot("few-markers", "labels", fact).suffers("pose: no head pose in any frame").hint(hint));
    }
    let blind: Vec<usize> = (0..evidence.views.len())
        .filter(|view| !evidence.views[*view].held_out && !evidence.labels.iter().any(|l| l.views.contains_key(view)))
        .collect();
    if usable >= MARKERS_NEEDED && !blind.is_empty() {
        let place = format!("view {}", evidence.names(&blind));
        let finding = Finding::look("unlabelled-view", place, "no marker is labelled in it")
            .suffers("pose: the view does not help, and nothing here tells whether it is calibrated or in time")
            .hint(format!("label the markers that it sees in frame {}", evidence.labelled));
        findings.push(finding);
    }
    Outcome::of(measured, findings)
}

/// Mends at most: every view could have a mistake of its own, but then none is left to judge the others by.
const MOST_MENDS: usize = 4;
/// Fewest labels a view is judged by.
const JUDGED: usize = 3;

/// The check `calibration`: mends the rig as far as it can, names what it did, and what is left.
pub(crate) fn calibration(evidence: &mut Evidence) -> Outcome {
    let tolerance = evidence.label_tolerance();
    let labels = evidence.labels.clone();
    let judged = labels.iter().filter(|label| label.views.len() >= JUDGED).count();
    if judged == 0 {
        return Outcome::unjudged("no marker is labelled in three views: nothing tells whether the cameras agree");
    }
    let given = Agreement::of(&evidence.mended, &labels, tolerance);
    let measured = in_words(evidence, &given);
    let mut findings = Vec::new();
    let (mut now, mut rig) = (given, evidence.mended.clone());
    for _ in 0..MOST_MENDS {
        let Some(mended) = best_mend(&rig, &labels, &now) else { break };
        findings.push(of_mend(evidence, &mended.mend, &now, &mended.agreement));
        // The true principal point is not the middle.
        if let Mend::Repair(Repair::CentrePrincipal, views) = &mended.mend {
            evidence.mended_roughly.extend(views);
        }
        (now, rig) = (mended.agreement, mended.rig);
    }
    let wrong = now.disagreeing(rig.view_count());
    findings.extend(unexplained(evidence, &rig, &wrong, &now));
    findings.extend(of_labels(evidence, &rig, &labels, &now));
    findings.extend(on_a_line(&now.sure_points()));
    evidence.mended = rig;
    evidence.distrusted = wrong;
    Outcome::of(measured, findings)
}

fn in_words(evidence: &Evidence, agreement: &Agreement) -> String {
    let Some(median) = agreement.median() else { return "no label can be compared with others".into() };
    let views = 0..evidence.views.len();
    let worst = views.filter_map(|view| Some((agreement.median_of(view)?, view))).max_by(|a, b| a.0.total_cmp(&b.0));
    let worst = worst.map_or_else(String::new, |(px, view)| format!(", worst view {} {px:.2} px", evidence.name(view)));
    format!("labels reproject to {median:.2} px (median){worst}; {:.0} % agree", 100.0 * agreement.share())
}

fn of_mend(evidence: &Evidence, mend: &Mend, before: &Agreement, after: &Agreement) -> Finding {
    let views = mend.views();
    let over = |agreement: &Agreement| {
        let all = agreement.residuals.iter().filter(|r| views.contains(&r.view)).map(|r| r.px);
        crate::labels::median(all).map_or_else(|| "nothing to compare with".to_owned(), px)
    };
    let fall = format!("labels reproject to {} as given, to {} when mended", over(before), over(after));
    let place = match views.len() {
        n if n == evidence.views.len() => "all views".into(),
        _ => format!("view {}", evidence.names(&views)),
    };
    let suffers = "hull: volume is carved away where it is; pose and lines follow";
    let finding = match mend {
        Mend::Exchange(..) => Finding::cannot(
            "swapped-views",
            place,
            format!("the cameras of these views are exchanged: {fall}"),
        )
        .hint(
            "exchange their sources (with plate, labels and masks) in the manifest, or their names in the calibration",
        ),
        Mend::Repair(repair, _) => {
            let (fact, hint) = repair.in_words();
            Finding::cannot(repair.fault(), place, format!("{fact}: {fall}")).hint(hint)
        }
    };
    evidence.unless_held_out(&views, finding.suffers(suffers))
}

/// Pixels in words.
fn px(value: f64) -> String {
    match value {
        v if !v.is_finite() => "nowhere".into(),
        v if v < 100.0 => format!("{v:.2} px"),
        v => format!("{v:.0} px"),
    }
}

/// Views that disagree and that no repair mends.
fn unexplained(evidence: &Evidence, rig: &Rig, wrong: &[usize], now: &Agreement) -> Vec<Finding> {
    let is_used = |view: &usize| !evidence.views[*view].held_out;
    let used = (0..evidence.views.len()).filter(is_used).count();
    if wrong.iter().filter(|view| is_used(view)).count() * 2 > used {
        let fact = format!(
            "{:.0} % of the labels agree within {:.1} px, and no repair that was tried mends it",
            100.0 * now.share(),
            2.0 * now.tolerance
        );
        let hint = "check which camera is which, world-to-camera direction, units and image size; then calibrate again";
        return vec![
            Finding::cannot("views-disagree", "all views", fact)
                .suffers("hull: silhouettes share no volume")
                .hint(hint),
        ];
    }
    let one = |&view: &usize| {
        let fact = format!(
            "{:.0} % of its labels agree with the other views; they reproject to {}",
            100.0 * now.share_of(view),
            px(now.median_of(view).unwrap_or(f64::INFINITY))
        ) + &turned(evidence, rig, view, now.tolerance);
        Finding::look("view-off", format!("view {}", evidence.name(view)), fact)
            .suffers("hull, lift: the view carves and triangulates beside the subject")
            .hint("was the camera touched after the calibration? Calibrate it again, hold it out, or leave it out; or its labels are wrong")
    };
    wrong.iter().map(one).collect()
}

/// What is said of a view that a turn lets agree.
fn turned(evidence: &Evidence, rig: &Rig, view: usize, tolerance: f64) -> String {
    let seen = |(marker, label): (usize, &Label)| Seen { marker, views: label.views.clone() };
    let seen: Vec<Seen> = evidence.labels.iter().enumerate().map(seen).collect();
    let sightings = sightings(rig, view, &seen, tolerance);
    let turn = turn_of(&rig.cameras[view], &sightings, 2.0 * tolerance).filter(Turn::is_sure);
    turn.map_or_else(String::new, |turn| format!("; {}", turn.in_words()))
}

/// Labels that disagree in views that agree: two that are exchanged, or one that was clicked wrong.
fn of_labels(evidence: &Evidence, rig: &Rig, labels: &[Label], now: &Agreement) -> Vec<Finding> {
    let mut left = now.outliers(rig.view_count());
    let mut findings = Vec::new();
    while let Some((a, b)) = exchanged(rig, labels, now.tolerance, &left) {
        let view = a.view;
        let ids = (labels[b.marker].id, labels[a.marker].id);
        let fact =
            format!("the labels of markers {} and {} are exchanged: {} and {} off", ids.0, ids.1, px(b.px), px(a.px));
        findings.push(
            Finding::look("swapped-labels", format!("view {}", evidence.name(view)), fact)
                .suffers("pose: both markers are lost to this view")
                .hint("exchange the two in the file of marker labels"),
        );
        left.retain(|r| r.view != view || (r.marker != a.marker && r.marker != b.marker));
    }
    findings.extend(left.iter().map(|r| {
        let fact = format!("marker {} lies {} from where the other views see it", labels[r.marker].id, px(r.px));
        Finding::look("label-off", format!("view {}", evidence.name(r.view)), fact)
            .suffers("pose: the marker is lost to this view")
            .hint(format!("look at the marker in frame {}, and label it again, or leave it out", evidence.labelled))
    }));
    findings
}

/// The first two outliers of one view that agree when exchanged.
fn exchanged(rig: &Rig, labels: &[Label], tolerance: f64, outliers: &[Residual]) -> Option<(Residual, Residual)> {
    for (i, a) in outliers.iter().enumerate() {
        for b in outliers[..i].iter().filter(|b| b.view == a.view) {
            let mut tried = vec![labels[a.marker].clone(), labels[b.marker].clone()];
            let (at, other) = (tried[0].views[&a.view], tried[1].views[&a.view]);
            tried[0].views.insert(a.view, other);
            tried[1].views.insert(a.view, at);
            if Agreement::of(rig, &tried, tolerance).share() == 1.0 {
                return Some((*a, *b));
            }
        }
    }
    None
}

/// Markers on a line do not fix a pose.
fn on_a_line(points: &[DVec3]) -> Vec<Finding> {
    if points.len() < MARKERS_NEEDED {
        return Vec::new();
    }
    let (length, breadth) = length_and_breadth(points);
    if breadth >= LINE * length {
        return Vec::new();
    }
    let fact = format!("the markers lie on a line: {length:.0} mm long, {breadth:.1} mm broad");
    vec![
        Finding::cannot("markers-on-a-line", "labels", fact)
            .suffers("pose: the head's turn about that line is not seen")
            .hint("label markers all over the upper head"),
    ]
}

/// Standard deviations along the longest axis of a cloud and across it.
fn length_and_breadth(points: &[DVec3]) -> (f64, f64) {
    let middle = points.iter().sum::<DVec3>() / points.len() as f64;
    let outer = |d: DVec3| DMat3::from_cols(d * d.x, d * d.y, d * d.z);
    let spread = points.iter().fold(DMat3::ZERO, |sum, p| sum + outer(*p - middle)) * (1.0 / points.len() as f64);
    // Power iteration: the clouds that matter are long, and then it converges at once.
    let mut axis = DVec3::new(0.61, 0.59, 0.53);
    for _ in 0..100 {
        axis = (spread * axis).normalize_or(axis);
    }
    let along = axis.dot(spread * axis);
    let trace = spread.x_axis.x + spread.y_axis.y + spread.z_axis.z;
    (along.max(0.0).sqrt(), (trace - along).max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::labels::tests::{labels, rig};

    #[test]
    fn exchanged_labels_are_told_from_a_wrong_click() {
        let mut swapped = labels();
        let (a, b) = (swapped[2].views[&3], swapped[6].views[&3]);
        swapped[2].views.insert(3, b);
        swapped[6].views.insert(3, a);
        let outliers = Agreement::of(&rig(), &swapped, 2.5).outliers(6);
        let (a, b) = exchanged(&rig(), &swapped, 2.5, &outliers).unwrap();
        assert_eq!((a.marker, b.marker, a.view), (6, 2, 3));
        let mut clicked = labels();
        clicked[2].views.get_mut(&3).unwrap().x += 30.0;
        clicked[5].views.get_mut(&3).unwrap().y -= 20.0;
        let outliers = Agreement::of(&rig(), &clicked, 2.5).outliers(6);
        assert_eq!((outliers.len(), exchanged(&rig(), &clicked, 2.5, &outliers)), (2, None));
    }

    #[test]
    fn a_line_is_told_from_a_cloud() {
        let line: Vec<_> = (0..6).map(|i| DVec3::new(i as f64 * 20.0, (i % 2) as f64, 3.0)).collect();
        assert_eq!(on_a_line(&line)[0].fault, "markers-on-a-line");
        let cloud: Vec<_> = (0..6).map(|i| DVec3::new(i as f64 * 20.0, (i % 3) as f64 * 30.0, 3.0)).collect();
        assert!(on_a_line(&cloud).is_empty());
    }
}
