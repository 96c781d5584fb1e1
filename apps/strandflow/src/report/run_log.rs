//! What `run.log` tells of time and memory.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{BufRead, BufReader},
    path::Path,
};

use serde_json::Value;
use strandflow_engine::{STAGES, take::RUN_LOG};

/// Time and memory of a phase.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PhaseTime {
    /// `stage/phase`.
    pub phase: String,
    /// Items computed.
    pub items: usize,
    /// Seconds of all items together; those computed side by side count each.
    pub item_secs: f64,
    /// Seconds in which at least one item was in work.
    pub wall_secs: f64,
    /// Largest resident memory \[MB\], where it was written down.
    pub peak_mb: Option<f64>,
}

/// When and how long an item was last computed: seconds it took, and since 1970 when it was done.
type Span = (f64, f64);

/// Reads the log, the phases in the order of the stages. Of an item that was computed again the last time counts. A log
/// that is not there is empty; a line that a killed run left half written is passed over.
pub fn read(take: &Path) -> Vec<PhaseTime> {
    let lines = File::open(take.join(RUN_LOG)).map(|file| BufReader::new(file).lines());
    of_lines(lines.into_iter().flatten().map_while(Result::ok))
}

fn of_lines(lines: impl Iterator<Item = String>) -> Vec<PhaseTime> {
    let mut items: BTreeMap<String, BTreeMap<String, Span>> = BTreeMap::new();
    let mut peaks: BTreeMap<String, f64> = BTreeMap::new();
    for event in lines.filter_map(|line| serde_json::from_str::<Value>(&line).ok()) {
        let text = |field: &str| event[field].as_str().unwrap_or_default().to_owned();
        match event["event"].as_str() {
            Some("item") if event["outcome"] == "done" => {
                let (Some(secs), Some(end)) = (event["secs"].as_f64(), event["unix_secs"].as_f64()) else { continue };
                items.entry(text("phase")).or_default().insert(text("item"), (secs, end));
            }
            Some("phase_finished") => {
                event["peak_mb"].as_f64().map(|mb| peaks.insert(text("phase"), mb));
            }
            _ => {}
        }
    }
    let phases = STAGES.iter().flat_map(|stage| stage.phases);
    let of_phase = |name: &str| {
        let spans: Vec<Span> = items.get(name)?.values().copied().collect();
        let (item_secs, wall_secs) = (spans.iter().map(|span| span.0).sum(), covered(&spans));
        let peak_mb = peaks.get(name).copied();
        Some(PhaseTime { phase: name.to_owned(), items: spans.len(), item_secs, wall_secs, peak_mb })
    };
    phases.filter_map(|phase| of_phase(phase.name)).collect()
}

/// Seconds that at least one span covers.
fn covered(spans: &[Span]) -> f64 {
    let mut ranges: Vec<(f64, f64)> = spans.iter().map(|(secs, end)| (end - secs, *end)).collect();
    ranges.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut sum, mut until) = (0.0, f64::NEG_INFINITY);
    for (start, end) in ranges {
        sum += (end - start.max(until)).max(0.0);
        until = until.max(end);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_side_by_side_take_wall_time_once_and_repeats_count_once() {
        let item = |item: &str, secs: f64, end: f64| {
            format!(
                r#"{{"event":"item","phase":"fit/fit","item":"{item}","outcome":"done","secs":{secs},"unix_secs":{end}}}"#
            )
        };
        let lines = [
            item("a", 50.0, 100.0),
            item("a", 4.0, 1004.0),
            item("b", 4.0, 1006.0),
            item("c", 1.0, 2000.0),
            r#"{"event":"phase_finished","phase":"fit/fit","secs":6,"peak_mb":321.5}"#.into(),
            r#"{"event":"item","phase":"fit/fit","outcome":"failed","secs":9,"unix_secs":9}"#.into(),
            r#"{"event":"item","pha"#.into(),
        ];
        let expected =
            PhaseTime { phase: "fit/fit".into(), items: 3, item_secs: 9.0, wall_secs: 7.0, peak_mb: Some(321.5) };
        assert_eq!(of_lines(lines.into_iter()), [expected]);
    }
}
