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
    /// What the head stands on.
    pub body: BodySpec,
    /// What passes between cameras and head.
    pub hand: HandSpec,
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
    /// Greatest way of the whole head to its sides \[mm\].
    pub sway_mm: f64,
}

/// Shoulders and chest that stand still and on which hair lies. Of no breadth by default: the head floats.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BodySpec {
    /// Breadth over the shoulders \[mm\].
    pub breadth_mm: f64,
}

/// A ball of the colour of skin that circles the head and hides markers, as a hand would. Of no radius by default: none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HandSpec {
    /// Radius \[mm\].
    pub radius_mm: f64,
    /// Distance from the middle of the head \[mm\].
    pub distance_mm: f64,
    /// Turns around the head a second \[Hz\]; it begins before the face.
    pub rate_hz: f64,
}

/// The strands' physics: the model of `strandflow-dynamics`, at a finer step than the fit's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PhysicsSpec {
    /// Steps a frame; the fit takes 5, so that it cannot know the truth exactly.
    pub substeps: usize,
    /// Time the hair is given to settle before the first frame \[s\].
    pub settle_secs: f64,
    /// Stiffness of edge, bend, torsion and altitude springs per unit mass \[1/s²\].
    pub stiffness: [f64; 4],
    /// Damping of a spring is its stiffness times this \[s\].
    pub damping_secs: f64,
    /// Drag \[1/s\].
    pub drag: f64,
    /// Rate at which contact with the head slows sliding \[1/s\].
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
    /// Share of the time between two frames for which the shutter is open, centred on the frame: what moves is blurred.
    pub shutter: f64,
    /// The light rises and falls by up to this over the take, once each; the plates have the first frame's light \[stops\].
    pub light_stops: f64,
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
            colour: [0.24, 0.14, 0.068],
            colour_variation: 0.27,
        }
    }
}

impl Default for MotionSpec {
    fn default() -> Self {
        Self { quiet_frames: 7, turn_deg: 26.0, nod_deg: 5.0, rate_hz: 1.5, sway_mm: 0.0 }
    }
}

impl Default for PhysicsSpec {
    fn default() -> Self {
        Self {
            substeps: 10,
            settle_secs: 0.4,
            stiffness: [1e7, 1e5, 1e5, 1e4],
            damping_secs: 1e-3,
            drag: 3.0,
            friction: 20.0,
            clearance_mm: 1.0,
        }
    }
}

impl Default for NoiseSpec {
    fn default() -> Self {
        Self {
            image_sigma: 2.5,
            blur_px: 0.45,
            defocus_px: 0.0,
            mask_px: 0.0,
            label_px: 0.3,
            calibration_px: 0.0,
            sync_ms: 0.0,
            shutter: 0.0,
            light_stops: 0.0,
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
            shutter: 0.0,
            light_stops: 0.0,
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
                length_mm: 240.0,
                cut_below_mm: 95.0,
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
}
