//! What `fit` costs as takes grow: whole takes from the store to the store, by the program, over strands and over frames.
//! `cargo bench -p strandflow --bench fit_scale` prints a table (`docs/dynamics.md`) and leaves two plots in `target/fit-scale`.
//! With `-- STRANDSxFRAMES …` only takes of these sizes.
#![expect(clippy::unwrap_used, reason = "a bench: a failing unwrap ends it")]
#![expect(clippy::print_stdout, reason = "its table")]

#[path = "../tests/all/common/mod.rs"]
#[allow(dead_code, reason = "helpers of the tests")]
mod common;

use std::path::Path;

use strandflow_engine::Take;
use strandflow_report::{Axis, Mark, Plot, Tone};

use common::{before_fit, stderr, strandflow, text};

/// Strands and frames: the paper's largest hairstyles' length and Table 1's first row at the end, then longer takes.
const OVER_STRANDS: [(usize, usize); 4] = [(1024, 200), (2048, 200), (4096, 200), (7421, 200)];
const OVER_FRAMES: [(usize, usize); 4] = [(512, 200), (512, 500), (512, 1000), (512, 2000)];

/// What a take cost.
struct Cost {
    strands: usize,
    frames: usize,
    secs: f64,
    peak_mb: f64,
}

fn main() {
    let asked: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with('-')).collect();
    let sizes: Vec<(usize, usize)> = asked
        .iter()
        .filter_map(|arg| arg.split_once('x').and_then(|(n, t)| Some((n.parse().ok()?, t.parse().ok()?))))
        .collect();
    let all = if sizes.is_empty() { [OVER_STRANDS, OVER_FRAMES].concat() } else { sizes };
    println!("{:>8}{:>8}{:>10}{:>24}{:>10}", "strands", "frames", "seconds", "ms a strand and frame", "peak MB");
    let costs: Vec<Cost> = all
        .into_iter()
        .map(|(strands, frames)| {
            let cost = cost(strands, frames);
            let each = 1e3 * cost.secs / (strands * frames) as f64;
            println!("{strands:>8}{frames:>8}{:>10.1}{each:>24.4}{:>10.0}", cost.secs, cost.peak_mb);
            cost
        })
        .collect();
    if costs.len() == OVER_STRANDS.len() + OVER_FRAMES.len() {
        plots(&costs);
    }
}

/// Makes a take of trimmed strands and lets the program fit it.
fn cost(strands: usize, frames: usize) -> Cost {
    let root = tempfile::tempdir().unwrap();
    let folder = before_fit::take(root.path(), strands, frames, |_| false);
    let ran = strandflow(&["run", text(&folder), "--from", "fit", "--to", "fit", "--json"]);
    assert!(ran.status.success(), "{}", stderr(&ran));
    let events = String::from_utf8(ran.stdout).unwrap();
    let events = events.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let phase = events.into_iter().find(|event| event["event"] == "phase_finished").unwrap();
    let take = Take::open(&folder).unwrap();
    let kept = take.store().read_all::<u16>("fit/counts").unwrap().iter().filter(|&&count| count > 0).count();
    assert!(kept as f64 > 0.95 * strands as f64, "{kept} of {strands} strands were fitted");
    Cost {
        strands,
        frames,
        secs: phase["secs"].as_f64().unwrap(),
        peak_mb: phase["peak_mb"].as_f64().unwrap_or(f64::NAN),
    }
}

/// Seconds and memory over the size of the take.
fn plots(costs: &[Cost]) {
    let (over_strands, over_frames) = costs.split_at(OVER_STRANDS.len());
    let draw = |title: &str, label: &str, value: fn(&Cost) -> f64| {
        let line = |costs: &[Cost]| {
            let size = |cost: &Cost| (cost.strands * cost.frames) as f64 / 1e6;
            Mark::Line(costs.iter().map(|cost| (size(cost), value(cost))).collect())
        };
        let sizes = costs.iter().map(|cost| (cost.strands * cost.frames) as f64 / 1e6);
        let x = Axis::from_zero("strands times frames, millions", sizes);
        Plot::new(title, title, x, Axis::from_zero(label, costs.iter().map(value)))
            .named(Tone::Blue, line(over_strands), "1,024 to 7,421 strands, 200 frames")
            .named(Tone::Orange, line(over_frames), "512 strands, 200 to 2,000 frames")
            .document()
    };
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("fit-scale");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("seconds.svg"), draw("What fit costs", "seconds", |cost| cost.secs)).unwrap();
    std::fs::write(folder.join("memory.svg"), draw("Memory of fit", "peak [MB]", |cost| cost.peak_mb)).unwrap();
    println!("plots: {}", folder.display());
}
