//! What the logs of a take tell of time and memory.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use serde_json::Value;
use strandflow_engine::{run::log_lines, table::phases};

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
    /// The items in the order of their ends.
    pub spans: Vec<Span>,
}

/// When and where an item was computed last, seconds since 1970.
#[derive(Clone, Debug, PartialEq)]
pub struct Span {
    /// Begin.
    pub start: f64,
    /// End.
    pub end: f64,
    /// The machine; empty in logs of earlier versions.
    pub node: String,
}

/// Reads the logs, the phases in the order of the stages. Of an item that was computed again the last time counts. A log
/// that is not there is empty; a line that a killed run left half written is passed over.
pub fn read(take: &Path) -> Vec<PhaseTime> {
    of_lines(log_lines(take))
}

fn of_lines(lines: impl Iterator<Item = String>) -> Vec<PhaseTime> {
    let mut items: BTreeMap<String, BTreeMap<String, Span>> = BTreeMap::new();
    let mut peaks: BTreeMap<String, (f64, f64)> = BTreeMap::new();
    for event in lines.filter_map(|line| serde_json::from_str::<Value>(&line).ok()) {
        let text = |field: &str| event[field].as_str().unwrap_or_default().to_owned();
        match event["event"].as_str() {
            Some("item") if event["outcome"] == "done" => {
                let (Some(secs), Some(end)) = (event["secs"].as_f64(), event["unix_secs"].as_f64()) else { continue };
                let span = Span { start: end - secs, end, node: text("node") };
                let last = items.entry(text("phase")).or_default().entry(text("item")).or_insert_with(|| span.clone());
                if end >= last.end {
                    *last = span;
                }
            }
            Some("phase_finished") => {
                let (Some(mb), end) = (event["peak_mb"].as_f64(), event["unix_secs"].as_f64().unwrap_or(0.0)) else {
                    continue;
                };
                let last = peaks.entry(text("phase")).or_insert((end, mb));
                if end >= last.0 {
                    *last = (end, mb);
                }
            }
            _ => {}
        }
    }
    let of_phase = |name: &str| {
        let mut spans: Vec<Span> = items.get(name)?.values().cloned().collect();
        spans.sort_by(|a, b| a.end.total_cmp(&b.end));
        let (item_secs, wall_secs) = (spans.iter().map(|span| span.end - span.start).sum(), covered(&spans));
        let peak_mb = peaks.get(name).map(|(_, mb)| *mb);
        Some(PhaseTime { phase: name.to_owned(), items: spans.len(), item_secs, wall_secs, peak_mb, spans })
    };
    phases().filter_map(|(_, phase)| of_phase(phase.name)).collect()
}

/// All machines that computed something.
pub fn nodes(log: &[PhaseTime]) -> Vec<String> {
    let nodes: BTreeSet<&String> = log.iter().flat_map(|phase| &phase.spans).map(|span| &span.node).collect();
    nodes.into_iter().cloned().collect()
}

/// Seconds that at least one span covers.
fn covered(spans: &[Span]) -> f64 {
    let mut ranges: Vec<(f64, f64)> = spans.iter().map(|span| (span.start, span.end)).collect();
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
        let found = of_lines(lines.into_iter());
        let [PhaseTime { items, item_secs, wall_secs, peak_mb, .. }] = &found[..] else { panic!("{found:?}") };
        assert_eq!((*items, *item_secs, *wall_secs, *peak_mb), (3, 9.0, 7.0, Some(321.5)));
    }
}
