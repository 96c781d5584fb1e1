//! Where the cameras of a rig look. Rigs that surround a subject look at it, which tells conventions and units apart.

use glam::{DMat3, DVec3};
use strandflow_core::{Rig, RigidTransform};

/// The place that cameras look at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaze {
    /// The point nearest to all optical axes.
    pub point: DVec3,
    /// The least distance of a camera to it, along its axis; negative where a camera has it behind.
    pub nearest: f64,
    /// The largest.
    pub farthest: f64,
    /// Root mean square distance of the axes to the point.
    pub miss: f64,
}

impl Gaze {
    /// How far axes miss the point as a share of the nearest camera's distance; infinite where a camera has it behind.
    pub fn looseness(&self) -> f64 {
        if self.nearest > 0.0 { self.miss / self.nearest } else { f64::INFINITY }
    }
}

/// Where cameras look; `None` where they look in parallel, or are fewer than two.
pub fn gaze(camera_from_world: &[RigidTransform]) -> Option<Gaze> {
    let axes: Vec<(DVec3, DVec3)> = camera_from_world
        .iter()
        .map(RigidTransform::inverse)
        .map(|pose| (pose.translation, pose.rotation.z_axis))
        .collect();
    if axes.len() < 2 {
        return None;
    }
    let (mut a, mut b) = (DMat3::ZERO, DVec3::ZERO);
    for (origin, d) in &axes {
        let m = DMat3::IDENTITY - DMat3::from_cols(*d * d.x, *d * d.y, *d * d.z);
        a += m;
        b += m * *origin;
    }
    // The determinant of a pair whose axes meet at 10° is 0.03; below, the point has no distance to speak of.
    let point = (a.determinant() > 0.02 * axes.len() as f64).then(|| a.inverse() * b).filter(|p| p.is_finite())?;
    let depths = || axes.iter().map(|(origin, d)| d.dot(point - *origin));
    let misses = axes.iter().map(|(origin, d)| (point - *origin).reject_from_normalized(*d).length_squared());
    Some(Gaze {
        point,
        nearest: depths().fold(f64::INFINITY, f64::min),
        farthest: depths().fold(f64::NEG_INFINITY, f64::max),
        miss: (misses.sum::<f64>() / axes.len() as f64).sqrt(),
    })
}

/// Where the cameras of a rig look \[mm\].
pub fn gaze_of_rig(rig: &Rig) -> Option<Gaze> {
    gaze(&rig.cameras.iter().map(|camera| camera.camera_from_world).collect::<Vec<_>>())
}

/// Of several readings of a rig the one under which the cameras look at one place in front of them; `None` where none
/// does, or more than one.
pub(super) fn only_sensible(readings: &[Vec<RigidTransform>]) -> Option<usize> {
    let looseness: Vec<f64> =
        readings.iter().map(|poses| gaze(poses).map_or(f64::INFINITY, |gaze| gaze.looseness())).collect();
    let best = (0..readings.len()).min_by(|&a, &b| looseness[a].total_cmp(&looseness[b]))?;
    // Axes of a rig aimed by hand miss by up to a third of the distance; a wrong reading that looks as good as that misses
    // by a whole distance or more, or looks away.
    let others = (0..readings.len()).filter(|&i| i != best).map(|i| looseness[i]);
    (looseness[best] < 0.35 && others.into_iter().all(|other| other > 0.7f64.max(3.0 * looseness[best])))
        .then_some(best)
}

/// Millimetres of the unit in which a head stands a sensible way from the cameras; `None` where no unit or two fit.
/// Sensible are 0.25 m to 4 m: nearer a camera sees no head of hair, farther no single hair.
pub(super) fn unit_by_distance(gaze: &Gaze) -> Option<(&'static str, f64)> {
    let distance = 0.5 * (gaze.nearest + gaze.farthest);
    let fits = |mm: &f64| gaze.looseness() < 0.5 && (250.0..=4000.0).contains(&(distance * mm));
    let mut fitting =
        [("metres", 1000.0), ("centimetres", 10.0), ("millimetres", 1.0)].into_iter().filter(|(_, mm)| fits(mm));
    let first = fitting.next()?;
    fitting.next().is_none().then_some(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cameras on a ring of 1.2 units around (0.1, 0.2, 0.3), each aimed a little off.
    fn ring(count: usize) -> Vec<RigidTransform> {
        let pose = |i: usize| {
            let rotation = DMat3::from_rotation_x(0.05 * (i % 3) as f64) * DMat3::from_rotation_y(i as f64 * 0.7);
            RigidTransform { rotation, translation: DVec3::new(0.0, 0.03, 1.2) - rotation * DVec3::new(0.1, 0.2, 0.3) }
        };
        (0..count).map(pose).collect()
    }

    #[test]
    fn a_ring_looks_at_its_middle_in_metres() {
        let gaze = gaze(&ring(6)).unwrap();
        assert!((gaze.point - DVec3::new(0.1, 0.2, 0.3)).length() < 0.1, "{gaze:?}");
        assert!((gaze.nearest - 1.2).abs() < 0.1 && gaze.looseness() < 0.1, "{gaze:?}");
        assert_eq!(unit_by_distance(&gaze), Some(("metres", 1000.0)));
        let scaled =
            |s: f64| Gaze { nearest: gaze.nearest * s, farthest: gaze.farthest * s, miss: gaze.miss * s, ..gaze };
        assert_eq!(unit_by_distance(&scaled(1000.0)), Some(("millimetres", 1.0)));
        assert_eq!(unit_by_distance(&scaled(100.0)), Some(("centimetres", 10.0)));
        assert_eq!(unit_by_distance(&scaled(250.0)), None, "3 m or 30 cm");
        assert_eq!(unit_by_distance(&scaled(9.0)), None);
    }

    #[test]
    fn parallel_cameras_tell_nothing() {
        let pose = |x: f64| RigidTransform { rotation: DMat3::IDENTITY, translation: DVec3::new(x, 0.0, 1.0) };
        assert_eq!(gaze(&[pose(0.0), pose(0.2)]), None);
        assert_eq!(only_sensible(&[vec![pose(0.0), pose(0.2)]]), None);
    }
}
