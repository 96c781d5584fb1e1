//! Progress bars: one a phase, with rate and time left; findings and failures above them.

use std::{
    fmt::Write,
    sync::{Mutex, PoisonError},
};

use indicatif::{HumanDuration, ProgressBar, ProgressState, ProgressStyle};
use strandflow_core::Finding;
use strandflow_engine::{Event, Outcome};

/// Failures shown in words per phase; the rest is counted in the summary.
const SHOWN: usize = 3;

/// Draws on stderr where that is a terminal; otherwise writes one line a phase.
#[derive(Default)]
pub struct Progress(Mutex<State>);

#[derive(Default)]
struct State {
    bar: Option<ProgressBar>,
    shown: usize,
}

impl Progress {
    /// Shows an event.
    pub fn show(&self, event: &Event) {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match event {
            Event::Checked { findings } => {
                for Finding { fact, consequence, .. } in findings {
                    eprintln!("warning: {fact}\n  {consequence}");
                }
                eprintln!("hint: `strandflow check` looks at more, and says what to do");
            }
            Event::Outdated { phases } => {
                eprintln!("warning: --from takes the stages before it as they are, and these are not up to date:");
                phases.iter().for_each(|phase| eprintln!("  {phase}"));
                eprintln!("hint: leave --from away to bring them up to date first");
            }
            Event::PhaseStarted { phase, summary, items } => {
                let bar = ProgressBar::new(*items as u64).with_prefix(*phase).with_message(*summary);
                bar.set_style(style());
                bar.enable_steady_tick(std::time::Duration::from_millis(250));
                *state = State { bar: Some(bar), shown: 0 };
            }
            Event::Item { place, outcome, failure, .. } => {
                let Some(bar) = &state.bar else { return };
                if *outcome == Outcome::Fresh {
                    // Fresh items cost nothing: they must not make the rate look better than it is.
                    bar.set_length(bar.length().unwrap_or(1).saturating_sub(1));
                } else {
                    bar.inc(1);
                }
                if let (Outcome::Failed, Some(failure)) = (outcome, failure)
                    && state.shown < SHOWN
                {
                    bar.suspend(|| eprintln!("{place}: {}", failure.error));
                    state.shown += 1;
                }
            }
            Event::Ended { .. } => {}
            Event::PhaseFinished { phase, secs, .. } => {
                if let Some(bar) = state.bar.take() {
                    let hidden = bar.is_hidden();
                    let done = bar.position();
                    bar.finish_and_clear();
                    if done > 0 || hidden {
                        eprintln!("{phase:<16} {done:>5} items {secs:>8.1} s");
                    }
                }
            }
        }
    }
}

fn style() -> ProgressStyle {
    // What the stage does comes last: a narrow terminal cuts the end of a line.
    let template = "{prefix:<15} {bar:20} {pos:>5}/{len:<5} {rate:>10} {left:>15}  {msg}";
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    style
        .with_key("rate", |state: &ProgressState, out: &mut dyn Write| put(out, &rate(state.per_sec())))
        .with_key("left", |state: &ProgressState, out: &mut dyn Write| put(out, &left(state)))
}

fn put(out: &mut dyn Write, text: &str) {
    // Into a buffer of the bar: it does not fail.
    let _ = out.write_str(text);
}

/// Items a second, or seconds an item where that is the larger number.
fn rate(per_sec: f64) -> String {
    match per_sec {
        fast if fast >= 1.0 => format!("{fast:.1}/s"),
        slow if slow > 0.0 => format!("{:.1} s each", 1.0 / slow),
        _ => String::new(),
    }
}

/// Before the first item is done nothing is known of the time left.
fn left(state: &ProgressState) -> String {
    if state.pos() == 0 { String::new() } else { format!("{:#} left", HumanDuration(state.eta())) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_work_is_told_in_seconds_an_item() {
        assert_eq!([rate(12.34), rate(0.25), rate(0.0)], ["12.3/s", "4.0 s each", ""]);
    }
}
