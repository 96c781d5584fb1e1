//! One file per format: calibrations, images, video, strands, USD.
//!
//! Readers trust nothing: sizes in headers are checked against the file before memory is taken, every error names the
//! file and the place in it and has a hint ([`IoError::hint`]). Lengths come out in millimetres.

mod bytes;
pub mod calibration;
pub mod error;
pub mod exr_image;
pub mod image_file;
pub mod markers;
pub mod source;
pub mod strands;
pub mod usd;
pub mod video_out;
pub mod whole_file;

pub use calibration::{Calibration, read_calibration, rig_for_views};
pub use error::{At, IoError};
pub use image_file::{read_mask, read_rgb, write_mask_png, write_rgb_png, write_rgba_png};
pub use markers::{LabelledMarker, MarkerLabels, read_marker_labels};
pub use source::{SourceInfo, TakeSource, ViewInput, probe};
pub use strands::{
    Interchange, InterchangeFrame, StrandFrames,
    hair::{read_hair, write_hair},
    npz::{NpzStrands, read_npz, write_npz},
    ply::write_ply,
    usc_data::{read_usc_data, write_usc_data},
};
pub use usd::{UsdOptions, write_usd};
pub use video_out::{VIDEO_EXTENSIONS, VideoWriter};
pub use whole_file::write_bytes;
