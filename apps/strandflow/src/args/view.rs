//! Looking at a take.

use std::path::PathBuf;

/// `strandflow view`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Prints the address of a page, on this machine alone, and serves it until Ctrl-C. On a headless server, make a tunnel from where the
browser is, as the command says. Nothing in the take is changed; a take that is being run can be watched. docs/view.md says more.")]
pub struct ViewArgs {
    /// The take; unfinished ones, and those without footage, show what they have.
    pub take: PathBuf,
    /// Port on 127.0.0.1; 0 is any free one. By default 8470, or any free one where that is in use.
    #[arg(long, value_name = "N")]
    pub port: Option<u16>,
    /// Truth of the capture (its gt/ folder), to show beside the results and to colour them by their error.
    #[arg(long, value_name = "DIR")]
    pub truth: Option<PathBuf>,
}
