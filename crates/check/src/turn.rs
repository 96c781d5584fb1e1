//! A camera that was turned after the calibration: by how much, as the points say that the other views give.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DMat3, DVec2, DVec3};
use strandflow_core::{Camera, Rig, RigidTransform};
use strandflow_geometry::{project::project, triangulate::triangulate};

/// One marker in one moment: its image points \[px\] by view.
#[derive(Clone, Debug, PartialEq)]
pub struct Seen {
    /// The marker.
    pub marker: usize,
    /// Where views see it.
    pub views: BTreeMap<usize, DVec2>,
}

/// A place in space and where one view sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// The marker; sightings of one share their error: shading moves its middle in all frames alike.
    pub marker: usize,
    /// The place \[mm\], as the other views have it.
    pub place: DVec3,
    /// The image point \[px\].
    pub at: DVec2,
}

/// How a camera was turned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// Axis and angle \[rad\], in the camera's axes: x right, y down, z forward.
    pub by: DVec3,
    /// Standard errors along these axes \[rad\].
    pub error: DVec3,
    /// Root mean square distance of sightings from their places, as given and when turned \[px\].
    pub px: [f64; 2],
}

impl Turn {
    /// The camera turned.
    pub fn applied(&self, camera: &Camera) -> Camera {
        let rotation = match self.by.length() {
            angle if angle > 0.0 => DMat3::from_axis_angle(self.by / angle, angle),
            _ => DMat3::IDENTITY,
        };
        let turn = RigidTransform { rotation, translation: DVec3::ZERO };
        Camera { camera_from_world: turn.after(&camera.camera_from_world), ..camera.clone() }
    }

    /// The turn about those axes that it is sure of \[rad\]: about its own axis a camera seems turned by what markers scatter.
    pub fn sure(&self) -> DVec3 {
        let is_sure = (self.by / self.error).abs().cmpgt(DVec3::splat(SURE));
        DVec3::select(is_sure, self.by, DVec3::ZERO)
    }

    /// Whether the camera was turned by as much, and not only as errors of the markers' middles make it look.
    pub fn is_sure(&self) -> bool {
        self.sure().length() > LEAST_RAD && self.px[1] < FALLS_TO * self.px[0]
    }

    /// The turn in words.
    pub fn in_words(&self) -> String {
        let by = self.sure();
        let axes = ["up or down (about its x)", "sideways (about its y)", "about its axis (z)"];
        let most = (0..3).max_by(|a, b| by[*a].abs().total_cmp(&by[*b].abs())).unwrap_or(0);
        format!(
            "turned by {:.2}°, mostly {}, it sees the markers {:.2} px from where the others have them, as given {:.2} px",
            by.length().to_degrees(),
            axes[most],
            self.px[1],
            self.px[0]
        )
    }
}

/// Angle from which on a turn counts \[rad\]: a fifth of a degree about the axis moves the markers by a fifth of a pixel in
/// images of a thousand, about the others by 5 px.
const LEAST_RAD: f64 = 0.2 * std::f64::consts::PI / 180.0;
/// Standard errors that it must be away from none.
const SURE: f64 = 4.0;
/// What the distances must fall to: in captures that are sound the best turn takes a tenth away; of eight markers clicked to a pixel
/// it takes this much in one view of a thousand.
const FALLS_TO: f64 = 0.6;

/// Fewest markers a turn is told from: three angles, and as many again to contradict them.
const FEWEST: usize = 6;
/// Steps of Gauss and Newton; a turn of some degrees needs three.
const STEPS: usize = 5;

