//! One file per format: calibrations, images, video, strands, USD, Alembic, OpenVDB, hair cards.
//!
//! Readers trust nothing: sizes in headers are checked against the file before memory is taken, every error names the
//! file and the place in it and has a hint ([`IoError::hint`]). Lengths come out in millimetres.

pub mod alembic;
mod bytes;
pub mod calibration;
pub mod cards;
pub mod error;
pub mod exr_image;
pub mod groom;
pub mod guides;
pub mod image_file;
pub mod markers;
pub mod obj;
mod placed;
pub mod root_uv;
pub mod scene;
pub mod sketches;
pub mod source;
pub mod space;
pub mod strands;
pub mod usd;
pub mod vdb;
pub mod video_out;
pub mod whole_file;

pub use alembic::write_alembic;
pub use calibration::{Calibration, ReadOptions, read_calibration, read_calibration_with, rig_for_views};
pub use cards::Cards;
pub use error::{At, IoError, is_shortage};
pub use groom::{Groom, read_groom};
pub use guides::Guides;
pub use image_file::{mask_png, read_mask, read_rgb, write_mask_png, write_rgb_png, write_rgba_png};
pub use markers::{LabelledMarker, MarkerLabels, marker_labels_from_json, read_marker_labels, write_marker_labels};
pub use obj::read_obj;
pub use scene::SceneOptions;
pub use source::{SourceInfo, TakeSource, ViewInput, agreed_fps, probe};
pub use space::{Carrier, Space, Target, Up};
pub use strands::{
    Interchange, InterchangeFrame, StrandFrames,
    choose::ChosenStrands,
    hair::{read_hair, write_hair},
    npz::{NpzStrands, read_npz, write_npz},
    ply::write_ply,
    resample::Resampled,
    usc_data::{read_usc_data, write_usc_data},
};
pub use usd::write_usd;
pub use vdb::{VdbOptions, VectorGrid, read_vdb, write_velocity_vdb};
pub use video_out::{VIDEO_EXTENSIONS, VideoWriter};
pub use whole_file::{FolderError, write_bytes, write_folder};
