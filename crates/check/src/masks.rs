//! The checks `masks` and `hull`: subject masks of a few frames, by themselves and against one another.

use strandflow_core::{FrameRange, Mask, Place, Report};
use strandflow_stages::{
    Mode,
    masks::{MasksInput, masks},
};

use crate::{
    Evidence, Finding, Outcome,
    evidence::Sampled,
    silhouettes::{self, Blame, Moment, blame},
};

/// Frames whose masks are made: the first, in which masks are given, one in the middle, the last.
fn sampled(frames: FrameRange) -> Vec<usize> {
    let mut all = vec![frames.start, frames.start + frames.len() / 2, frames.end.saturating_sub(1)];
    all.dedup();
    all.retain(|&frame| frames.contains(frame));
    all
}

/// Share of the subject that an enclosed part of the background may have: between locks one sees through.
const HOLE: f64 = 0.01;
/// Share of the given hair that may lie outside the subject: both borders are a pixel or two off.
const OUTSIDE: f64 = 0.15;

/// The check `masks`: makes the subject masks that later checks look at.
pub(crate) fn check(evidence: &mut Evidence) -> Outcome {
    let mut findings = Vec::new();
    let (mut largest_hole, mut outside, mut area) = (0.0f64, 0.0f64, Vec::new());
    for view in 0..evidence.views.len() {
        for frame in sampled(evidence.frames) {
            let mut report = Report::default();
            let Some(subject) = subject(evidence, view, frame, &mut report) else { continue };
            let place = format!("view {}, frame {frame}", evidence.name(view));
            let covered = subject.data.iter().filter(|&&m| m >= 128).count();
            area.push(covered as f64 / subject.data.len().max(1) as f64);
            let first = frame == evidence.frames.start;
            if covered == 0 {
                if !findings.iter().any(|f: &Finding| {
                    f.fault == "no-subject" && f.place.starts_with(&format!("view {},", evidence.name(view)))
                }) {
                    findings.push(no_subject(&place));
                }
            } else {
                let hole = silhouettes::holes(&subject).first().copied().unwrap_or(0) as f64 / covered as f64;
                largest_hole = largest_hole.max(hole);
                if hole > HOLE && !said(&findings, "mask-hole", evidence.name(view)) {
                    findings.push(of_hole(&place, hole));
                }
                findings.extend(report.findings.iter().filter(|f| f.consequence.contains("person") && first).map(
                    |f| {
                        Finding::look("another-part", place.clone(), f.fact.clone())
                            .suffers("masks: the part without hair is taken for another person and left out")
                            .hint("if it belongs to the subject, paint the subject mask of this frame")
                    },
                ));
                if let Some(share) =
                    evidence.views[view].hair.as_ref().filter(|_| first).map(|hair| share_outside(hair, &subject))
                {
                    outside = outside.max(share);
                    if share > OUTSIDE {
                        findings.push(of_outside(&place, share));
                    }
                }
            }
            evidence.sampled.push(Sampled { view, frame, subject });
        }
    }
    if area.is_empty() {
        return Outcome::unjudged("no view has footage, plate and hair mask of one size");
    }
    let mean = area.iter().sum::<f64>() / area.len() as f64;
    let measured = format!(
        "subjects cover {:.0} % of the image; holes up to {:.1} %, given hair outside the subject up to {:.0} %",
        100.0 * mean,
        100.0 * largest_hole,
        100.0 * outside
    );
    Outcome::of(measured, findings)
}

fn said(findings: &[Finding], fault: &str, view: &str) -> bool {
    findings.iter().any(|f| f.fault == fault && f.place.starts_with(&format!("view {view},")))
}

/// The subject mask as stage `masks` makes it, or as it is given.
fn subject(evidence: &Evidence, view: usize, frame: usize, report: &mut Report) -> Option<Mask> {
    let seen = &evidence.views[view];
    let image = evidence.image(view, frame)?;
    let (plate, key) = (seen.plate.as_ref()?, seen.hair.as_ref()?);
    let given = seen.given_subject(frame);
    let first = frame == evidence.frames.start;
    let input = MasksInput {
        place: Place::view_frame(&seen.name, frame),
        image: &image,
        plate,
        given_subject: given.as_ref(),
        given_hair: Some(key).filter(|_| first),
        neighbour: None,
        key: Some(key),
        look: None,
        edge: None,
    };
    masks(&input, Mode::Paper, &evidence.settings.masks, report).ok().map(|masks| masks.subject)
}

/// Share of the hair that lies outside the subject.
fn share_outside(hair: &Mask, subject: &Mask) -> f64 {
    let all = hair.data.iter().filter(|&&m| m >= 128).count();
    let out = hair.data.iter().zip(&subject.data).filter(|(h, s)| **h >= 128 && **s < 64).count();
    out as f64 / all.max(1) as f64
}

fn no_subject(place: &str) -> Finding {
    Finding::cannot("no-subject", place, "nothing differs from the clean plate: the view shows no subject")
        .suffers("hull: an empty mask empties the hull of the frame")
        .hint("is it the right clip, and the right plate? Leave the view out, or take the frames in which it shows the subject")
}

fn of_hole(place: &str, share: f64) -> Finding {
    Finding::look("mask-hole", place, format!("the subject mask has a hole of {:.1} % of the subject", 100.0 * share))
        .suffers("hull: a tunnel is carved through the head, and hair on both sides of it is lost")
        .hint("was the subject in the clean plate, or is it of the plate's colour there? Take the plate anew, or paint this mask")
}

