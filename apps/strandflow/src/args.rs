//! All of clap: what can be typed. Resolved into domain objects by the subcommands before any work starts.

use std::path::PathBuf;

use clap::{Parser, Subcommand, ValueEnum};
use strandflow_core::FrameRange;
use strandflow_engine::STAGES;

const FIRST_STEPS: &str = "\
First steps:
  strandflow demo                           a small synthetic take, all stages, scores, exports
  strandflow new TAKE --capture DIR         DIR: video/, clean/, calibration.json, user/ (docs/capture.md)
  strandflow run TAKE                       resumes where it stopped; Ctrl-C loses nothing
  strandflow status TAKE
  strandflow export TAKE --stage blend --to usd OUT.usdc";

/// The stages in words, for the help.
fn stages_in_order() -> String {
    let lines = STAGES.iter().map(|stage| format!("  {:<8} {}\n", stage.name, stage.summary));
    format!("Stages, in order:\n{}", lines.collect::<String>())
}

/// Multi-view video of moving hair in, animated strands with fitted physics out.
///
/// Exit codes: 0 done, 1 failed, 2 bad usage or bad input.
#[derive(Debug, Parser)]
#[command(name = "strandflow", version, propagate_version = true, after_help = FIRST_STEPS)]
pub struct Args {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The subcommands, one file each.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Scaffold a take from a capture folder; copies nothing.
    New(NewArgs),
    /// Run the stages; resumes where a run stopped, repeats what is stale.
    Run(RunArgs),
    /// What is done, stale, missing or failed, and why.
    Status(StatusArgs),
    /// Score results against truth, and in views that were held out.
    Evaluate(EvaluateArgs),
    /// Write strands in a format that other programs read.
    Export(ExportArgs),
    /// Draw strands over one image of the footage.
    Overlay(OverlayArgs),
    /// Render strands as hair: a still, a turntable or the footage's own view, as PNG or video.
    Render(RenderArgs),
    /// Make a synthetic capture with truth.
    Synth(SynthArgs),
    /// Make a small synthetic capture, run everything on it, score it and write exports. Needs no file.
    Demo(DemoArgs),
    /// Time the dynamics on this machine: kernels, a strand, threads.
    Bench(BenchArgs),
}

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

