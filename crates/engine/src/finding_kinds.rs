//! Findings of a phase by kind: what is the case in a hundred frames is said once.

use std::collections::BTreeMap;

use strandflow_core::{Finding, Place};

/// Findings by view and consequence.
#[derive(Clone, Debug, Default)]
pub struct FindingKinds(BTreeMap<(Option<String>, String), Kind>);

#[derive(Clone, Debug)]
struct Kind {
    first: Finding,
    last: Place,
    count: usize,
}

impl FindingKinds {
    /// Adds a finding; findings may come in any order.
    pub fn add(&mut self, finding: &Finding) {
        let key = (finding.place.view.clone(), finding.consequence.clone());
        let kind =
            self.0.entry(key).or_insert_with(|| Kind { first: finding.clone(), last: finding.place.clone(), count: 0 });
        kind.count += 1;
        if (&finding.place, &finding.fact) < (&kind.first.place, &kind.first.fact) {
            kind.first = finding.clone();
        }
        kind.last = kind.last.clone().max(finding.place.clone());
    }

    /// The first `most` kinds in words, in order of view: its first finding, and how many more there are up to where.
    pub fn in_words(&self, most: usize) -> Vec<String> {
        let words = |kind: &Kind| match kind.count {
            1 => kind.first.to_string(),
            n => format!("{} (and {} more up to {})", kind.first, n - 1, kind.last),
        };
        self.0.values().take(most).map(words).collect()
    }

    /// Number of kinds.
    pub fn count(&self) -> usize {
        self.0.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hundred_frames_are_one_line_a_view() {
        let mut kinds = FindingKinds::default();
        for frame in (0..100).rev() {
            for view in ["a", "b"] {
                let fact = format!("{frame} %");
                let consequence = "no trust".to_owned();
                kinds.add(&Finding { place: Place::view_frame(view, frame), fact, consequence });
            }
        }
        kinds.add(&Finding { place: Place::frame(7), fact: "empty".into(), consequence: "skipped".into() });
        let expected =
            ["frame 7: empty; skipped", "view a, frame 0: 0 %; no trust (and 99 more up to view a, frame 99)"];
        assert_eq!((kinds.in_words(2), kinds.count()), (expected.map(str::to_owned).into(), 3));
    }
}
