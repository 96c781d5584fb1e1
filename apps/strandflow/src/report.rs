//! `strandflow report`: one page that says how a take stands, readable anywhere.

mod about;
mod advice;
mod health;
mod motion;
mod motion_figures;
mod opened;
mod parameters;
mod pictures;
mod run_log;
mod timing;

use std::path::PathBuf;

use strandflow_core::FrameRange;
use strandflow_engine::disk::write_atomic;
use strandflow_eval::statistics::evenly;
use strandflow_report::{Html, Page};

use crate::{args::ReportArgs, failure::Failed};

use self::{motion::Motion, opened::Opened};

/// Name of the page within a take.
const PAGE: &str = "report.html";
/// Frames and views shown where none is asked for.
const SHOWN: usize = 3;

pub fn report(args: &ReportArgs) -> Result<(), Failed> {
    let take = Opened::open(&args.take)?;
    let frames = chosen_frames(&take, &args.frame)?;
    let views = chosen_views(&take, &args.view)?;
    let out = args.out.clone().unwrap_or_else(|| args.take.join(PAGE));
    write_atomic(&out, page(&take, &frames, &views).into_text().as_bytes())?;
    eprintln!("wrote {}", out.display());
    Ok(())
}

/// The page, section by section. What a take lacks is said where it would be.
fn page(take: &Opened, frames: &[usize], views: &[usize]) -> Page {
    let log = run_log::read(take.root());
    let motion = Motion::of(take);
    let health = health::Health::of(take);
    let mut page = Page::new(format!("Take {}", take.name()), lead(take));
    page.section("summary", "How the take stands", health.summary(take, motion.as_ref()));
    page.section("strands", "Strands over footage", pictures::strands(take, frames, views));
    page.section("orientation", "Orientation maps", pictures::orientations(take, frames, views));
    page.section("coverage", "What was seen and what was inferred", motion_figures::coverage(take, motion.as_ref()));
    page.section("lengths", "Lengths over time", motion_figures::lengths(motion.as_ref()));
    page.section("jitter", "Jitter", motion_figures::jitter(take, motion.as_ref()));
    page.section("parameters", "Fitted parameters", parameters::section(take));
    page.section("stages", "Stage by stage", health.stages());
    page.section("time", "Time and memory", timing::section(&log));
    page.section("about", "What the take is made of", about::section(take));
    page
}

fn lead(take: &Opened) -> Html {
    let manifest = take.manifest();
    let frames = take.frames().map_or("no run yet".to_owned(), |frames| format!("frames {frames}"));
    Html::paragraph(&format!(
        "{} views, {} frames a second, {frames}. Written by strandflow {}.",
        manifest.views.len(),
        manifest.fps,
        env!("CARGO_PKG_VERSION")
    ))
}

/// The frames asked for; else three, from the middle of each third of the take.
fn chosen_frames(take: &Opened, asked: &[usize]) -> Result<Vec<usize>, Failed> {
    let Some(frames) = take.frames() else {
        return match asked.first() {
            None => Ok(Vec::new()),
            Some(frame) => Err(Failed::input(
                format!("there is no frame {frame}: the take has not been run"),
                format!("run `strandflow run {}` first, or leave --frame away", take.name()),
            )),
        };
    };
    match asked.iter().find(|frame| !frames.contains(**frame)) {
        Some(frame) => {
            let hint = format!("name frames within {frames}, or run the take on others");
            Err(Failed::input(format!("no frame {frame} in the last run"), hint))
        }
        None if asked.is_empty() => Ok(in_the_middle(frames)),
        None => Ok(asked.to_vec()),
    }
}

fn in_the_middle(frames: FrameRange) -> Vec<usize> {
    let count = frames.len().min(SHOWN);
    (0..count).map(|i| frames.start + (2 * i + 1) * frames.len() / (2 * count)).collect()
}

fn chosen_views(take: &Opened, asked: &[String]) -> Result<Vec<usize>, Failed> {
    let names: Vec<&str> = take.manifest().views.iter().map(|view| view.name.as_str()).collect();
    if asked.is_empty() {
        return Ok(evenly(names.len(), SHOWN));
    }
    let index = |name: &String| {
        let at = names.iter().position(|known| known == name);
        at.ok_or_else(|| Failed::input(format!("no view `{name}`"), format!("views: {}", names.join(", "))))
    };
    asked.iter().map(index).collect()
}

/// The name of a path's last part.
fn last_part(path: &std::path::Path) -> String {
    let whole: PathBuf = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    whole.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// A share from 0 to 1 in words: what is not quite none or all is not rounded to it.
fn percent(share: f64) -> String {
    match 100.0 * share {
        p if !p.is_finite() => "–".into(),
        p if p > 0.0 && p < 0.1 => "under 0.1 %".into(),
        p if p < 100.0 && p > 99.9 => "over 99.9 %".into(),
        p if p < 10.0 && p > 0.0 => format!("{p:.1} %"),
        p => format!("{p:.0} %"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_come_from_all_over_the_take() {
        let frames = |start, end| in_the_middle(FrameRange { start, end });
        assert_eq!(frames(0, 30), [5, 15, 25]);
        assert_eq!((frames(4, 6), frames(7, 8)), (vec![4, 5], vec![7]));
    }

    #[test]
    fn little_is_not_none() {
        let said = [0.0, 1e-5, 0.023, 0.5, 0.99999, 1.0, f64::NAN].map(percent);
        assert_eq!(said, ["0 %", "under 0.1 %", "2.3 %", "50 %", "over 99.9 %", "100 %", "–"]);
    }
}
