//! The section on time and memory by stage.

use strandflow_report::{Html, html::Cell};

use super::run_log::PhaseTime;

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
    if !with_memory {
        html.push(Html::paragraph("This take was run by a version that did not write memory into run.log."));
    }
    html
}

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
    use super::*;

    #[test]
    fn times_read_as_people_say_them() {
        assert_eq!([0.12, 59.6, 179.0, 7325.0].map(duration), ["0.1 s", "60 s", "2 min 59 s", "2 h 02 min"]);
    }

    #[test]
    fn without_memory_there_is_no_column_for_it() {
        let phase = PhaseTime { phase: "fit/fit".into(), items: 3, item_secs: 9.0, wall_secs: 7.0, peak_mb: None };
        let text = |phase| section(&[phase]).into_text();
        assert!(!text(phase.clone()).contains("Peak memory"));
        assert!(text(PhaseTime { peak_mb: Some(99.6), ..phase }).contains("100 MB"));
    }
}
