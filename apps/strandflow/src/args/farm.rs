//! What `run` takes to send its work to other machines.

use std::path::PathBuf;

use clap::ValueEnum;
use strandflow_engine::farm::template::TEMPLATES;

/// Who does the work.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Engine {
    /// Threads of this process.
    #[default]
    Local,
    /// Slurm: an array of jobs a phase; `sbatch`, `squeue` and `scancel` must be on the path.
    Slurm,
    /// Any other scheduler: prints what a template makes of the tasks.
    Script,
}

/// Shorter tasks would spend a good part of their time on being started.
const TASK_SECS: f64 = 30.0;
/// Slurm takes arrays of up to 1001 tasks where nothing else is configured.
const MAX_TASKS: u32 = 1000;
const RETRIES: u32 = 2;

/// Part of `strandflow run`.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Many machines (docs/farm.md)")]
pub struct FarmArgs {
    /// Who does the work.
    #[arg(long, value_enum, default_value_t)]
    pub engine: Engine,
    /// Print what would be submitted, and submit nothing.
    #[arg(long)]
    pub dry_run: bool,
    /// Stay until all is done, tell of it, and submit again what failed.
    #[arg(long, conflicts_with_all = ["dry_run", "cancel"])]
    pub wait: bool,
    /// Cancel the take's jobs instead of submitting any.
    #[arg(long, conflicts_with = "dry_run")]
    pub cancel: bool,
    /// Seconds that a task lasts at least, where there is so much to do.
    #[arg(long, value_name = "SECS", default_value_t = TASK_SECS, value_parser = positive)]
    pub task_secs: f64,
    /// The most tasks of one phase.
    #[arg(long, value_name = "N", default_value_t = MAX_TASKS, value_parser = clap::value_parser!(u32).range(1..))]
    pub max_tasks: u32,
    /// The most tasks of one phase that run at once.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub throttle: Option<u32>,
    /// How often a failed task is tried again.
    #[arg(long, value_name = "N", default_value_t = RETRIES)]
    pub retries: u32,
    /// Partition.
    #[arg(long, value_name = "NAME")]
    pub partition: Option<String>,
    /// Account.
    #[arg(long, value_name = "NAME")]
    pub account: Option<String>,
    /// The most time of a task, as Slurm writes it.
    #[arg(long, value_name = "TIME")]
    pub time: Option<String>,
    /// Memory of a task, as Slurm writes it: `8G`.
    #[arg(long, value_name = "SIZE")]
    pub memory: Option<String>,
    /// A further option of `sbatch`, once for each: `--slurm-option=--qos=high`.
    #[arg(long, value_name = "OPTION", allow_hyphen_values = true)]
    pub slurm_option: Vec<String>,
    /// Template of `--engine script`: one that comes with the program, or a file.
    #[arg(long, value_name = "NAME|FILE", help = template_help())]
    pub template: Option<PathBuf>,
}

fn template_help() -> String {
    let names: Vec<&str> = TEMPLATES.iter().map(|(name, _)| *name).collect();
    format!("Template of `--engine script`: {}, or a file", names.join(", "))
}

fn positive(text: &str) -> Result<f64, String> {
    let secs = text.parse::<f64>().ok().filter(|secs| secs.is_finite() && *secs > 0.0);
    secs.ok_or_else(|| format!("`{text}` is no positive number of seconds"))
}

impl Default for FarmArgs {
    fn default() -> Self {
        Self {
            engine: Engine::Local,
            dry_run: false,
            wait: false,
            cancel: false,
            task_secs: TASK_SECS,
            max_tasks: MAX_TASKS,
            throttle: None,
            retries: RETRIES,
            partition: None,
            account: None,
            time: None,
            memory: None,
            slurm_option: Vec::new(),
            template: None,
        }
    }
}
