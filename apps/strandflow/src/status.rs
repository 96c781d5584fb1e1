//! `strandflow status`: what is done, stale, missing or failed, and why.

use strandflow_engine::{
    Plan, Take, status as state_of,
    status::{PhaseStatus, status_before},
};

use crate::{args::StatusArgs, failure::Failed, stdout::print};

pub fn status(args: &StatusArgs) -> Result<(), Failed> {
    let take = Take::open(&args.take)?;
    let mut plan = take.last_plan()?;
    plan.mode = args.mode.map_or(plan.mode, Into::into);
    let phases = state_of(&take, &plan)?;
    if args.json {
        return Ok(print(&(serde_json::to_string_pretty(&phases).map_err(std::io::Error::other)? + "\n"))?);
    }
    print(&text(&plan, &phases))?;
    if phases.iter().any(|phase| !phase.is_done()) {
        eprintln!("`strandflow run {}` does what is stale, missing or failed", args.take.display());
    }
    Ok(())
}

fn text(plan: &Plan, phases: &[PhaseStatus]) -> String {
    let mut text = format!("frames {}, mode {}\n", plan.frames, format!("{:?}", plan.mode).to_lowercase());
    text += &format!("{:<18}{:>7}{:>7}{:>7}{:>9}{:>8}\n", "phase", "items", "done", "stale", "missing", "failed");
    for p in phases {
        let items = if p.items == 0 { "?".into() } else { p.items.to_string() };
        text += &format!("{:<18}{items:>7}{:>7}{:>7}{:>9}{:>8}\n", p.phase, p.done, p.stale, p.missing, p.failed);
        p.reasons.iter().for_each(|(reason, count)| text += &format!("    {count}× {reason}\n"));
    }
    text
}

/// Warns where a stage, or one before it, has results that rest on what has changed since; they are used all the same.
pub fn tell_of_outdated(take: &Take, plan: &Plan, stage: usize) -> Result<(), Failed> {
    let mut phases = status_before(take, plan, stage + 1)?;
    phases.retain(|phase| phase.stale > 0);
    if !phases.is_empty() {
        eprintln!("warning: these results are not up to date:");
        phases.iter().for_each(|phase| eprintln!("  {phase}"));
        eprintln!("hint: `strandflow run {}` brings them up to date", take.root().display());
    }
    Ok(())
}
