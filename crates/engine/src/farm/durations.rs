//! How long work items take: as the take's logs have it, else as on a take that was measured.

use std::{collections::HashMap, path::Path};

use serde::Deserialize;

use crate::{item::Kind, run::log_lines, table::Phase};

/// Seconds an item took on one core: `docs/farm.md` has the take and the command. A block is counted for each of its frames.
/// Footage is larger as a rule, and tasks then last longer than they need to until its own items have been timed.
const MEASURED_ELSEWHERE: [(&str, f64); 18] = [
    ("masks/masks", 0.023),
    ("hull/grid", 0.039),
    ("hull/hull", 0.033),
    ("pose/pose", 0.67),
    ("scalp/scalp", 3.5),
    ("orient/frames", 0.013),
    ("orient/orient", 0.0033),
    ("lift/lift", 0.23),
    ("field/field", 0.46),
    ("field/motion", 0.65),
    ("grow/grow", 0.23),
    ("prune/prune", 0.15),
    ("smooth/frames", 0.025),
    ("smooth/topology", 0.088),
    ("smooth/trim", 0.0012),
    ("fit/fit", 0.18),
    ("flow/flow", 0.28),
    ("blend/blend", 0.45),
];

/// Seconds of the items that were computed.
#[derive(Clone, Debug, Default)]
pub struct Durations(HashMap<String, (f64, usize)>);

/// What is of interest in a line of a log.
#[derive(Deserialize)]
struct Line {
    phase: String,
    outcome: String,
    secs: f64,
}

impl Durations {
    /// From all logs of a take; other lines, and such as a killed run left half written, are passed over.
    pub fn of_take(root: &Path) -> Self {
        Self::of_lines(log_lines(root))
    }

    fn of_lines(lines: impl Iterator<Item = String>) -> Self {
        let mut sums: HashMap<String, (f64, usize)> = HashMap::new();
        for line in lines.filter_map(|line| serde_json::from_str::<Line>(&line).ok()) {
            if line.outcome == "done" && line.secs.is_finite() {
                let (secs, count) = sums.entry(line.phase).or_default();
                (*secs, *count) = (*secs + line.secs, *count + 1);
            }
        }
        Self(sums)
    }

    /// Mean seconds of an item of a phase in a take of so many frames.
    pub fn secs(&self, phase: &Phase, frames: usize) -> f64 {
        if let Some((secs, count)) = self.0.get(phase.name) {
            return secs / *count as f64;
        }
        let known = MEASURED_ELSEWHERE.iter().find(|(name, _)| *name == phase.name);
        let each = if phase.kind == Kind::Block { frames } else { 1 };
        known.map_or(1.0, |(_, secs)| secs * each as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::phases;

    #[test]
    fn measured_items_count_and_others_are_as_elsewhere() {
        let line = |secs: f64, outcome: &str| {
            format!(r#"{{"event":"item","phase":"fit/fit","outcome":"{outcome}","secs":{secs},"more":1}}"#)
        };
        let lines = [line(10.0, "done"), line(20.0, "done"), line(900.0, "failed"), r#"{"event":"item","ph"#.into()];
        let durations = Durations::of_lines(lines.into_iter());
        let phase = |name| phases().find(|(_, phase)| phase.name == name).unwrap().1;
        assert_eq!(durations.secs(phase("fit/fit"), 7), 15.0);
        let one = durations.secs(phase("smooth/trim"), 1);
        assert!(one > 0.0 && (durations.secs(phase("smooth/trim"), 60) / one - 60.0).abs() < 1e-9);
    }

    #[test]
    fn every_phase_was_measured() {
        let names: Vec<&str> = phases().map(|(_, phase)| phase.name).collect();
        assert_eq!(MEASURED_ELSEWHERE.map(|(name, _)| name).to_vec(), names);
    }
}
