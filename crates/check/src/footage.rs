//! The check `footage`: focus, exposure and brightness of every view's hair in the first frame.

use rayon::prelude::*;
use strandflow_core::{Mask, RgbImage};
use strandflow_image::colour::luma_of;
use strandflow_stages::orient::{Footage, footage};

use crate::{Evidence, Finding, Outcome, labels::median};

/// Median luma of hair below which its texture drowns in noise and coding \[codes\].
const DARK: f64 = 10.0;
/// Ratio of brightness to that of the views' median from which on one lens or one lamp is another.
const UNLIKE: f64 = 2.5;
/// Share of the hair's texture energy that the median view has and this one lacks.
const SOFT: f32 = 0.4;

/// What one view shows.
struct Seen {
    view: usize,
    footage: Footage,
    luma: f64,
}

/// The check `footage`.
pub(crate) fn check(evidence: &mut Evidence) -> Outcome {
    let views: Vec<usize> = (0..evidence.views.len()).collect();
    let seen: Vec<Seen> = views.par_iter().filter_map(|&view| seen(evidence, view)).collect();
    if seen.is_empty() {
        return Outcome::unjudged("no view has footage and a hair mask of one size");
    }
    let usual = median(seen.iter().map(|s| s.luma)).unwrap_or(0.0);
    let sharpness: Vec<f64> = seen.iter().filter_map(|s| s.footage.sharpness.map(f64::from)).collect();
    let usual_sharpness = median(sharpness.iter().copied());
    let (low, high) = range(sharpness.iter().copied());
    let (dark, bright) = range(seen.iter().map(|s| s.luma));
    let burnt = seen.iter().map(|s| s.footage.overexposed).fold(0.0, f32::max);
    let measured = format!(
        "sharpness {low:.2} to {high:.2}; luma of hair {dark:.0} to {bright:.0}; overexposed up to {:.1} %",
        100.0 * burnt
    );
    let findings = seen.iter().flat_map(|s| of_view(evidence, s, usual, usual_sharpness)).collect();
    Outcome::of(measured, findings)
}

fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    if low.is_finite() { (low, high) } else { (0.0, 0.0) }
}

fn seen(evidence: &Evidence, view: usize) -> Option<Seen> {
    let frame = evidence.frames.start;
    let (image, hair) = (evidence.image(view, frame)?, evidence.views[view].hair.as_ref()?);
    let subject = evidence.sampled.iter().find(|s| s.view == view && s.frame == frame).map(|s| &s.subject)?;
    let sizes = [(hair.width, hair.height), (subject.width, subject.height)];
    if sizes.iter().any(|size| *size != (image.width, image.height)) {
        return None;
    }
    let footage = footage(&image, hair, subject, &evidence.settings.orient)?;
    Some(Seen { view, footage, luma: luma_of_hair(&image, hair)? })
}

fn luma_of_hair(image: &RgbImage, hair: &Mask) -> Option<f64> {
    let of_hair = image.data.iter().zip(&hair.data).filter(|(_, h)| **h >= 128);
    median(of_hair.map(|(c, _)| f64::from(luma_of(*c))))
}

fn of_view(evidence: &Evidence, seen: &Seen, usual: f64, usual_sharpness: Option<f64>) -> Vec<Finding> {
    let place = || format!("view {}", evidence.name(seen.view));
    let mut findings = Vec::new();
    if let Some(sharpness) = seen.footage.sharpness {
        let soft = usual_sharpness.is_some_and(|usual| sharpness < SOFT * usual as f32);
        if seen.footage.is_blurred() || soft {
            let fact = format!(
                "the hair is blurred: sharpness {sharpness:.2}, in the median view {:.2}",
                usual_sharpness.unwrap_or(0.0)
            );
            findings.push(
                Finding::look("blurred", place(), fact)
                    .suffers("orient: little confidence, and fine strands are not told apart")
                    .hint("focus this lens on the hair, close it a little, or shorten the exposure; a view that harms can be held out"),
            );
        }
    }
    if seen.footage.is_overexposed() {
        let fact = format!("{:.0} % of the hair is overexposed", 100.0 * seen.footage.overexposed);
        findings.push(
            Finding::look("overexposed", place(), fact)
                .suffers("orient: no orientation where hair is clipped")
                .hint("less light or exposure for this camera; polarisers take the highlights off"),
        );
    }
    if seen.luma < DARK {
        let fact = format!("the hair is almost black: median luma {:.0} of 255", seen.luma);
        findings.push(
            Finding::look("dark", place(), fact)
                .suffers("orient: texture drowns in noise")
                .hint("more light on the hair, above all from behind the cameras; code dark values finer"),
        );
    } else if seen.luma > UNLIKE * usual || seen.luma < usual / UNLIKE {
        let fact = format!("the hair has luma {:.0}, in the median view {usual:.0}", seen.luma);
        findings.push(
            Finding::look("brightness", place(), fact)
                .suffers("masks: the look of hair is learnt from all views together")
                .hint("set exposure and gain of all cameras alike"),
        );
    }
    findings
}
