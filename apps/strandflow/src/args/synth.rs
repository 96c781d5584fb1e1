//! What `synth` and `demo` take.

use std::path::PathBuf;

use clap::ValueEnum;

/// `strandflow synth`.
#[derive(Debug, clap::Args)]
pub struct SynthArgs {
    /// The folder to make; with --groom the file.
    pub out: PathBuf,
    /// Make the groom only, as it hangs at rest: a .data, .hair (mm) or .npz file for `animate` and other programs.
    #[arg(long)]
    pub groom: bool,
    /// Style of the hair.
    #[arg(long, default_value = "straight")]
    pub style: StyleArg,
    /// As large as a real take (640×480, 9,000 strands) instead of the demo's size.
    #[arg(long)]
    pub full: bool,
    /// Number of frames.
    #[arg(long, value_name = "N")]
    pub frames: Option<usize>,
    /// Seed.
    #[arg(long)]
    pub seed: Option<u64>,
    /// A spec to go by instead, as TOML; every capture carries its own as synth.toml.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["full", "style"])]
    pub spec: Option<PathBuf>,
    /// Write over a capture that is there.
    #[arg(long)]
    pub force: bool,
}

/// `strandflow demo`.
#[derive(Debug, clap::Args)]
pub struct DemoArgs {
    /// The take to make.
    #[arg(long, default_value = "demo.take", value_name = "TAKE")]
    pub out: PathBuf,
    /// Write over an earlier demo.
    #[arg(long)]
    pub force: bool,
    /// Threads; all cores by default.
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
}

/// Styles of synthetic hair.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum StyleArg {
    /// Straight.
    Straight,
    /// Wavy.
    Wavy,
    /// Curly.
    Curly,
}

impl From<StyleArg> for strandflow_synth::Style {
    fn from(style: StyleArg) -> Self {
        match style {
            StyleArg::Straight => Self::Straight,
            StyleArg::Wavy => Self::Wavy,
            StyleArg::Curly => Self::Curly,
        }
    }
}
