//! `strandflow run`: stages, progress, summary.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use strandflow_check::{Verdict, check_quick, gather};
use strandflow_core::{Finding, Place};
use strandflow_engine::{
    Event, RunOptions, Summary, Take,
    confined::must_be_confined,
    phase_range,
    run::{PhaseSummary, run as run_stages},
    table,
};

use crate::{
    args::{Engine, RunArgs},
    failure::Failed,
    farm::{farm, must_fit},
    progress::Progress,
    stdout::print,
};

pub fn run(args: &RunArgs) -> Result<(), Failed> {
    must_fit(args)?;
    let mut options = options(args)?;
    if args.confined {
        must_be_confined(&args.take)?;
    }
    let take = Take::open(&args.take)?;
    let plan = take.plan(args.mode.map(Into::into), args.frames)?;
    if options.phases.start == 0 && options.items.is_none() {
        options.found = look_over(&take, args.unchecked)?;
    }
    if args.farm.engine != Engine::Local {
        return farm(args, &take, &plan, &options);
    }
    let stop = stop_on_ctrl_c();
    let summary = if args.json {
        run_stages(&take, &plan, &options, &stop, &print_json)?
    } else {
        let progress = Progress::default();
        run_stages(&take, &plan, &options, &stop, &|event| progress.show(event))?
    };
    if !args.json {
        eprint!("{}", table(&summary));
    }
    if options.items.is_some() { conclude_task(&summary) } else { conclude(&summary) }
}

/// The checks that decode no image: what cannot work is refused, the rest is told. A run from a later stage rests on results.
fn look_over(take: &Take, unchecked: bool) -> Result<Vec<Finding>, Failed> {
    let said = check_quick(&mut gather::of_take(take)?);
    let findings: Vec<_> = said.into_iter().flat_map(|said| said.findings).collect();
    if let Some(grave) = findings.iter().find(|finding| finding.verdict == Verdict::CannotWork && !unchecked) {
        let hint = format!("{}; `strandflow check` says more, `--unchecked` runs all the same", grave.hint);
        return Err(Failed::input(format!("{}: {} [{}]", grave.place, grave.fact, grave.fault), hint));
    }
    let told = |finding: strandflow_check::Finding| Finding {
        place: Place::default(),
        fact: format!("{}: {} [{}]", finding.place, finding.fact, finding.fault),
        consequence: format!("{}; {}", finding.suffers, finding.hint),
    };
    Ok(findings.into_iter().map(told).collect())
}

fn options(args: &RunArgs) -> Result<RunOptions, Failed> {
    let default = RunOptions::default();
    let from = args.from.as_deref().map_or(Ok(default.phases.clone()), phase_range)?;
    let to = args.to.as_deref().map_or(Ok(default.phases.clone()), phase_range)?;
    let phases = from.start..to.end;
    if phases.is_empty() {
        let (from, to) = (args.from.as_deref().unwrap_or_default(), args.to.as_deref().unwrap_or_default());
        let hint = format!("{from} comes after {to}");
        return Err(Failed::input("--from names a later stage than --to", hint));
    }
    // The first items of each are what a task of several short phases has; beyond, the same number must mean the same.
    let asked: Vec<_> = table::phases().map(|(_, phase)| phase).take(phases.end).skip(phases.start).collect();
    let share = asked.windows(2).all(|pair| pair[0].kind == pair[1].kind && pair[1].follows(pair[0]));
    if args.items.as_ref().is_some_and(|items| items.0.start > 0) && !share {
        let names: Vec<&str> = asked.iter().map(|phase| phase.name).collect();
        let hint = format!("let --from and --to name one of {}", names.join(", "));
        return Err(Failed::input("--items beyond the first count the work items of one phase", hint));
    }
    let items = args.items.clone().map(|items| items.0);
    let threads = args.threads.unwrap_or(default.threads);
    Ok(RunOptions { phases, items, threads, verify: args.verify, ..default })
}

/// The first Ctrl-C stops between items; the second ends the program, which costs the items in flight and no more.
pub fn stop_on_ctrl_c() -> Arc<AtomicBool> {
    let stop = Arc::new(AtomicBool::new(false));
    let seen = stop.clone();
    let handler = move || {
        if seen.swap(true, Ordering::Relaxed) {
            std::process::exit(1);
        }
        eprintln!("stopping after the items in work; press Ctrl-C again to stop at once");
    };
    if let Err(error) = ctrlc::set_handler(handler) {
        tracing::warn!("Ctrl-C will stop at once: {error}");
    }
    stop
}

fn print_json(event: &Event) {
    if let Ok(line) = serde_json::to_string(event) {
        // Events that nobody can read must not cost a result.
        let _ = print(&(line + "\n"));
    }
}

fn table(summary: &Summary) -> String {
    let mut text = format!(
        "{:<18}{:>9}{:>10}{:>7}{:>7}{:>8}{:>9}\n",
        "phase", "seconds", "peak MB", "done", "fresh", "failed", "findings"
    );
    for p in &summary.phases {
        let peak = p.peak_mb.map_or_else(|| "-".into(), |mb| format!("{mb:.0}"));
        let failed = p.failed + p.blocked;
        text += &format!(
            "{:<18}{:>9.1}{peak:>10}{:>7}{:>7}{failed:>8}{:>9}\n",
            p.phase, p.secs, p.done, p.fresh, p.findings
        );
    }
    text += &format!("{:<18}{:>9.1}\n", "all", summary.phases.iter().map(|p| p.secs).sum::<f64>());
    for p in summary.phases.iter().filter(|p| p.findings > 0) {
        let PhaseSummary { phase, findings, finding_kinds, first_findings, .. } = p;
        text += &format!("{phase}: {findings} findings of {finding_kinds} kinds (all are in run.log)\n");
        first_findings.iter().for_each(|finding| text += &format!("  {finding}\n"));
    }
    text
}

/// A task is done when nothing is left that another try could mend: what the input is to blame for is in the store, and what
/// comes after goes on without it, as it does in one run.
fn conclude_task(summary: &Summary) -> Result<(), Failed> {
    let mends = summary.interrupted || summary.failures().any(|(_, failure)| !failure.input);
    match conclude(summary) {
        Err(failed) if !mends => {
            eprintln!("warning: {}\nhint: {}", failed.error, failed.hint);
            Ok(())
        }
        Err(failed) => Err(Failed { input: false, ..failed }),
        done => done,
    }
}

/// The first failures, and the exit code.
fn conclude(summary: &Summary) -> Result<(), Failed> {
    if summary.interrupted {
        let hint = "run again to go on; nothing is lost".into();
        return Err(Failed { error: "stopped".into(), hint, input: false });
    }
    let failures: Vec<_> = summary.failures().collect();
    let Some((_, first)) = failures.first() else {
        let blocked = summary.phases.iter().find(|phase| phase.blocked > 0);
        return blocked.map_or(Ok(()), |phase| {
            let error = format!("{}: what it needs is not there", phase.phase);
            Err(Failed::input(error, "run the stages before it, or leave --from away"))
        });
    };
    let mut error = first.error.clone();
    if failures.len() > 1 {
        error += &format!("\n  … and {} more items failed; `strandflow status` lists them", failures.len() - 1);
    }
    let input = failures.iter().all(|(_, failure)| failure.input);
    Err(Failed { error, hint: first.hint.clone(), input })
}
