//! What `render`, `overlay` and `report` take: how strands are shown.

use std::path::PathBuf;

use clap::ValueEnum;
use strandflow_core::FrameRange;

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
    /// Render these strands instead, made by any program: a .npz with all frames, a file that
    /// `animate` takes as a groom (one frame), or a folder of such files, one a frame.
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
