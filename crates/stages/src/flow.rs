//! Stage 12: the velocity field diffused from the fitted strands (eq. 5).

use glam::Vec3;
use serde::{Deserialize, Serialize};
use strandflow_core::{Grid, Occupancy, Place, Report, SparseVoxels};
use strandflow_volume::velocity::{Border, Region, deposit, dilated, normalised};

use crate::{Mode, SettingViolation, StageError};

/// What one frame needs: the strands of three neighbouring frames (the frame itself repeated at the ends of the take).
pub struct FlowInput<'a> {
    /// The frame, for messages.
    pub frame: usize,
    /// The take's grid.
    pub grid: Grid,
    /// The hull of the frame; velocities are defined in it and around the strands.
    pub hull: &'a Occupancy,
    /// Positions of all particles in the previous, this and the next frame, NaN where absent; equal lengths (N · P).
    pub points: [&'a [Vec3]; 3],
    /// P: points per strand in `points`.
    pub point_count: usize,
    /// Seconds between the previous and the next of the three (2 intervals inside the take, 1 at its ends).
    pub span_secs: f64,
}

/// Settings of stage `flow`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FlowSettings {
    /// s of eq. 5.
    pub spread: f32,
    /// Sweeps.
    pub sweeps: usize,
}

impl Default for FlowSettings {
    fn default() -> Self {
        Self { spread: 1.0 / 12.0, sweeps: 30 }
    }
}

impl FlowSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        let mut found = Vec::new();
        let ok = self.spread > 0.0 && self.spread <= 1.0 / 6.0 + 1e-6;
        let rule = ("above 0, at most 1/6", "beyond 1/6 the sweeps of eq. 5 grow without bound");
        SettingViolation::unless(ok, &mut found, ("flow.spread", self.spread), rule);
        let rule = ("1..=1000", "200 sweeps already over-smooth");
        SettingViolation::unless((1..=1000).contains(&self.sweeps), &mut found, ("flow.sweeps", self.sweeps), rule);
        found
    }
}

/// Occupancy below which a diffused voxel says nothing: what a strand sends 8–9 voxels far in 30 sweeps.
const LEAST_OCCUPANCY: f64 = 1e-5;

/// Velocities \[mm/s\] of one frame.
///
/// Each particle's velocity is the difference of its outer two positions over their span; a voxel takes the mean over the
/// strands that pass through it; eq. 5 spreads it over the hull and the strands' surroundings. Paper mode starts from
/// zeros elsewhere and keeps every voxel; robust mode normalises and drops voxels that no strand reaches.
pub fn flow(
    input: &FlowInput,
    mode: Mode,
    settings: &FlowSettings,
    report: &mut Report,
) -> Result<SparseVoxels<Vec3>, StageError> {
    let place = Place::frame(input.frame);
    check(input, &place)?;
    let region = Region::new(&dilated(&with_strands(input)));
    let deposited = deposit(&region, segments(input));
    if deposited.iter().all(|value| value.w == 0.0) {
        report.warn(place, "no strand has three positions in time", "the velocity field is empty or zero");
    }
    let (s, sweeps, grid) = (f64::from(settings.spread), settings.sweeps, input.grid);
    if mode == Mode::Paper {
        let values = region.diffuse(deposited, s, sweeps, Border::Zero).iter().map(|v| v.truncate()).collect();
        return Ok(SparseVoxels { grid, indices: region.indices, values });
    }
    let values = normalised(&region, deposited, (s, sweeps, Border::Neumann), LEAST_OCCUPANCY, |v| f64::from(v.w));
    let known = region.indices.iter().zip(&values).filter_map(|(index, v)| v.map(|v| (*index, v.truncate())));
    let (indices, values) = known.unzip();
    Ok(SparseVoxels { grid, indices, values })
}

fn check(input: &FlowInput, place: &Place) -> Result<(), StageError> {
    let wrong = |fact: String, hint: &str| StageError::Input { place: place.clone(), fact, hint: hint.into() };
    let lengths = input.points.map(<[Vec3]>::len);
    if input.point_count == 0 || lengths.iter().any(|len| *len != lengths[0] || len % input.point_count != 0) {
        let fact = format!("particle counts {lengths:?} do not fit {} points a strand", input.point_count);
        return Err(wrong(fact, "run the stage `fit` again"));
    }
    if input.hull.grid != input.grid {
        return Err(wrong("the hull lies on another grid".into(), "run the stage `hull` again"));
    }
    if input.span_secs.is_nan() || input.span_secs <= 0.0 {
        return Err(wrong(format!("time span {} s", input.span_secs), "check the frame rate of the take"));
    }
    Ok(())
}

