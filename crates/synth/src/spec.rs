//! What to synthesise. Lengths in millimetres, times in seconds, angles in degrees.

use serde::{Deserialize, Serialize};

/// The shape of the strands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Style {
    /// Smooth strands that fall from the crown.
    #[default]
    Straight,
    /// Parted, straight at the roots, waves towards the tips.
    Wavy,
    /// Helices.
    Curly,
}

/// A synthetic capture. `Default` is the small take of the demo; [`SynthSpec::full`] is as large as a real one.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SynthSpec {
    /// Seed of everything random.
    pub seed: u64,
    /// Frames and cameras.
    pub rig: RigSpec,
    /// The hair.
    pub groom: GroomSpec,
    /// The head's motion.
    pub motion: MotionSpec,
    /// The strands' physics.
    pub physics: PhysicsSpec,
    /// What is wrong with the footage.
    pub noise: NoiseSpec,
}

/// Frames and cameras: the views stand around the back and the sides of the head.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RigSpec {
    /// Frames.
    pub frames: usize,
    /// Frames a second.
    pub fps: f64,
    /// Cameras.
    pub views: usize,
    /// Image width \[px\].
    pub width: usize,
    /// Image height \[px\].
    pub height: usize,
    /// Mean focal length at a width of 640 px \[px\]; scaled with the width.
    pub focal_px: f64,
    /// Mean distance of the cameras from the head \[mm\].
    pub distance_mm: f64,
    /// The views spread over this angle, centred on the back of the head \[°\].
    pub arc_deg: f64,
    /// Sub-samples of a pixel along each side.
    pub subsamples: usize,
}

/// The hair.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GroomSpec {
    /// Shape of the strands.
    pub style: Style,
    /// Strands.
    pub strands: usize,
    /// Strands that are simulated; the others follow the nearest of them.
    pub guides: usize,
    /// Longest strands \[mm\].
    pub length_mm: f64,
    /// Strands end where they pass this height below the head's centre \[mm\].
    pub cut_below_mm: f64,
    /// Distance of a strand's points \[mm\].
    pub edge_mm: f64,
    /// Thickness of a strand as rendered \[mm\].
    pub width_mm: f64,
    /// Whether the hair is parted in the middle.
    pub part: bool,
    /// Height of the outermost layer of hair above the scalp \[mm\].
    pub layer_mm: f64,
    /// Amplitude of the waves, radius of the curls \[mm\].
    pub wave_mm: f64,
    /// Length of a wave, pitch of a curl \[mm\].
    pub wave_length_mm: f64,
    /// Share of the strand at which the waves begin.
    pub wave_from: f64,
    /// Amplitude of the strands' small disorder \[mm\].
    pub frizz_mm: f64,
    /// How far the tips gather into locks, 0 to 1.
    pub clump: f64,
    /// Share of light that a strand returns, linear RGB.
    pub colour: [f64; 3],
    /// Standard deviation of the logarithm of a strand's brightness.
    pub colour_variation: f64,
}

/// The head's motion: almost still, then a swing about the neck.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MotionSpec {
    /// Frames at the start in which the head is almost still.
    pub quiet_frames: usize,
    /// Greatest turn about the vertical \[°\].
    pub turn_deg: f64,
    /// Greatest nod \[°\].
    pub nod_deg: f64,
    /// Swings a second \[Hz\].
    pub rate_hz: f64,
}

/// The strands' physics: the model of `strandflow-dynamics`, at a finer step than the fit's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PhysicsSpec {
    /// Steps a frame.
    pub substeps: usize,
    /// Time the hair is given to settle before the first frame \[s\].
    pub settle_secs: f64,
    /// Stiffness of edge, bend, torsion and altitude springs per unit mass \[1/s²\].
    pub stiffness: [f64; 4],
    /// Damping of a spring is its stiffness times this \[s\].
    pub damping_secs: f64,
    /// Drag \[1/s\].
    pub drag: f64,
    /// Share of the sliding speed that contact with the head takes away each step.
    pub friction: f64,
    /// Distance strands keep from the skin \[mm\].
    pub clearance_mm: f64,
}

/// What is wrong with the footage. Zero everywhere is a perfect capture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NoiseSpec {
    /// Standard deviation of the sensor's noise, in 8-bit levels.
    pub image_sigma: f64,
    /// Standard deviation of the lens blur \[px\].
    pub blur_px: f64,
    /// Further blur of single views that are out of focus, up to this \[px\].
    pub defocus_px: f64,
    /// Displacement of the outline of the given hair masks \[px\].
    pub mask_px: f64,
    /// Error of the clicked marker labels \[px\].
    pub label_px: f64,
    /// Error of the given calibration in the image \[px\].
    pub calibration_px: f64,
    /// Views are up to this much early or late \[ms\].
    pub sync_ms: f64,
}

impl Default for RigSpec {
    fn default() -> Self {
        Self {
            frames: 14,
            fps: 100.0,
            views: 7,
            width: 400,
            height: 300,
            focal_px: 1850.0,
            distance_mm: 1500.0,
            arc_deg: 250.0,
            subsamples: 4,
        }
    }
}

