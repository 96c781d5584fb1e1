//! What `animate` takes.

use std::path::PathBuf;

use strandflow_core::FrameRange;

use super::TargetArg;

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
    /// A mesh (Wavefront OBJ, millimetres, the take's world) that stands still and hair may not enter, in place of the
    /// shoulders that the hulls show.
    #[arg(long, value_name = "FILE")]
    pub collide: Option<PathBuf>,
    /// Let hair through what stands still below the head.
    #[arg(long, conflicts_with = "collide")]
    pub no_shoulders: bool,
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