fn of_outside(place: &str, share: f64) -> Finding {
    let fact = format!("{:.0} % of the given hair mask lies where nothing differs from the clean plate", 100.0 * share);
    Finding::look("hair-outside-subject", place, fact)
        .suffers("masks: hair is looked for within the subject; what is learnt of its look is the background's")
        .hint("are hair mask, plate and footage of one view? Look at all three")
}

/// The check `hull`: whether the silhouettes fit together.
pub(crate) fn hull(evidence: &mut Evidence) -> Outcome {
    let part: Vec<usize> = (0..evidence.views.len())
        .filter(|&view| !evidence.views[view].held_out && !evidence.distrusted.contains(&view) && evidence.fits(view))
        .collect();
    let moments = moments(evidence, &part);
    if part.len() < 3 || moments.is_empty() {
        return Outcome::unjudged("needs subject masks of three views of known calibration");
    }
    let settings = silhouettes::coarse(&evidence.settings.hull);
    let grid = match silhouettes::grid(&moments, &settings) {
        Ok(grid) => grid,
        Err(error) => return Outcome::of("the silhouettes share no volume", vec![of_error(&error)]),
    };
    let mut findings: Vec<Finding> = Vec::new();
    let mut worst = (0.0f64, 0usize, 0usize);
    for moment in &moments {
        let filled = match silhouettes::filled(moment, &grid, &settings) {
            Ok(filled) => filled,
            Err(error) => {
                if !findings.iter().any(|finding| finding.fault == "hull-empty") {
                    findings.push(of_error(&error));
                }
                continue;
            }
        };
        for (at, &share) in filled.empty.iter().enumerate() {
            if share >= worst.0 {
                worst = (share, part[at], moment.frame);
            }
        }
        let found = blame(&filled).map(|blame| of_blame(evidence, &part, moment.frame, &blame));
        let new = found.filter(|new| !findings.iter().any(|f| f.fault == new.fault && view_of(f) == view_of(new)));
        findings.extend(new);
    }
    // Where a view is to blame in one frame, what has no culprit in another is most likely its work.
    if findings.iter().any(|finding| finding.fault != "silhouettes-disagree") {
        findings.retain(|finding| finding.fault != "silhouettes-disagree");
    }
    evidence.hull = silhouettes::whole(&moments[0], &grid, &settings).ok();
    let measured = format!(
        "the hull of frames {} fills the masks but for {:.1} % at worst (view {}, frame {})",
        moments.iter().map(|m| m.frame.to_string()).collect::<Vec<_>>().join(", "),
        100.0 * worst.0,
        evidence.name(worst.1),
        worst.2
    );
    Outcome::of(measured, findings)
}

fn view_of(finding: &Finding) -> &str {
    finding.place.split(',').next().unwrap_or_default()
}

/// The moments of which every view that takes part has a mask that is not empty.
fn moments(evidence: &Evidence, part: &[usize]) -> Vec<Moment> {
    let rig = strandflow_core::Rig { cameras: part.iter().map(|&v| evidence.mended.cameras[v].clone()).collect() };
    let of = |frame: usize| {
        let mask = |view: &usize| {
            let sampled = evidence.sampled.iter().find(|s| s.view == *view && s.frame == frame)?;
            Some(sampled.subject.clone())
        };
        let subjects: Option<Vec<Mask>> = part.iter().map(mask).collect();
        Some(Moment { frame, rig: rig.clone(), subjects: subjects? })
    };
    sampled(evidence.frames).into_iter().filter_map(of).collect()
}

fn of_error(error: &strandflow_stages::StageError) -> Finding {
    Finding::cannot("hull-empty", "masks", error.to_string())
        .suffers("hull: no volume, and no strand in these frames")
        .hint(error.hint())
}

fn of_blame(evidence: &Evidence, part: &[usize], frame: usize, blame: &Blame) -> Finding {
    let place = |at: usize| format!("view {}, frame {frame}", evidence.name(part[at]));
    match *blame {
        Blame::Leak(at, share, px) => {
            let fact = format!(
                "{:.1} % of its subject mask is where the other views see nothing (largest part {px} px)",
                100.0 * share
            );
            Finding::look("mask-leak", place(at), fact)
                .suffers("masks: background is taken for subject; the hull is not harmed while another view carves it")
                .hint("did light or furniture change after the clean plate? Paint this mask, or take the plate anew")
        }
        Blame::Cut(at, share, losers) => {
            let fact = format!(
                "its mask costs {losers} other views {:.1} % of theirs: what they show is outside it",
                100.0 * share
            );
            Finding::look("mask-cut", place(at), fact).suffers("hull: head or hair is carved away").hint(
                "look at this view's subject mask and plate; where they are right, at its calibration and its clock",
            )
        }
        Blame::Several(share) => {
            let fact = format!(
                "the hull leaves up to {:.1} % of several masks empty, and no single view is to blame",
                100.0 * share
            );
            Finding::look("silhouettes-disagree", format!("frame {frame}"), fact)
                .suffers("hull: head or hair is carved away")
                .hint("calibration errors of a few pixels, or clocks that drift; look at what the other checks say")
        }
    }
}
