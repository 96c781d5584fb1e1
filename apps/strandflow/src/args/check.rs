//! What `check` takes.

use std::path::PathBuf;

use strandflow_check::CHECKS;

/// The checks in words, for the help.
fn checks_in_order() -> String {
    let lines = CHECKS.iter().map(|check| format!("  {:<12} {}\n", check.name, check.looks_at));
    format!(
        "Checks, in order:\n{}\nExit codes: 0 nothing that cannot work, 1 something cannot work, 2 bad usage or no manifest.",
        lines.collect::<String>()
    )
}

/// `strandflow check`.
#[derive(Debug, clap::Args)]
#[command(after_help = checks_in_order())]
pub struct CheckArgs {
    /// The take.
    pub take: PathBuf,
    /// The last check to make; all without. Those that look at masks take longest, and come late.
    #[arg(long, value_name = "CHECK", value_parser = clap::builder::PossibleValuesParser::new(CHECKS.iter().map(|check| check.name)))]
    pub to: Option<String>,
    /// Refuse a take that names or links to files outside its folder; for takes of strangers (docs/security.md).
    #[arg(long)]
    pub confined: bool,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}
