//! What `evaluate` takes.

use std::path::PathBuf;

/// `strandflow evaluate`.
#[derive(Debug, clap::Args)]
pub struct EvaluateArgs {
    /// The take.
    pub take: PathBuf,
    /// Truth: the gt/ folder of a capture. Without it, strands are compared with the orientation maps and hair masks of
    /// views that were held out (`new --hold-out`, or `held_out` in the manifest); of all views where none was.
    #[arg(long, value_name = "DIR")]
    pub truth: Option<PathBuf>,
    /// Only this stage.
    #[arg(long, value_name = "STAGE")]
    pub stage: Option<String>,
    /// Score these strands instead, made by any program: a .npz with all frames, a file that
    /// `animate` takes as a groom (one frame), or a folder of such files, one a frame.
    #[arg(long, value_name = "FILE")]
    pub strands: Option<PathBuf>,
    /// Compare with strands that were drawn over two or more views: `user/sketches/000012.json` of the take, one file a frame.
    #[arg(long, conflicts_with = "strands")]
    pub sketches: bool,
    /// Also write everything as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}
