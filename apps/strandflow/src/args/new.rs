//! What `new` takes.

use std::path::PathBuf;

use strandflow_io::calibration::{Convention, named_unit};

/// `strandflow new`.
#[derive(Debug, clap::Args)]
pub struct NewArgs {
    /// The folder to make.
    pub take: PathBuf,
    /// The footage in any folders: a video or a folder of images a view, clean plates, perhaps a calibration and user/.
    #[arg(long, value_name = "DIR")]
    pub capture: PathBuf,
    /// The calibration, in any format of docs/capture.md; looked for in the capture by its usual names without this.
    #[arg(long, value_name = "FILE")]
    pub calibration: Option<PathBuf>,
    /// The unit of the calibration where it does not say: mm, cm, m, or a number of millimetres.
    #[arg(long, value_name = "UNIT", value_parser = unit_mm)]
    pub unit: Option<f64>,
    /// What the calibration leaves open: w2c or c2w, opencv or opengl, pixel0 or pixel0.5, fisheye; joined by commas.
    #[arg(long, value_name = "WORDS", value_parser = str::parse::<Convention>)]
    pub convention: Option<Convention>,
    /// Frames per second of the recording, where neither calibration nor videos say or where they are wrong.
    #[arg(long, value_name = "RATE", value_parser = rate)]
    pub fps: Option<f64>,
    /// The direction up in the world: x, -x, y, -y, z or -z.
    #[arg(long, value_name = "AXIS", value_parser = axis, allow_hyphen_values = true)]
    pub up: Option<[f64; 3]>,
    /// A view that takes no part in the reconstruction, so that `evaluate` can judge the strands by it; may be repeated.
    #[arg(long, value_name = "VIEW")]
    pub hold_out: Vec<String>,
}

fn unit_mm(text: &str) -> Result<f64, String> {
    let number = || text.parse::<f64>().ok().filter(|mm| mm.is_finite() && *mm > 0.0);
    named_unit(text).or_else(number).ok_or_else(|| "write mm, cm, m or a number of millimetres".into())
}

fn rate(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|fps| (1.0..=100_000.0).contains(fps));
    number.ok_or_else(|| "write a number of frames a second, 1 to 100000".into())
}

fn axis(text: &str) -> Result<[f64; 3], String> {
    let (sign, name) = match text.strip_prefix('-') {
        Some(name) => (-1.0, name),
        None => (1.0, text.trim_start_matches('+')),
    };
    let at = ["x", "y", "z"].iter().position(|axis| axis.eq_ignore_ascii_case(name));
    let at = at.ok_or("write x, -x, y, -y, z or -z")?;
    let mut up = [0.0; 3];
    up[at] = sign;
    Ok(up)
}
