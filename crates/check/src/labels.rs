//! How well labelled markers agree with the cameras: triangulation, and reprojection into every view.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};
use strandflow_core::{Camera, Rig};
use strandflow_geometry::{
    project::project,
    triangulate::{Triangulated, triangulate},
};

/// A marker labelled in the first frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// The marker's number.
    pub id: u32,
    /// Image points \[px\] by view index.
    pub views: BTreeMap<usize, DVec2>,
}

/// Fewest views that say something of one another: two agree on a point within a pixel more often than not by chance.
const TELLING: usize = 3;

/// One label against the others of its marker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Residual {
    /// Index of the marker.
    pub marker: usize,
    /// The view.
    pub view: usize,
    /// Distance from the marker's point, as the other views that agree have it, in this view \[px\]; infinite behind the
    /// camera.
    pub px: f64,
}

/// How labels agree.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Agreement {
    /// Markers in space \[mm\], those that two views or more agree on.
    pub points: Vec<Option<DVec3>>,
    /// Whether three views or more agree on a marker's point: two do so by chance, too.
    pub sure: Vec<bool>,
    /// Labels of markers that three views or more have.
    pub residuals: Vec<Residual>,
    /// The tolerance \[px\].
    pub tolerance: f64,
}

impl Agreement {
    /// Triangulates each marker from the views that agree within `tolerance` \[px\], and reprojects it.
    pub fn of(rig: &Rig, labels: &[Label], tolerance: f64) -> Self {
        let mut found = Self { tolerance, ..Self::default() };
        for (marker, label) in labels.iter().enumerate() {
            let seen: Vec<(usize, &Camera, DVec2)> =
                label.views.iter().map(|(&view, &at)| (view, &rig.cameras[view], at)).collect();
            let all: Vec<(&Camera, DVec2)> = seen.iter().map(|(_, camera, at)| (*camera, *at)).collect();
            let consensus = triangulate(&all, tolerance);
            found.points.push(consensus.as_ref().map(|t| t.point));
            found.sure.push(consensus.as_ref().is_some_and(|t| t.inliers.len() >= TELLING));
            if seen.len() < TELLING {
                continue;
            }
            let Some(consensus) = consensus else {
                // No two views agree: none of them can be right in this.
                found.residuals.extend(seen.iter().map(|&(view, ..)| Residual { marker, view, px: f64::INFINITY }));
                continue;
            };
            for (i, &(view, camera, at)) in seen.iter().enumerate() {
                // Two of several that agree may do so by chance: they say that the others do not, and nothing of themselves.
                if consensus.inliers.len() < TELLING && consensus.inliers.contains(&i) {
                    continue;
                }
                let point = without(&all, &consensus, i, tolerance);
                let px = project(camera, point).map_or(f64::INFINITY, |p| p.distance(at));
                found.residuals.push(Residual { marker, view, px });
            }
        }
        found
    }

    /// Whether a residual is within the tolerance. What the other views say of a label scatters about twice as much as what
    /// all say together.
    pub fn agrees(&self, residual: &Residual) -> bool {
        residual.px <= 2.0 * self.tolerance
    }

    /// Points of the markers \[mm\]: of those that three views or more agree on, or of all where these are fewer than three.
    pub fn sure_points(&self) -> Vec<DVec3> {
        let sure = self.points.iter().zip(&self.sure).filter(|(_, sure)| **sure).filter_map(|(point, _)| *point);
        let sure: Vec<DVec3> = sure.collect();
        if sure.len() < 3 { self.points.iter().flatten().copied().collect() } else { sure }
    }

    /// Share of the labels that agree, 0 to 1; 0 where there are none.
    pub fn share(&self) -> f64 {
        share(self.residuals.iter().map(|r| self.agrees(r)))
    }

    /// Share of a view's labels that agree.
    pub fn share_of(&self, view: usize) -> f64 {
        share(self.residuals.iter().filter(|r| r.view == view).map(|r| self.agrees(r)))
    }

    /// Labels of a view that can be judged.
    pub fn count_of(&self, view: usize) -> usize {
        self.residuals.iter().filter(|r| r.view == view).count()
    }

    /// Median residual of a view \[px\].
    pub fn median_of(&self, view: usize) -> Option<f64> {
        median(self.residuals.iter().filter(|r| r.view == view).map(|r| r.px))
    }

    /// Median residual \[px\].
    pub fn median(&self) -> Option<f64> {
        median(self.residuals.iter().map(|r| r.px))
    }

    /// Views of which fewer than half of the labels agree.
    pub fn disagreeing(&self, views: usize) -> Vec<usize> {
        (0..views).filter(|&view| self.count_of(view) >= TELLING && self.share_of(view) < 0.5).collect()
    }

    /// Labels that disagree in views that otherwise agree.
    pub fn outliers(&self, views: usize) -> Vec<Residual> {
        let wrong = self.disagreeing(views);
        self.residuals.iter().filter(|r| !self.agrees(r) && !wrong.contains(&r.view)).copied().collect()
    }
}

