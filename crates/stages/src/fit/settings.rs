//! What can be chosen of stage `fit`.

use serde::{Deserialize, Serialize};
use strandflow_dynamics::refine::RefineOptions;

use crate::{Mode, SettingViolation};

/// Settings of stage `fit`. Paper mode keeps the counts and takes the letter for the rest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitSettings {
    /// Passes over the whole take. Two are best; more do not hurt, since targets stay the original data.
    pub outer_passes: usize,
    /// Frames that a window predicts, robust mode.
    ///
    /// *Deviation*: paper mode takes five. Strands of real footage err alike over several frames, and six frames leave
    /// less of that in the motion; noise that is independent from frame to frame asks for five (`joint_table`: helix).
    pub window_frames: usize,
    /// σ of the Gaussian aging weights \[frames\]; 1 is bad.
    pub aging_frames: f64,
    /// Simulation steps per frame; five are 2 ms at 100 frames a second.
    pub substeps: usize,
    /// Gauss–Newton steps per window in robust mode; 0 takes the quasi-Newton search of paper mode.
    pub newton_steps: usize,
    /// Steps of the quasi-Newton search per window.
    pub iterations: usize,
    /// Evaluations of value and gradient per window in that search.
    pub evaluations: usize,
    /// Half the range of the log parameters around their start.
    pub log_range: f64,
    /// Weight of Σ (δv / 100 mm/s)² against the mean squared distance \[mm²\].
    pub velocity_prior: f64,
    /// Step of the prox \[s\]; longer gives stiffer strands.
    pub prox_secs: f64,
    /// Step of the prox after a pass \[s\], with edges four times as stiff.
    pub finish_secs: f64,
    /// Edge length where the data are too noisy to tell \[mm\].
    pub edge_mm: f64,
    /// Weight of points whose direction was filled in, against observed ones.
    pub diffused_weight: f64,
}

impl Default for FitSettings {
    fn default() -> Self {
        let options = RefineOptions::default();
        Self {
            outer_passes: options.outer_passes,
            window_frames: options.window_frames,
            aging_frames: options.aging_frames,
            substeps: options.substeps,
            newton_steps: options.newton_steps,
            iterations: options.iterations,
            evaluations: options.evaluations,
            log_range: options.log_range,
            velocity_prior: options.velocity_prior,
            prox_secs: options.prox_secs,
            finish_secs: options.finish_secs,
            edge_mm: options.edge_mm,
            diffused_weight: 0.5,
        }
    }
}

impl FitSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        let mut found = Vec::new();
        let mut count = |field: &str, value: usize, range: std::ops::RangeInclusive<usize>, reason: &str| {
            let text = format!("{}..={}", range.start(), range.end());
            SettingViolation::unless(range.contains(&value), &mut found, (field, value), (&text, reason));
        };
        count("fit.outer_passes", self.outer_passes, 0..=20, "0 keeps the cleaned strands");
        count("fit.window_frames", self.window_frames, 1..=50, "the memory of a window grows with it");
        count("fit.substeps", self.substeps, 1..=50, "five are 2 ms at 100 frames a second");
        count("fit.newton_steps", self.newton_steps, 0..=50, "one comes as far as eight of the quasi-Newton search");
        count("fit.iterations", self.iterations, 1..=200, "eight suffice");
        count("fit.evaluations", self.evaluations, 1..=400, "at least one per iteration is needed");
        let mut real = |field: &str, value: f64, (low, high): (f64, f64), reason: &str| {
            let ok = value >= low && value <= high;
            SettingViolation::unless(ok, &mut found, (field, value), (&format!("{low}..={high}"), reason));
        };
        real("fit.aging_frames", self.aging_frames, (0.5, 1e6), "below, only the first frame counts");
        real("fit.log_range", self.log_range, (0.0, 8.0), "the step becomes singular further out");
        real("fit.velocity_prior", self.velocity_prior, (0.0, 1e6), "a weight");
        real("fit.prox_secs", self.prox_secs, (1e-4, 0.1), "longer steps let gravity win over the data");
        real("fit.finish_secs", self.finish_secs, (1e-4, 0.1), "shorter steps leave the lengths to vary");
        real("fit.edge_mm", self.edge_mm, (0.1, 100.0), "the particle spacing");
        real("fit.diffused_weight", self.diffused_weight, (0.0, 1.0), "a share of an observed point's weight");
        found
    }

    /// The options of the chain in this mode.
    pub(super) fn options(&self, mode: Mode) -> RefineOptions {
        RefineOptions {
            outer_passes: self.outer_passes,
            window_frames: if mode == Mode::Paper { PAPER_WINDOW_FRAMES } else { self.window_frames },
            aging_frames: self.aging_frames,
            substeps: self.substeps,
            newton_steps: self.newton_steps,
            iterations: self.iterations,
            evaluations: self.evaluations,
            log_range: self.log_range,
            velocity_prior: self.velocity_prior,
            prox_secs: self.prox_secs,
            finish_secs: self.finish_secs,
            edge_mm: self.edge_mm,
            letter: mode == Mode::Paper,
            ..RefineOptions::default()
        }
    }
}

/// Frames of a window as printed (section 5.2).
const PAPER_WINDOW_FRAMES: usize = 5;
