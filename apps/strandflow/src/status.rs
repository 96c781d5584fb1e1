//! `strandflow status`: what is done, stale, missing or failed, and why.

use serde::Serialize;
use strandflow_engine::{
    Plan, STAGES, Take, phase_range,
    status::{Look, PhaseStatus, states, status_before},
    table::phases,
};

use crate::{
    args::StatusArgs,
    failure::Failed,
    status_farm::{Tasks, tasks_of},
    stdout::print,
};

pub fn status(args: &StatusArgs) -> Result<(), Failed> {
    let take = Take::open(&args.take)?;
    let mut plan = take.last_plan()?;
    plan.mode = args.mode.map_or(plan.mode, Into::into);
    let look = if args.verify { Look::Files } else { Look::Records };
    let states = states(&take, &plan, phases().count(), look)?;
    let mut tasks = tasks_of(&take, &states);
    let rows: Vec<Row> =
        states.iter().map(|states| Row { phase: PhaseStatus::of(states), tasks: tasks.remove(states.phase) }).collect();
    if args.json {
        return Ok(print(&(serde_json::to_string_pretty(&rows).map_err(std::io::Error::other)? + "\n"))?);
    }
    print(&text(&plan, &rows))?;
    if rows.iter().any(|row| !row.phase.is_done()) {
        eprintln!("`strandflow run {}` does what is stale, missing or failed", args.take.display());
    }
    Ok(())
}

/// A phase, and its tasks where it was sent to a farm.
#[derive(Serialize)]
struct Row {
    #[serde(flatten)]
    phase: PhaseStatus,
    #[serde(skip_serializing_if = "Option::is_none")]
    tasks: Option<Tasks>,
}

fn text(plan: &Plan, rows: &[Row]) -> String {
    let mut text = format!("frames {}, mode {}\n", plan.frames, format!("{:?}", plan.mode).to_lowercase());
    text += &format!("{:<18}{:>7}{:>7}{:>7}{:>9}{:>8}\n", "phase", "items", "done", "stale", "missing", "failed");
    for Row { phase: p, tasks } in rows {
        let items = if p.items == 0 { "?".into() } else { p.items.to_string() };
        text += &format!("{:<18}{items:>7}{:>7}{:>7}{:>9}{:>8}\n", p.phase, p.done, p.stale, p.missing, p.failed);
        p.reasons.iter().for_each(|(reason, count)| text += &format!("    {count}× {reason}\n"));
        tasks.iter().for_each(|tasks| text += &format!("    {tasks}\n"));
    }
    text
}

/// Warns where a stage, or one before it, has results that rest on what has changed since; they are used all the same.
pub fn tell_of_outdated(take: &Take, plan: &Plan, stage: usize) -> Result<(), Failed> {
    let mut phases = status_before(take, plan, phase_range(STAGES[stage].name)?.end)?;
    phases.retain(|phase| phase.stale > 0);
    if !phases.is_empty() {
        eprintln!("warning: these results are not up to date:");
        phases.iter().for_each(|phase| eprintln!("  {phase}"));
        eprintln!("hint: `strandflow run {}` brings them up to date", take.root().display());
    }
    Ok(())
}
