//! Labelling and correcting a take.

use std::path::PathBuf;

/// `strandflow annotate`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Prints the address of a page, on this machine alone, and serves it until Ctrl-C. Every stroke is saved at once, into TAKE/user/; where
the manifest names labels and masks elsewhere, they are copied there before the first change, and the manifest names the copies from
then on. `strandflow run` repeats what rests on what was changed. docs/annotate.md says more.")]
pub struct AnnotateArgs {
    /// The take; it needs its footage and calibration, not its results.
    pub take: PathBuf,
    /// Port on 127.0.0.1; 0 is any free one. By default 8470, or any free one where that is in use.
    #[arg(long, value_name = "N")]
    pub port: Option<u16>,
}