/// The hull and the voxels that strands pass through in this frame.
fn with_strands(input: &FlowInput) -> Occupancy {
    let mut occupancy = input.hull.clone();
    for [(a, _), (b, _)] in segments(input) {
        let pieces = (a.distance(b) / (0.5 * input.grid.voxel_mm as f32)).ceil().max(1.0) as usize;
        for i in 0..=pieces {
            let point = a.lerp(b, i as f32 / pieces as f32).as_dvec3();
            if let Some(voxel) = input.grid.voxel_at(point) {
                occupancy.set(input.grid.index(voxel), true);
            }
        }
    }
    occupancy
}

/// Strand pieces whose two ends have a velocity: position \[mm\] and velocity \[mm/s\] of each end.
fn segments<'a>(input: &'a FlowInput) -> impl Iterator<Item = [(Vec3, Vec3); 2]> + 'a {
    let [before, now, after] = input.points;
    let rate = (1.0 / input.span_secs) as f32;
    let end = move |i: usize| (now[i], (after[i] - before[i]) * rate);
    (0..now.len())
        .filter(move |i| i % input.point_count + 1 < input.point_count)
        .map(move |i| [end(i), end(i + 1)])
        .filter(|ends| ends.iter().all(|(p, v)| p.is_finite() && v.is_finite()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    const SECS: f32 = 0.01;

    fn field_of_turning_strands(mode: Mode) -> (SparseVoxels<Vec3>, Vec<Vec3>, Vec<Vec3>) {
        let grid = Grid { origin: DVec3::splat(-60.0), voxel_mm: 2.0, dims: [60, 60, 60] };
        let hull = Occupancy::empty(grid);
        // A curtain of strands that turns about z at 6 rad/s; one strand has no next frame.
        let at = |angle: f32| {
            let turn = glam::Mat3::from_rotation_z(angle);
            (0..12).flat_map(move |n| {
                (0..20).map(move |p| turn * Vec3::new(n as f32 * 3.0 - 18.0, 20.0, 45.0 - 5.0 * p as f32))
            })
        };
        let [before, now, mut after] = [-1.0, 0.0, 1.0].map(|i| at(i * 6.0 * SECS).collect::<Vec<_>>());
        after[60..80].fill(Vec3::NAN);
        let input = FlowInput {
            frame: 4,
            grid,
            hull: &hull,
            points: [&before, &now, &after],
            point_count: 20,
            span_secs: 2.0 * f64::from(SECS),
        };
        let field = flow(&input, mode, &FlowSettings::default(), &mut Report::default()).unwrap();
        let velocities = now.iter().map(|p| Vec3::new(-p.y, p.x, 0.0) * 6.0).collect();
        (field, now, velocities)
    }

    #[test]
    fn the_normalised_field_keeps_the_motion_and_the_printed_one_damps_it() {
        let gain = |mode| {
            let (field, points, velocities) = field_of_turning_strands(mode);
            let sampler = strandflow_volume::velocity::VelocitySampler::new(&field);
            let pairs =
                points.iter().zip(&velocities).map(|(p, v)| sampler.at(*p).unwrap().dot(*v) / v.length_squared());
            pairs.sum::<f32>() / points.len() as f32
        };
        let (robust, paper) = (gain(Mode::Robust), gain(Mode::Paper));
        assert!((0.97..1.01).contains(&robust), "robust gain {robust}");
        assert!(paper < 0.4, "paper gain {paper}");
    }

    #[test]
    fn wrong_shapes_are_named() {
        let grid = Grid { origin: DVec3::ZERO, voxel_mm: 2.0, dims: [4, 4, 4] };
        let hull = Occupancy::empty(grid);
        let points = [Vec3::ZERO; 7];
        let input = FlowInput { frame: 3, grid, hull: &hull, points: [&points; 3], point_count: 5, span_secs: 0.02 };
        let error = flow(&input, Mode::Robust, &FlowSettings::default(), &mut Report::default()).unwrap_err();
        assert!(error.to_string().contains("frame 3"));
    }
}