/// `strandflow run`.
#[derive(Debug, clap::Args)]
#[command(after_help = stages_in_order())]
pub struct RunArgs {
    /// The take.
    pub take: PathBuf,
    /// First stage; what comes before is taken as it is, with a warning where it is not up to date.
    #[arg(long, value_name = "STAGE")]
    pub from: Option<String>,
    /// Last stage.
    #[arg(long, value_name = "STAGE")]
    pub to: Option<String>,
    /// Treat the take as these frames only; masks, hulls and poses also cover what leads up to them.
    #[arg(long, value_name = "A..B")]
    pub frames: Option<FrameRange>,
    /// Reading of the method; the manifest's by default.
    #[arg(long)]
    pub mode: Option<ModeArg>,
    /// Threads; also the most work items in memory. All cores by default.
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Print events as lines of JSON instead of progress bars.
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

/// `strandflow status`.
#[derive(Debug, clap::Args)]
pub struct StatusArgs {
    /// The take.
    pub take: PathBuf,
    /// Reading of the method to judge by; the last run's by default.
    #[arg(long)]
    pub mode: Option<ModeArg>,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// `strandflow export`.
#[derive(Debug, clap::Args)]
pub struct ExportArgs {
    /// The take.
    pub take: PathBuf,
    /// Strands of which stage.
    #[arg(long)]
    pub stage: SequenceStage,
    /// The format.
    #[arg(long, value_name = "FORMAT")]
    pub to: Format,
    /// The file to write; for ply, hair and data (one file a frame) a folder.
    pub out: PathBuf,
}

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
    /// Score these strands instead, made by any program: a .npz, or a folder of .hair or .data files, one a frame.
    #[arg(long, value_name = "FILE")]
    pub strands: Option<PathBuf>,
    /// Also write everything as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// `strandflow overlay`.
#[derive(Debug, clap::Args)]
pub struct OverlayArgs {
    /// The take.
    pub take: PathBuf,
    /// Strands of which stage.
    #[arg(long, default_value = "blend")]
    pub stage: SequenceStage,
    /// The view.
    #[arg(long)]
    pub view: String,
    /// The frame.
    #[arg(long)]
    pub frame: usize,
    /// Draw every N-th strand.
    #[arg(long, default_value_t = 8, value_name = "N")]
    pub every: usize,
    /// Colour by provenance: green observed, blue diffused, orange simulated, magenta completed.
    #[arg(long)]
    pub provenance: bool,
    /// The PNG to write.
    pub out: PathBuf,
}

/// `strandflow render`.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("camera_of").args(["view", "turntable"]))]
pub struct RenderArgs {
    /// The take.
    pub take: PathBuf,
    /// Strands of which stage.
    #[arg(long, default_value = "blend")]
    pub stage: SequenceStage,
    /// Render these strands instead, made by any program: a .npz, or a folder of .hair or .data files, one a frame.
    #[arg(long, value_name = "FILE")]
    pub strands: Option<PathBuf>,
    /// The camera: a view of the take, or of --camera; the first one by default.
    #[arg(long, value_name = "VIEW")]
    pub view: Option<String>,
    /// N pictures around the head, of the frames in turn (by default of one frame that stands still).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub turntable: Option<u32>,
    /// A calibration with the camera, in any format that `new` reads, in the take's world.
    #[arg(long, value_name = "FILE", conflicts_with = "turntable")]
    pub camera: Option<PathBuf>,
    /// Frames; all by default, of a still the first.
    #[arg(long, value_name = "A..B")]
    pub frames: Option<FrameRange>,
    /// Size of the picture; the camera's by default.
    #[arg(long, value_name = "WxH")]
    pub size: Option<String>,
    /// brown, black, blond, red, grey, or #rrggbb: what a thick bundle shows in white light.
    #[arg(long, default_value = "brown")]
    pub colour: String,
    /// plate (the view without the subject), footage, paper, #rrggbb, or none (transparent PNG).
    #[arg(long, default_value = "paper")]
    pub background: String,
    /// Share of a frame for which the shutter is open; 0 is sharp.
    #[arg(long, default_value_t = 0.5, value_name = "SHARE")]
    pub motion_blur: f32,
    /// Hairs drawn for each strand; by default as many as make the hair look full.
    #[arg(long, value_name = "N")]
    pub density: Option<usize>,
    /// Rounds by which strands are freed from the trembling of captured ones; 0 draws them as they are.
    #[arg(long, default_value_t = 4, value_name = "N")]
    pub polish: usize,
    /// Threads; all cores by default.
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// OUT.png is a still, OUT.mp4, .mov or .webm a video (by ffmpeg), any other name a folder of numbered PNGs.
    pub out: PathBuf,
}

/// `strandflow synth`.
#[derive(Debug, clap::Args)]
pub struct SynthArgs {
    /// The folder to make.
    pub out: PathBuf,
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

/// Stages whose result is strands of fixed topology.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SequenceStage {
    /// Smoothed and trimmed.
    Smooth,
    /// Explained by simulation.
    Fit,
    /// Warped, interpolated and completed.
    Blend,
}

impl SequenceStage {
    /// Name of the stage.
    pub fn name(self) -> &'static str {
        match self {
            Self::Smooth => "smooth",
            Self::Fit => "fit",
            Self::Blend => "blend",
        }
    }
}

/// Formats of strands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// Arrays for numpy: points, valid, frame, provenance, confidence, head_from_world.
    Npz,
    /// Stanford PLY, one file a frame.
    Ply,
    /// Cem Yuksel's hair files, one a frame.
    Hair,
    /// USC-HairSalon data files, one a frame.
    Data,
    /// Animated USD curves.
    Usd,
}
