//! The settings of all stages, as one table of the manifest.

use serde::{Deserialize, Serialize};
use strandflow_stages::{
    SettingViolation, blend::BlendSettings, field::FieldSettings, fit::FitSettings, flow::FlowSettings,
    grow::GrowSettings, hull::HullSettings, lift::LiftSettings, masks::MasksSettings, orient::OrientSettings,
    pose::PoseSettings, prune::PruneSettings, scalp::ScalpSettings, smooth::SmoothSettings,
};

/// Settings by stage; what is not given is the default.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Stage 1.
    pub masks: MasksSettings,
    /// Stage 2.
    pub hull: HullSettings,
    /// Stage 3.
    pub pose: PoseSettings,
    /// Stage 4.
    pub scalp: ScalpSettings,
    /// Stage 5.
    pub orient: OrientSettings,
    /// Stage 6.
    pub lift: LiftSettings,
    /// Stage 7.
    pub field: FieldSettings,
    /// Stage 8.
    pub grow: GrowSettings,
    /// Stage 9.
    pub prune: PruneSettings,
    /// Stage 10.
    pub smooth: SmoothSettings,
    /// Stage 11.
    pub fit: FitSettings,
    /// Stage 12.
    pub flow: FlowSettings,
    /// Stage 13.
    pub blend: BlendSettings,
}

impl Settings {
    /// All violations of all stages.
    pub fn check(&self) -> Vec<SettingViolation> {
        [
            self.masks.check(),
            self.hull.check(),
            self.pose.check(),
            self.scalp.check(),
            self.orient.check(),
            self.lift.check(),
            self.field.check(),
            self.grow.check(),
            self.prune.check(),
            self.smooth.check(),
            self.fit.check(),
            self.flow.check(),
            self.blend.check(),
        ]
        .concat()
    }

    /// The most points a smoothed strand can have.
    pub fn max_smooth_points(&self) -> usize {
        (self.grow.max_length_mm / self.smooth.edge_mm).ceil() as usize + 2
    }
}
