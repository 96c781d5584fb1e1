//! The check `files`: what `gather` met on its way.

use crate::{Evidence, Outcome, Verdict};

/// The check `files`.
pub(crate) fn check(evidence: &mut Evidence) -> Outcome {
    let shapes: Vec<String> =
        evidence.views.iter().filter_map(|view| view.info).map(|info| format!("{}×{}", info.width, info.height)).fold(
            Vec::new(),
            |mut all, shape| {
                if !all.contains(&shape) {
                    all.push(shape);
                }
                all
            },
        );
    let measured = format!("{} views of {}, frames {}", evidence.views.len(), shapes.join(" and "), evidence.frames);
    let findings = std::mem::take(&mut evidence.trouble);
    debug_assert!(findings.iter().all(|finding| finding.verdict > Verdict::NotJudged));
    Outcome::of(measured, findings)
}
