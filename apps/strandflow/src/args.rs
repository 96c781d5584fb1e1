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
    /// Write strands, guides, hair cards or the velocity field in a format that other programs read.
    Export(ExportArgs),
    /// Drive another groom with the captured motion; needs the results of a take, not its footage.
    Animate(AnimateArgs),
    /// Draw strands over one image of the footage.
    Overlay(OverlayArgs),
    /// Render strands as hair: a still, a turntable or the footage's own view, as PNG or video.
    Render(RenderArgs),
    /// Write a page that says how a take stands: health by stage, strands over footage, plots, time, what to do next.
    Report(ReportArgs),
    /// Look at a take in the browser: strands in 3D and over footage, layers, timeline, one strand over time.
    View(ViewArgs),
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

const EXPORTS: &str = "\
Examples:
  strandflow export TAKE --stage blend --to abc --for unreal --guides 200 OUT.abc
  strandflow export TAKE --stage blend --to usd --for houdini OUT.usdc
  strandflow export TAKE --stage blend --to usd --for blender --strands 1000 --points 16 OUT.usdc
  strandflow export TAKE --stage blend --to cards --for maya --guides 200 FOLDER
  strandflow export TAKE --stage flow --to vdb --for houdini FOLDER

Without --for, lengths are millimetres and Z is up in abc, usd, cards and vdb; the other formats keep the take's world.
docs/formats.md says what each format holds.";

