//! What `export` takes: what can be written, in which format, for which program.

use std::path::PathBuf;

use clap::ValueEnum;

const EXPORTS: &str = "\
Examples:
  strandflow export TAKE --stage blend --to abc --for unreal --guides 200 OUT.abc
  strandflow export TAKE --stage blend --to usd --for houdini OUT.usdc
  strandflow export TAKE --stage blend --to usd --for blender --strands 1000 --points 16 OUT.usdc
  strandflow export TAKE --stage blend --to cards --for maya --guides 200 FOLDER
  strandflow export TAKE --stage blend --to cards --for unreal --guides 200 OUT.usdc
  strandflow export TAKE --stage flow --to vdb --for houdini FOLDER
  strandflow export TAKE --stage fit --to csv OUT.csv

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
    /// The file to write; for ply, hair, data, cards (but USD) and vdb, one file a frame, a folder.
    pub out: PathBuf,
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
    /// Hair cards with texture coordinates; needs --guides. A folder of OBJ meshes, one a frame; to a name that ends in .usd,
    /// .usda or .usdc, one animated mesh.
    Cards,
    /// OpenVDB, one file a frame; of --stage flow.
    Vdb,
    /// Fitted springs and drag in SI units, a row a strand, with what the motion tells of them; of --stage fit.
    Csv,
}
