//! `strandflow status`: what is done, stale, missing or failed, and why.

use strandflow_engine::{Take, status as state_of};

use crate::{args::StatusArgs, failure::Failed};

#[expect(clippy::print_stdout, reason = "the table is the data of this command")]
pub fn status(args: &StatusArgs) -> Result<(), Failed> {
    let take = Take::open(&args.take)?;
    let mut plan = take.last_plan()?;
    plan.mode = args.mode.map_or(plan.mode, Into::into);
    let phases = state_of(&take, &plan)?;
    if args.json {
        println!("{}", serde_json::to_string_pretty(&phases).map_err(std::io::Error::other)?);
        return Ok(());
    }
    println!("frames {}, mode {}", plan.frames, format!("{:?}", plan.mode).to_lowercase());
    println!("{:<18}{:>7}{:>7}{:>7}{:>9}{:>8}", "phase", "items", "done", "stale", "missing", "failed");
    for p in &phases {
        let items = if p.items == 0 { "?".into() } else { p.items.to_string() };
        println!("{:<18}{items:>7}{:>7}{:>7}{:>9}{:>8}", p.phase, p.done, p.stale, p.missing, p.failed);
        for (reason, count) in &p.reasons {
            println!("    {count}× {reason}");
        }
    }
    if phases.iter().any(|phase| !phase.is_done()) {
        eprintln!("`strandflow run {}` does what is stale, missing or failed", args.take.display());
    }
    Ok(())
}