/// `strandflow export`.
#[derive(Debug, clap::Args)]
#[command(after_help = EXPORTS)]
pub struct ExportArgs {
    /// The take.
    pub take: PathBuf,
    /// Strands of which stage; `flow` is the velocity field.
    #[arg(long, required_unless_present = "animation")]
    pub stage: Option<ExportStage>,
    /// Instead of a stage, an animation made by `animate`.
    #[arg(long, value_name = "NAME", conflicts_with = "stage")]
    pub animation: Option<String>,
    /// The format.
    #[arg(long, value_name = "FORMAT")]
    pub to: Format,
    /// The program it is for, which decides unit and up axis of abc, usd, cards and vdb.
    #[arg(long = "for", value_name = "PROGRAM")]
    pub target: Option<TargetArg>,
    /// At most so many strands, spread evenly over the scalp.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub strands: Option<u32>,
    /// So many points on every strand, evenly spaced along it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(2..))]
    pub points: Option<u16>,
    /// At most so many guides: strands that stand for those around them. abc holds them beside the strands, cards run along
    /// them, the other formats hold the guides alone.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub guides: Option<u32>,
    /// The file to write; for ply, hair, data, cards and vdb (one file a frame) a folder.
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

/// `strandflow animate`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The groom may be a .hair, .data or .npz file (its first frame), or `captured`: the take's own strands after `blend`.
Its roots are brought onto the captured scalp by the way up in which they cover it best and ICP with scale, then projected.
Export the result with `strandflow export TAKE --animation NAME`; run the same command again to go on where it stopped.")]
pub struct AnimateArgs {
    /// The take; its results suffice.
    pub take: PathBuf,
    /// The groom, or `captured`: .hair, .data, .npz, .ply, .abc (Ogawa), .usda or .usdc; of files that move the first frame.
    #[arg(long, value_name = "FILE")]
    pub groom: PathBuf,
    /// Name of the animation within the take; that of the groom's file by default.
    #[arg(long)]
    pub name: Option<String>,
    /// Millimetres that a unit of the groom's file is, where the file does not say (1 by default); a further factor where it
    /// does (USD, .data).
    #[arg(long, value_name = "MM")]
    pub scale: Option<f64>,
    /// Take the groom as it lies, in the world of the first frame shown.
    #[arg(long)]
    pub as_given: bool,
    /// Bring the groom into that world by this transform: a text file of 4 rows of 4 numbers, scale included.
    #[arg(long, value_name = "FILE", conflicts_with = "as_given")]
    pub transform: Option<PathBuf>,
    /// Captured frames to show; all by default.
    #[arg(long, value_name = "A..B")]
    pub frames: Option<FrameRange>,
    /// Captured frames a frame: 0.5 is half speed.
    #[arg(long, default_value_t = 1.0)]
    pub speed: f64,
    /// Frames to make; more than the capture has go to and fro without a seam.
    #[arg(long, value_name = "N")]
    pub length: Option<usize>,
    /// Factor of the captured motion beside the head's: 0 moves with the head, 1 as captured.
    #[arg(long, default_value_t = 1.0, value_name = "FACTOR")]
    pub amplitude: f64,
    /// Seconds over which the hair's velocity goes to the captured one: 0 (the default) follows, longer swings by itself.
    #[arg(long, value_name = "SECONDS")]
    pub follow: Option<f64>,
    /// Do not use the captured field: simulate the groom on the moving head.
    #[arg(long)]
    pub undriven: bool,
    /// Factor of the stiffness that keeps the groom's shape.
    #[arg(long, default_value_t = 1.0, value_name = "FACTOR")]
    pub stiffness: f64,
    /// Take stiffness and damping of the captured strand nearest to each root.
    #[arg(long)]
    pub fitted_springs: bool,
    /// Factor of the spring damping.
    #[arg(long, default_value_t = 1.0, value_name = "FACTOR")]
    pub damping: f64,
    /// Drag of the air [1/s].
    #[arg(long, value_name = "RATE")]
    pub drag: Option<f64>,
    /// How much strands differ in stiffness (standard deviation of the logarithm).
    #[arg(long, default_value_t = 0.0, value_name = "SHARE")]
    pub variation: f64,
    /// Seed of that.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Drive with these OpenVDB files, 000012.vdb for frame 12, instead of the stored field: one that `export --to vdb` wrote
    /// and another program changed.
    #[arg(long, value_name = "FOLDER", conflicts_with = "true_field")]
    pub field: Option<PathBuf>,
    /// The program that those files are laid out for.
    #[arg(long, value_name = "PROGRAM", requires = "field")]
    pub field_for: Option<TargetArg>,
    /// Truth of the capture (its gt/ folder): with `--groom truth` its first frame is the groom. Every frame is compared with it.
    #[arg(long, value_name = "DIR")]
    pub truth: Option<PathBuf>,
    /// Drive with the field of the true strands, made as stage `flow` makes one of the fitted.
    #[arg(long, requires = "truth")]
    pub true_field: bool,
    /// Threads; all cores by default.
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Print the summary as JSON.
    #[arg(long)]
    pub json: bool,
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
    /// Render an animation made by `animate` instead.
    #[arg(long, value_name = "NAME", conflicts_with = "strands")]
    pub animation: Option<String>,
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

/// `strandflow report`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The page is one file without scripts that needs no network: it can be mailed, printed, and read on a phone. It is written for an
unfinished take too, and says what is missing. docs/report.md says what each part shows.")]
pub struct ReportArgs {
    /// The take.
    pub take: PathBuf,
    /// A frame whose pictures are shown; may be repeated. By default three, from all over the take.
    #[arg(long, value_name = "N")]
    pub frame: Vec<usize>,
    /// A view whose pictures are shown; may be repeated. By default three, from all around.
    #[arg(long, value_name = "VIEW")]
    pub view: Vec<String>,
    /// The page to write; TAKE/report.html by default.
    pub out: Option<PathBuf>,
}

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

/// What can be exported: stages of strands, and the velocity field.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ExportStage {
    /// Smoothed and trimmed strands.
    Smooth,
    /// Strands explained by simulation.
    Fit,
    /// Warped, interpolated and completed strands.
    Blend,
    /// The velocity field.
    Flow,
}

impl ExportStage {
    /// Name of the stage.
    pub fn name(self) -> &'static str {
        match self {
            Self::Smooth => "smooth",
            Self::Fit => "fit",
            Self::Blend => "blend",
            Self::Flow => "flow",
        }
    }
}

/// Programs that files are meant for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TargetArg {
    /// Centimetres, Z up; Alembic mirrored into Unreal's left-handed space.
    Unreal,
    /// Metres, Y up.
    Houdini,
    /// Metres, Z up; Alembic and cards Y up, which Blender's importers turn.
    Blender,
    /// Centimetres, Y up.
    Maya,
}

impl From<TargetArg> for strandflow_io::Target {
    fn from(target: TargetArg) -> Self {
        match target {
            TargetArg::Unreal => Self::Unreal,
            TargetArg::Houdini => Self::Houdini,
            TargetArg::Blender => Self::Blender,
            TargetArg::Maya => Self::Maya,
        }
    }
}

/// Formats of strands and of the velocity field.
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
    /// Animated Alembic curves with Unreal's groom attributes.
    Abc,
    /// Hair cards with texture coordinates as OBJ meshes, one file a frame; needs --guides.
    Cards,
    /// OpenVDB, one file a frame; of --stage flow.
    Vdb,
}
