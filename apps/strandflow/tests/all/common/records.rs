//! Takes that say of phases that they are done without having done them.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

use std::path::Path;

use strandflow_core::RigidTransform;
use strandflow_engine::store::Writer;

use super::{FRAMES, cameras};

/// Particles of every strand.
pub const PARTICLES: usize = 40;

/// The images of the capture over and over, by links; nobody looks at them.
pub fn lengthen(capture: &Path, frames: usize) {
    for camera in cameras() {
        let folder = capture.join("images").join(&camera.name);
        for frame in FRAMES..frames {
            let of = folder.join(format!("{:06}.png", frame % FRAMES));
            std::fs::hard_link(of, folder.join(format!("{frame:06}.png"))).unwrap();
        }
    }
}

/// What later phases read by value of a phase of the whole take.
pub fn by_value(
    phase: &str,
    out: &mut Writer,
    frames: usize,
    strands: usize,
    world_from_head: impl Fn(usize) -> RigidTransform,
) {
    match phase {
        "hull/grid" => {
            out.whole("hull/grid/origin", &[3], &[0.0f64; 3]).unwrap();
            out.whole("hull/grid/voxel_mm", &[1], &[5.0f64]).unwrap();
            out.whole("hull/grid/dims", &[3], &[8u32; 3]).unwrap();
        }
        "pose/pose" => {
            let rows: Vec<f64> =
                (0..frames).flat_map(|t| world_from_head(t).to_rows().as_flattened().to_vec()).collect();
            out.whole("pose/world_from_head", &[frames, 4, 4], &rows).unwrap();
            out.whole("pose/markers", &[frames, 1, 3], &vec![0.0f64; 3 * frames]).unwrap();
            let views = cameras().len();
            out.whole("pose/tracks", &[frames, views, 1, 2], &vec![0.0f64; 2 * views * frames]).unwrap();
            out.whole("pose/rms_px", &[frames], &vec![0.0f64; frames]).unwrap();
            out.whole("pose/used", &[frames], &vec![0u32; frames]).unwrap();
            out.whole("pose/interpolated", &[frames], &vec![0u8; frames]).unwrap();
        }
        "scalp/scalp" => out.whole("scalp/roots", &[strands, 3], &vec![0.0f64; 3 * strands]).unwrap(),
        "smooth/topology" => out.whole("smooth/point_count", &[1], &[PARTICLES as u32]).unwrap(),
        _ => {}
    }
}