/// The turn that brings sightings nearest to their places, outliers left out. `None` with too few markers, or where they do not
/// tell one turn from another.
///
/// *Limits*: a camera that was moved looks turned, too; the rest that the turn leaves tells.
pub fn turn_of(camera: &Camera, sightings: &[Sighting], outlier_px: f64) -> Option<Turn> {
    let mut turn = Turn { by: DVec3::ZERO, error: DVec3::INFINITY, px: [0.0; 2] };
    let mut turned = camera.clone();
    for step in 0..STEPS {
        let mut near: Vec<(&Sighting, DVec2)> =
            sightings.iter().filter_map(|seen| Some((seen, seen.at - project(&turned, seen.place)?))).collect();
        // What is off by more than the rest is no sighting of this place; at first all may be off alike.
        let middle = crate::labels::median(near.iter().map(|(_, off)| off.length()))?;
        near.retain(|(_, off)| off.length() <= outlier_px.max(3.0 * middle));
        let markers = near.iter().map(|(seen, _)| seen.marker).collect::<BTreeSet<_>>().len();
        if markers < FEWEST {
            return None;
        }
        let rms = |near: &[(&Sighting, DVec2)]| {
            (near.iter().map(|(_, off)| off.length_squared()).sum::<f64>() / near.len() as f64).sqrt()
        };
        if step == 0 {
            turn.px[0] = rms(&near);
        }
        let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for (seen, off) in &near {
            for (row, off) in slopes(&turned, seen.place)?.into_iter().zip(off.to_array()) {
                normal += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
                right += row * off;
            }
        }
        if normal.determinant() <= 0.0 {
            return None;
        }
        let inverse = normal.inverse();
        // Each marker counts once: its error is the same in all frames.
        let variance = 0.5 * rms(&near).powi(2) * near.len() as f64 / markers as f64;
        let spread = DVec3::new(inverse.x_axis.x, inverse.y_axis.y, inverse.z_axis.z).max(DVec3::ZERO) * variance;
        turn.by += inverse * right;
        turn.error = DVec3::new(spread.x.sqrt(), spread.y.sqrt(), spread.z.sqrt());
        turn.px[1] = rms(&near);
        turned = turn.applied(camera);
    }
    (turn.by.is_finite() && turn.error.is_finite()).then_some(turn)
}

/// How an image point moves with turns about the camera's three axes \[px/rad\], for x and for y; without distortion.
fn slopes(camera: &Camera, place: DVec3) -> Option<[DVec3; 2]> {
    let p = camera.camera_from_world.point(place);
    let (x, y) = (p.x / p.z, p.y / p.z);
    let [fx, fy] = camera.focal;
    (p.z > 1e-3).then(|| [DVec3::new(-x * y, 1.0 + x * x, -y) * fx, DVec3::new(-1.0 - y * y, x * y, x) * fy])
}

/// Sightings of one view: places are those that two of the others or more agree on.
pub fn sightings(rig: &Rig, view: usize, seen: &[Seen], inlier_px: f64) -> Vec<Sighting> {
    let one = |seen: &Seen| {
        let at = *seen.views.get(&view)?;
        let others = seen.views.iter().filter(|(of, _)| **of != view);
        let others: Vec<(&Camera, DVec2)> = others.map(|(&of, &at)| (&rig.cameras[of], at)).collect();
        Some(Sighting { marker: seen.marker, place: triangulate(&others, inlier_px)?.point, at })
    };
    seen.iter().filter_map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::labels::tests::{labels, rig};

    fn seen() -> Vec<Seen> {
        labels().into_iter().enumerate().map(|(marker, label)| Seen { marker, views: label.views }).collect()
    }

    #[test]
    fn a_turn_is_recovered_within_its_error() {
        for (view, by) in
            [(1, DVec3::new(0.5, 0.0, 0.0)), (2, DVec3::new(0.0, -0.5, 0.0)), (4, DVec3::new(0.3, 0.4, 2.0))]
        {
            let by = by.map(f64::to_radians);
            let mut rig = rig();
            // The calibration is turned back, so that the turn mends it.
            rig.cameras[view] = Turn { by: -by, error: DVec3::ONE, px: [0.0; 2] }.applied(&rig.cameras[view]);
            let found = turn_of(&rig.cameras[view], &sightings(&rig, view, &seen(), 2.5), 8.0).unwrap();
            let off = (found.by - by).abs();
            assert!(off.cmple(4.0 * found.error + 1e-3).all(), "{found:?}");
            assert!(found.px[0] > 2.0 && found.px[1] < 0.6 && found.is_sure(), "{found:?}");
        }
    }

    #[test]
    fn a_camera_that_stands_still_is_not_turned() {
        for view in 0..6 {
            let found = turn_of(&rig().cameras[view], &sightings(&rig(), view, &seen(), 2.5), 8.0).unwrap();
            assert!(!found.is_sure(), "{found:?}");
        }
        assert_eq!(turn_of(&rig().cameras[0], &[], 8.0), None);
    }
}
