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
    #[arg(long, conflicts_with = "strands", group = "drawn")]
    pub sketches: bool,
    /// Compare with N true strands as a person would draw them: those of all lengths that three views show, in up to ten
    /// frames, with a pixel of hand noise. Writes no sketches; scores nothing else against the truth.
    #[arg(long, value_name = "N", group = "drawn", requires = "truth", conflicts_with = "strands",
          value_parser = clap::value_parser!(u16).range(1..))]
    pub sketch_truth: Option<u16>,
    /// Also draw the length over time of the longest drawn strand, by stage.
    #[arg(long, value_name = "FILE.svg", requires = "drawn")]
    pub plot: Option<PathBuf>,
    /// Also write everything as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}
