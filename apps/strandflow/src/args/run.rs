//! What `run`, `status` and `bench` take.

use std::path::PathBuf;

use clap::ValueEnum;
use strandflow_core::FrameRange;
use strandflow_engine::{ItemRange, STAGES};

use super::FarmArgs;

/// The stages in words, for the help.
fn stages_in_order() -> String {
    let lines = STAGES.iter().map(|stage| format!("  {:<8} {}\n", stage.name, stage.summary));
    format!("Stages, in order:\n{}", lines.collect::<String>())
}

/// `strandflow run`.
#[derive(Debug, clap::Args)]
#[command(after_help = stages_in_order())]
pub struct RunArgs {
    /// The take.
    pub take: PathBuf,
    /// First stage, or one phase of it (`smooth/trim`); what comes before is taken as it is, with a warning where it is not up
    /// to date.
    #[arg(long, value_name = "STAGE")]
    pub from: Option<String>,
    /// Last stage, or one phase of it.
    #[arg(long, value_name = "STAGE")]
    pub to: Option<String>,
    /// A task among many: work items A to B − 1 of the phase that --from and --to name, or run number N of K each; docs/farm.md.
    #[arg(long, value_name = "A..B|NxK", requires = "from", requires = "to")]
    pub items: Option<ItemRange>,
    /// Treat the take as these frames only; masks, hulls and poses also cover what leads up to them.
    #[arg(long, value_name = "A..B")]
    pub frames: Option<FrameRange>,
    /// Reading of the method; the manifest's by default.
    #[arg(long)]
    pub mode: Option<ModeArg>,
    /// Threads; also the most work items in memory. All cores by default.
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Read all results that are there, and make again what is not as it was written.
    #[arg(long)]
    pub verify: bool,
    /// Refuse a take that names or links to files outside its folder; for takes of strangers (docs/security.md).
    #[arg(long)]
    pub confined: bool,
    /// Run also where the look over the take before the first stage finds what cannot work.
    #[arg(long)]
    pub unchecked: bool,
    /// Print events as lines of JSON instead of progress bars.
    #[arg(long)]
    pub json: bool,
    /// Where the work is done.
    #[command(flatten)]
    pub farm: FarmArgs,
}

/// `strandflow status`.
#[derive(Debug, clap::Args)]
pub struct StatusArgs {
    /// The take.
    pub take: PathBuf,
    /// Reading of the method to judge by; the last run's by default.
    #[arg(long)]
    pub mode: Option<ModeArg>,
    /// Read all results, and say which are not as they were written.
    #[arg(long)]
    pub verify: bool,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// `strandflow bench`.
#[derive(Debug, clap::Args)]
pub struct BenchArgs {
    /// Frames of the strand that is refined.
    #[arg(long, default_value_t = 200, value_name = "N", value_parser = clap::value_parser!(u32).range(6..=100_000))]
    pub frames: u32,
}

/// The two readings of the method.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum ModeArg {
    /// The letter of the paper.
    Paper,
    /// What measures best.
    Robust,
}

impl From<ModeArg> for strandflow_stages::Mode {
    fn from(mode: ModeArg) -> Self {
        match mode {
            ModeArg::Paper => Self::Paper,
            ModeArg::Robust => Self::Robust,
        }
    }
}
