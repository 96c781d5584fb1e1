//! The admissible ranges of a spec.

use crate::spec::SynthSpec;

/// A violation of the admissible range of a field: its name, what is wrong, and what to write.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{field}: {fact}; {hint}")]
pub struct SpecViolation {
    /// The field, as in the file ("rig.frames").
    pub field: &'static str,
    /// What is wrong.
    pub fact: String,
    /// What to write instead.
    pub hint: &'static str,
}

impl SynthSpec {
    /// All violations of the admissible ranges.
    pub fn check(&self) -> Vec<SpecViolation> {
        let mut out = Vec::new();
        let mut range = |field, value: f64, low: f64, high: f64, hint| {
            if value.is_nan() || value < low || value > high {
                out.push(SpecViolation { field, fact: format!("{value} is outside {low}..={high}"), hint });
            }
        };
        let Self { rig, groom, motion, physics, body, hand, noise, .. } = self;
        range("rig.frames", rig.frames as f64, 1.0, 10_000.0, "write at least one frame");
        range("rig.fps", rig.fps, 1.0, 10_000.0, "write frames a second");
        range("rig.views", rig.views as f64, 1.0, 64.0, "the chain needs three views or more");
        range("rig.width", rig.width as f64, 16.0, 8192.0, "write the image width in pixels");
        range("rig.height", rig.height as f64, 16.0, 8192.0, "write the image height in pixels");
        range("rig.focal_px", rig.focal_px, 100.0, 20_000.0, "write the focal length in pixels at 640 px width");
        range("rig.distance_mm", rig.distance_mm, 500.0, 10_000.0, "write millimetres; 1500 is usual");
        range("rig.arc_deg", rig.arc_deg, 0.0, 360.0, "write degrees around the head");
        range("rig.subsamples", rig.subsamples as f64, 1.0, 8.0, "4 is usual");
        range("groom.strands", groom.strands as f64, 1.0, 200_000.0, "write a number of strands");
        range("groom.guides", groom.guides as f64, 1.0, groom.strands.max(1) as f64, "at most the number of strands");
        range("groom.length_mm", groom.length_mm, 20.0, 1000.0, "write millimetres");
        range("groom.cut_below_mm", groom.cut_below_mm, -100.0, 1000.0, "write millimetres below the head's centre");
        range("groom.edge_mm", groom.edge_mm, 1.0, 20.0, "5 is usual");
        range("groom.width_mm", groom.width_mm, 0.02, 5.0, "write millimetres");
        range("groom.layer_mm", groom.layer_mm, 0.0, 60.0, "write millimetres");
        range("groom.wave_mm", groom.wave_mm, 0.0, 30.0, "write millimetres");
        range("groom.wave_length_mm", groom.wave_length_mm, 10.0, 500.0, "write millimetres");
        range("groom.wave_from", groom.wave_from, 0.0, 1.0, "write a share of the strand");
        range("groom.frizz_mm", groom.frizz_mm, 0.0, 20.0, "write millimetres");
        range("groom.clump", groom.clump, 0.0, 1.0, "write a share");
        range("groom.colour_variation", groom.colour_variation, 0.0, 2.0, "0.3 is usual");
        for value in groom.colour {
            range("groom.colour", value, 0.0, 1.0, "write linear red, green and blue");
        }
        range("motion.turn_deg", motion.turn_deg, -90.0, 90.0, "write degrees");
        range("motion.nod_deg", motion.nod_deg, -45.0, 45.0, "write degrees");
        range("motion.rate_hz", motion.rate_hz, 0.0, 5.0, "write swings a second");
        range("motion.sway_mm", motion.sway_mm, -500.0, 500.0, "write millimetres");
        range("body.breadth_mm", body.breadth_mm, 0.0, 700.0, "write millimetres; 400 is usual, 0 none");
        range("hand.radius_mm", hand.radius_mm, 0.0, 200.0, "write millimetres, 0 for none");
        range("hand.distance_mm", hand.distance_mm, 0.0, 450.0, "write millimetres, nearer than any camera");
        range("hand.rate_hz", hand.rate_hz, -5.0, 5.0, "write turns a second");
        range("physics.substeps", physics.substeps as f64, 1.0, 100.0, "10 is usual");
        range("physics.settle_secs", physics.settle_secs, 0.0, 60.0, "write seconds");
        for value in physics.stiffness {
            range("physics.stiffness", value, 0.0, 1e10, "write 1/s²: edge, bend, torsion, altitude");
        }
        range("physics.damping_secs", physics.damping_secs, 0.0, 1.0, "write seconds");
        range("physics.drag", physics.drag, 0.0, 1000.0, "write 1/s");
        range("physics.friction", physics.friction, 0.0, 10_000.0, "write 1/s");
        range("physics.clearance_mm", physics.clearance_mm, 0.0, 20.0, "write millimetres");
        range("noise.image_sigma", noise.image_sigma, 0.0, 255.0, "write 8-bit levels");
        range("noise.blur_px", noise.blur_px, 0.0, 50.0, "write pixels");
        range("noise.defocus_px", noise.defocus_px, 0.0, 50.0, "write pixels");
        range("noise.mask_px", noise.mask_px, 0.0, 100.0, "write pixels");
        range("noise.label_px", noise.label_px, 0.0, 100.0, "write pixels");
        range("noise.calibration_px", noise.calibration_px, 0.0, 100.0, "write pixels");
        range("noise.sync_ms", noise.sync_ms, 0.0, 1000.0, "write milliseconds");
        range("noise.shutter", noise.shutter, 0.0, 1.0, "write a share of the time between frames");
        range("noise.light_stops", noise.light_stops, -3.0, 3.0, "write stops");
        out
    }
}