impl Default for GroomSpec {
    fn default() -> Self {
        Self {
            style: Style::Straight,
            strands: 3000,
            guides: 200,
            length_mm: 230.0,
            cut_below_mm: 120.0,
            edge_mm: 5.0,
            width_mm: 0.5,
            part: false,
            layer_mm: 14.0,
            wave_mm: 0.0,
            wave_length_mm: 60.0,
            wave_from: 0.4,
            frizz_mm: 1.2,
            clump: 0.3,
            colour: [0.32, 0.185, 0.09],
            colour_variation: 0.3,
        }
    }
}

impl Default for MotionSpec {
    fn default() -> Self {
        Self { quiet_frames: 7, turn_deg: 26.0, nod_deg: 5.0, rate_hz: 1.5 }
    }
}

impl Default for PhysicsSpec {
    fn default() -> Self {
        Self {
            substeps: 4,
            settle_secs: 0.4,
            stiffness: [1e7, 1e5, 1e5, 1e4],
            damping_secs: 1e-3,
            drag: 3.0,
            friction: 0.05,
            clearance_mm: 1.0,
        }
    }
}

impl Default for NoiseSpec {
    fn default() -> Self {
        Self {
            image_sigma: 2.0,
            blur_px: 0.35,
            defocus_px: 0.0,
            mask_px: 0.0,
            label_px: 0.3,
            calibration_px: 0.0,
            sync_ms: 0.0,
        }
    }
}

impl NoiseSpec {
    /// A perfect capture.
    pub fn none() -> Self {
        Self {
            image_sigma: 0.0,
            blur_px: 0.0,
            defocus_px: 0.0,
            mask_px: 0.0,
            label_px: 0.0,
            calibration_px: 0.0,
            sync_ms: 0.0,
        }
    }
}

impl GroomSpec {
    /// A groom of this style, with the number of strands of the demo.
    pub fn of_style(style: Style) -> Self {
        let base = Self { style, ..Self::default() };
        match style {
            Style::Straight => base,
            Style::Wavy => Self {
                length_mm: 380.0,
                cut_below_mm: 230.0,
                part: true,
                wave_mm: 6.0,
                wave_length_mm: 65.0,
                frizz_mm: 1.5,
                clump: 0.45,
                ..base
            },
            Style::Curly => Self {
                length_mm: 260.0,
                cut_below_mm: 130.0,
                wave_mm: 6.5,
                wave_length_mm: 38.0,
                wave_from: 0.08,
                layer_mm: 18.0,
                frizz_mm: 1.5,
                clump: 0.6,
                ..base
            },
        }
    }
}

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
    /// The small take of the demo in this style: seconds to make.
    pub fn demo(style: Style) -> Self {
        Self { groom: GroomSpec::of_style(style), ..Self::default() }
    }

    /// A take as large as a real one: 640×480, 9,000 strands of 0.26 mm.
    pub fn full(style: Style, frames: usize) -> Self {
        Self {
            rig: RigSpec { frames, width: 640, height: 480, focal_px: 1650.0, ..RigSpec::default() },
            groom: GroomSpec { strands: 9000, guides: 500, width_mm: 0.26, ..GroomSpec::of_style(style) },
            physics: PhysicsSpec { settle_secs: 0.6, ..PhysicsSpec::default() },
            ..Self::default()
        }
    }

    /// All violations of the admissible ranges.
    pub fn check(&self) -> Vec<SpecViolation> {
        let mut out = Vec::new();
        let mut range = |field, value: f64, low: f64, high: f64, hint| {
            if value.is_nan() || value < low || value > high {
                out.push(SpecViolation { field, fact: format!("{value} is outside {low}..={high}"), hint });
            }
        };
        let Self { rig, groom, motion, physics, noise, .. } = self;
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
        range("physics.substeps", physics.substeps as f64, 1.0, 100.0, "4 is usual");
        range("physics.settle_secs", physics.settle_secs, 0.0, 60.0, "write seconds");
        for value in physics.stiffness {
            range("physics.stiffness", value, 0.0, 1e10, "write 1/s²: edge, bend, torsion, altitude");
        }
        range("physics.damping_secs", physics.damping_secs, 0.0, 1.0, "write seconds");
        range("physics.drag", physics.drag, 0.0, 1000.0, "write 1/s");
        range("physics.friction", physics.friction, 0.0, 1.0, "write a share");
        range("physics.clearance_mm", physics.clearance_mm, 0.0, 20.0, "write millimetres");
        range("noise.image_sigma", noise.image_sigma, 0.0, 255.0, "write 8-bit levels");
        range("noise.blur_px", noise.blur_px, 0.0, 50.0, "write pixels");
        range("noise.defocus_px", noise.defocus_px, 0.0, 50.0, "write pixels");
        range("noise.mask_px", noise.mask_px, 0.0, 100.0, "write pixels");
        range("noise.label_px", noise.label_px, 0.0, 100.0, "write pixels");
        range("noise.calibration_px", noise.calibration_px, 0.0, 100.0, "write pixels");
        range("noise.sync_ms", noise.sync_ms, 0.0, 1000.0, "write milliseconds");
        out
    }
}
