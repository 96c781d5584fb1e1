//! The section on time and memory by stage.

use strandflow_report::{Axis, Html, Timeline, html::Cell, timeline::Stretch};

use super::run_log::{PhaseTime, nodes};

/// Time and memory as a table.
pub fn section(log: &[PhaseTime]) -> Html {
    let total: f64 = log.iter().map(|phase| phase.wall_secs).sum();
    if log.is_empty() {
        return Html::paragraph("run.log tells of no work item that was computed.");
    }
    let mut html = Html::paragraph(&format!(
        "{} of work in all. Wall time is the time in which at least one work item of the phase was in work; items are \
         computed side by side, so the time of all items together is longer. Of items computed again, the last time counts.",
        duration(total)
    ));
    let longest = log.iter().map(|phase| phase.wall_secs).fold(0.0, f64::max).max(1e-9);
    let with_memory = log.iter().any(|phase| phase.peak_mb.is_some());
    let row = |phase: &PhaseTime| {
        let peak = phase.peak_mb.map_or("–".to_owned(), |mb| format!("{mb:.0} MB"));
        let mut cells = vec![
            Cell::Text(phase.phase.clone()),
            Cell::Bar(phase.wall_secs / longest),
            Cell::Number(duration(phase.wall_secs)),
            Cell::Number(phase.items.to_string()),
            Cell::Number(duration(phase.item_secs)),
        ];
        cells.extend(with_memory.then_some(Cell::Number(peak)));
        cells
    };
    let mut header = vec!["Phase", "", "Wall time", "Items", "All items"];
    header.extend(with_memory.then_some("Peak memory"));
    html.push(Html::table(&header, log.iter().map(row)));
    html.push(timeline(log).figure(
        "When the items of each phase were computed, by machine. Times in which none was in work are left out.",
    ));
    if !with_memory {
        html.push(Html::paragraph("This take was run by a version that did not write memory into run.log."));
    }
    html
}

/// A row a phase; the time in which nothing was in work is cut out.
fn timeline(log: &[PhaseTime]) -> Timeline {
    let mut busy: Vec<(f64, f64)> =
        log.iter().flat_map(|phase| &phase.spans).map(|span| (span.start, span.end)).collect();
    busy.sort_by(|a, b| a.0.total_cmp(&b.0));
    // Each moment in work by the seconds in work before it: (from, to, seconds before).
    let mut stretches: Vec<(f64, f64, f64)> = Vec::new();
    for (start, end) in busy {
        match stretches.last_mut() {
            Some(last) if start <= last.1 => last.1 = last.1.max(end),
            last => {
                let before = last.map_or(0.0, |last| last.2 + last.1 - last.0);
                stretches.push((start, end, before));
            }
        }
    }
    let at = |moment: f64| {
        let last = stretches.iter().rfind(|stretch| stretch.0 <= moment);
        last.map_or(0.0, |(from, _, before)| before + moment - from)
    };
    let places = nodes(log);
    let place = |node: &String| places.iter().position(|known| known == node).unwrap_or(0);
    let row = |phase: &PhaseTime| {
        let bars = phase.spans.iter().map(|span| (at(span.start), at(span.end), place(&span.node)));
        (phase.phase.clone(), joined(bars.collect()))
    };
    let end = stretches.last().map_or(1.0, |(from, to, before)| before + to - from);
    let alt = format!("{} phases over {} of work", log.len(), duration(end));
    let names = places.iter().map(|node| if node.is_empty() { "one machine".to_owned() } else { node.clone() });
    Timeline::new(Axis::exact("seconds of work", 0.0, end), alt, log.iter().map(row).collect(), names.collect())
}

/// Bars of one place that touch are one: thousands of short items make a page large, and look the same.
fn joined(mut bars: Vec<Stretch>) -> Vec<Stretch> {
    bars.sort_by(|a, b| (a.2, a.0).partial_cmp(&(b.2, b.0)).unwrap_or(std::cmp::Ordering::Equal));
    let mut joined: Vec<Stretch> = Vec::new();
    for bar in bars {
        match joined.last_mut() {
            Some(last) if last.2 == bar.2 && bar.0 <= last.1 + SHORTEST_GAP_SECS => last.1 = last.1.max(bar.1),
            _ => joined.push(bar),
        }
    }
    joined
}

/// Between items of one worker there is less.
const SHORTEST_GAP_SECS: f64 = 0.05;

/// Seconds in words.
fn duration(secs: f64) -> String {
    match secs {
        s if s < 10.0 => format!("{s:.1} s"),
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min {:02.0} s", (s / 60.0).floor(), (s % 60.0).floor()),
        s => format!("{:.0} h {:02.0} min", (s / 3600.0).floor(), (s % 3600.0 / 60.0).floor()),
    }
}

#[cfg(test)]
mod tests {
    use super::{super::run_log::Span, *};

    #[test]
    fn times_read_as_people_say_them() {
        assert_eq!([0.12, 59.6, 179.0, 7325.0].map(duration), ["0.1 s", "60 s", "2 min 59 s", "2 h 02 min"]);
    }

    #[test]
    fn idle_time_is_cut_out_and_items_that_touch_are_one_bar() {
        let span = |start: f64, end: f64| Span { start, end, node: String::new() };
        let phase = |name: &str, spans| PhaseTime { phase: name.into(), spans, ..PhaseTime::default() };
        let log = [phase("a", vec![span(100.0, 110.0), span(110.0, 120.0)]), phase("b", vec![span(9000.0, 9020.0)])];
        let svg = timeline(&log).figure("").into_text();
        let number = |bar: &str, name: &str| -> f64 {
            let (_, value) = bar.split_once(&format!(" {name}=\"")).unwrap();
            value.split('"').next().unwrap().parse().unwrap()
        };
        let bars = svg.split("<rect class=\"fill").skip(1);
        let bars: Vec<[f64; 2]> = bars.map(|bar| [number(bar, "x"), number(bar, "width")]).collect();
        let [[a, width], [b, width_of_b]] = bars[..] else { panic!("{svg}") };
        assert!(width > 100.0 && width_of_b == width && b == a + width, "b begins in the middle: {svg}");
    }

    #[test]
    fn without_memory_there_is_no_column_for_it() {
        let phase = PhaseTime { phase: "fit/fit".into(), items: 3, wall_secs: 7.0, ..PhaseTime::default() };
        let text = |phase| section(&[phase]).into_text();
        assert!(!text(phase.clone()).contains("Peak memory"));
        assert!(text(PhaseTime { peak_mb: Some(99.6), ..phase }).contains("100 MB"));
    }
}