/// The point without one of its observations; with all that agree where fewer than three would be left: two extrapolate, and
/// from cameras that stand close together they scatter many times as much as all.
fn without(all: &[(&Camera, DVec2)], consensus: &Triangulated, left_out: usize, tolerance: f64) -> DVec3 {
    if !consensus.inliers.contains(&left_out) || consensus.inliers.len() <= TELLING {
        return consensus.point;
    }
    let rest: Vec<_> = consensus.inliers.iter().filter(|&&i| i != left_out).map(|&i| all[i]).collect();
    triangulate(&rest, tolerance).map_or(consensus.point, |t| t.point)
}

fn share(agree: impl Iterator<Item = bool>) -> f64 {
    let (mut yes, mut all) = (0usize, 0usize);
    agree.for_each(|ok| (yes, all) = (yes + usize::from(ok), all + 1));
    yes as f64 / all.max(1) as f64
}

/// The median; `None` of nothing.
pub fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use glam::DMat3;
    use strandflow_core::{Distortion, RigidTransform};

    /// Six cameras around the back of a head at the origin, z up.
    pub fn rig() -> Rig {
        let camera = |i: usize| {
            let around = (i as f64 - 2.5) * 0.7;
            let up = if i.is_multiple_of(2) { 0.15 } else { 0.55 };
            let eye = DVec3::new(around.sin() * f64::cos(up), around.cos() * f64::cos(up), f64::sin(up)) * 1500.0;
            let forward = -eye.normalize();
            let right = forward.cross(DVec3::Z).normalize();
            let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
            Camera {
                name: format!("cam{i:02}"),
                width: 640,
                height: 480,
                focal: [1400.0; 2],
                principal: [322.0, 238.0],
                distortion: Distortion::None,
                camera_from_world: RigidTransform { rotation, translation: -(rotation * eye) },
            }
        };
        Rig { cameras: (0..6).map(camera).collect() }
    }

    /// Eight markers on the upper head, in all views, off by a third of a pixel.
    pub fn labels() -> Vec<Label> {
        let at = |m: usize, view: usize| {
            let (sine, cosine) = (m as f64 * 2.4).sin_cos();
            let low = 0.1 + 0.09 * m as f64;
            let point = DVec3::new(sine * low.cos(), cosine * low.cos(), low.sin()) * 95.0;
            let off = DVec2::new((m * 7 + view * 3) as f64, (m * 5 + view * 11) as f64);
            project(&rig().cameras[view], point).unwrap() + DVec2::new(off.x.sin(), off.y.sin()) * 0.3
        };
        (0..8).map(|m| Label { id: m as u32, views: (0..6).map(|view| (view, at(m, view))).collect() }).collect()
    }

    #[test]
    fn three_cameras_close_together_are_no_fault() {
        // 15° apart, labelled to a pixel and a half: what two of them say of the third scatters by several pixels.
        let close = |i: usize| {
            let eye = DVec3::new((i as f64 - 1.0) * 0.26, 1.0, 0.0).normalize() * 1500.0;
            let forward = -eye.normalize();
            let right = forward.cross(DVec3::Z).normalize();
            let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
            let camera_from_world = RigidTransform { rotation, translation: -(rotation * eye) };
            Camera { camera_from_world, ..rig().cameras[i].clone() }
        };
        let rig = Rig { cameras: (0..3).map(close).collect() };
        let seen = |m: usize, view: usize| {
            let point = DVec3::new((m as f64 * 2.4).sin(), 0.3, (m as f64 * 1.7).cos()) * 90.0;
            let off = DVec2::new((m * 7 + view * 3) as f64, (m * 5 + view * 11) as f64);
            project(&rig.cameras[view], point).unwrap() + DVec2::new(off.x.sin(), off.y.sin()) * 1.5
        };
        let label = |m: usize| Label { id: m as u32, views: (0..3).map(|view| (view, seen(m, view))).collect() };
        let labels: Vec<Label> = (0..8).map(label).collect();
        assert!(Agreement::of(&rig, &labels, 2.5).disagreeing(3).is_empty());
        // One that was moved is still told.
        let mut moved = labels.clone();
        moved.iter_mut().for_each(|label| label.views.get_mut(&2).unwrap().y += 30.0);
        assert_eq!(Agreement::of(&rig, &moved, 2.5).disagreeing(3), [2]);
    }

    #[test]
    fn a_point_of_two_views_decides_nothing_where_others_are_sure() {
        let mut labels = labels();
        labels[0].views = [(0, DVec2::new(5.0, 5.0)), (1, DVec2::new(600.0, 460.0))].into();
        let agreement = Agreement::of(&rig(), &labels, 1e9);
        assert!(!agreement.sure[0] && agreement.sure_points().len() == 7);
    }

    #[test]
    fn sound_labels_agree_and_a_moved_one_does_not() {
        let mut labels = labels();
        let sound = Agreement::of(&rig(), &labels, 2.5);
        assert!(sound.share() == 1.0 && sound.median().unwrap() < 0.6, "{:?}", sound.median());
        labels[3].views.get_mut(&2).unwrap().x += 9.0;
        let moved = Agreement::of(&rig(), &labels, 2.5);
        let outliers: Vec<_> = moved.outliers(6).iter().map(|r| (r.marker, r.view)).collect();
        assert_eq!((outliers.as_slice(), moved.disagreeing(6).len()), ([(3, 2)].as_slice(), 0));
    }
}
