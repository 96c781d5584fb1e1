//! What `new` takes.

use std::path::PathBuf;

/// `strandflow new`.
#[derive(Debug, clap::Args)]
pub struct NewArgs {
    /// The folder to make.
    pub take: PathBuf,
    /// The capture: video/ or images/, clean/, a calibration, user/.
    #[arg(long, value_name = "DIR")]
    pub capture: PathBuf,
    /// A view that takes no part in the reconstruction, so that `evaluate` can judge the strands by it; may be repeated.
    #[arg(long, value_name = "VIEW")]
    pub hold_out: Vec<String>,
}
