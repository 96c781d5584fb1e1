//! Conventions: where cameras look, units, lenses, gravity.

use glam::{DMat3, DVec2, DVec3};
use strandflow_core::{Camera, Mask, RigidTransform};
use strandflow_geometry::{
    project::{depth, project},
    triangulate::{meeting_of_axes, midpoint},
};

use crate::{
    Evidence, Finding, Outcome,
    labels::{Agreement, median},
};

/// The middle of the labelled markers \[mm\], as the views that agree have it.
fn head_of(evidence: &Evidence) -> Option<DVec3> {
    let points = Agreement::of(&evidence.mended, &evidence.labels, evidence.label_tolerance()).sure_points();
    (points.len() >= 3).then(|| mean(&points))
}

/// The check `aim`.
pub(crate) fn aim(evidence: &mut Evidence) -> Outcome {
    let rig = &evidence.mended;
    let Some(subject) = head_of(evidence).or_else(|| meeting_of_axes(rig)) else {
        return Outcome::unjudged("no markers and no place where the cameras' axes meet");
    };
    let off: Vec<f64> = rig.cameras.iter().map(|camera| off_axis(camera, subject)).collect();
    let worst = off.iter().copied().fold(0.0, f64::max);
    let measured = format!("the subject lies up to {:.1}° from the cameras' axes", worst.to_degrees());
    let mut findings = Vec::new();
    for (view, camera) in rig.cameras.iter().enumerate().filter(|(view, _)| !evidence.distrusted.contains(view)) {
        let place = format!("view {}", camera.name);
        if depth(camera, subject) <= 0.0 {
            let fact = format!("the subject lies {:.0} mm behind the camera", -depth(camera, subject));
            let finding = Finding::cannot("looks-away", place, fact)
                .suffers("hull: the view carves everything away, or nothing")
                .hint("check the direction of the pose (world to camera) and the axes (z forward)");
            findings.push(evidence.unless_held_out(&[view], finding));
        } else if !is_in_image(camera, subject) {
            // A view may be framed on what hangs down; a wrong R or t looks the same.
            let fact = format!("the markers lie {:.0}° from its axis, outside its image", off[view].to_degrees());
            let finding = Finding::look("looks-away", place, fact)
                .suffers("pose: the view sees no marker; hull: a wrong R or t looks the same")
                .hint("right where the view is framed on other parts of the hair; else check R and t of this camera");
            findings.push(finding);
        }
    }
    Outcome::of(measured, findings)
}

fn is_in_image(camera: &Camera, place: DVec3) -> bool {
    let inside =
        |at: DVec2| (0.0..=camera.width as f64).contains(&at.x) && (0.0..=camera.height as f64).contains(&at.y);
    project(camera, place).is_some_and(inside)
}

/// Angle of a place from a camera's axis \[rad\].
fn off_axis(camera: &Camera, place: DVec3) -> f64 {
    let p = camera.camera_from_world.point(place);
    p.truncate().length().atan2(p.z)
}

/// Field of view along the diagonal \[rad\].
fn diagonal_view(camera: &Camera) -> f64 {
    let half = DVec2::new(camera.width as f64 / camera.focal[0], camera.height as f64 / camera.focal[1]) * 0.5;
    2.0 * half.length().atan()
}

/// Distance of a camera from the head that people have \[mm\].
const DISTANCE_MM: std::ops::RangeInclusive<f64> = 200.0..=20_000.0;
/// Largest distance between two markers on a head \[mm\]: a head is 150 to 250 mm long.
const MARKERS_MM: std::ops::RangeInclusive<f64> = 50.0..=350.0;
/// Units that people take for one another: millimetres each, and the fault's name.
const UNITS: [(f64, &str, &str); 5] = [
    (1000.0, "metres-for-millimetres", "metres"),
    (10.0, "centimetres-for-millimetres", "centimetres"),
    (25.4, "inches-for-millimetres", "inches"),
    (1e-3, "millimetres-for-metres", "millimetres where the file says metres"),
    (1e-1, "millimetres-for-centimetres", "millimetres where the file says centimetres"),
];

/// The check `units`: scales the rig where another unit makes both distances plausible.
pub(crate) fn units(evidence: &mut Evidence) -> Outcome {
    let points = Agreement::of(&evidence.mended, &evidence.labels, evidence.label_tolerance()).sure_points();
    let pairs = points.iter().enumerate().flat_map(|(i, a)| points[..i].iter().map(|b| a.distance(*b)));
    let spread = pairs.fold(0.0, f64::max);
    let subject = if points.is_empty() { meeting_of_axes(&evidence.mended) } else { Some(mean(&points)) };
    let distances =
        |subject: DVec3| median(evidence.mended.cameras.iter().map(|c| c.centre_in_world().distance(subject)));
    let Some(distance) = subject.and_then(distances) else { return Outcome::unjudged("there are no distances") };
    let measured = format!("cameras {distance:.0} mm from the head, markers up to {spread:.0} mm apart");
    let plausible =
        |mm: f64| DISTANCE_MM.contains(&(mm * distance)) && (points.len() < 3 || MARKERS_MM.contains(&(mm * spread)));
    if plausible(1.0) {
        return Outcome::of(measured, Vec::new());
    }
    let suffers = "hull: the grid has a few voxels, or billions; all lengths of the settings are millimetres";
    let precise = |mm: f64| if mm < 10.0 { format!("{mm:.2} mm") } else { format!("{mm:.0} mm") };
    let lie = format!("cameras lie {} from the head, markers up to {} apart", precise(distance), precise(spread));
    let finding = match UNITS.into_iter().find(|(mm, ..)| plausible(*mm)) {
        Some((mm, fault, unit)) => {
            let scale = |pose: &mut RigidTransform| pose.translation *= mm;
            evidence.mended.cameras.iter_mut().for_each(|camera| scale(&mut camera.camera_from_world));
            let fact = format!("{lie}: the calibration's lengths are {unit}");
            let hint =
                "name the true unit: `units` in .json and .toml, `calibration.unit_mm` in the manifest for others";
            Finding::cannot(fault, "calibration", fact).hint(hint)
        }
        None => Finding::look("scale", "calibration", format!("{lie}: that is no head before a rig"))
            .hint("check the unit of the calibration; markers sit on the head"),
    };
    Outcome::of(measured, vec![finding.suffers(suffers)])
}

fn mean(points: &[DVec3]) -> DVec3 {
    points.iter().sum::<DVec3>() / points.len().max(1) as f64
}

/// Distance of the principal point from the image's middle, against the side, from which on it is another image's: lenses
/// reach 3 %, images cut from larger ones 10 %.
const OFF_CENTRE: f64 = 0.15;
/// Fields of view along the diagonal that lenses before heads have \[°\].
const FIELD_DEG: std::ops::RangeInclusive<f64> = 2.0..=120.0;
/// Ratio of fy to fx from which on pixels would not be square.
const SQUARE: f64 = 0.05;

/// The check `lenses`.
pub(crate) fn lenses(evidence: &mut Evidence) -> Outcome {
    let cameras = &evidence.mended.cameras;
    let off = |c: &Camera| {
        let side = |k: usize, length: usize| (c.principal[k] / length as f64 - 0.5).abs();
        side(0, c.width).max(side(1, c.height))
    };
    let field = |c: &Camera| diagonal_view(c).to_degrees();
    let (narrow, wide) = cameras.iter().map(field).fold((f64::INFINITY, 0.0), |(a, b), f| (f.min(a), f.max(b)));
    let worst = cameras.iter().map(off).fold(0.0, f64::max);
    let measured =
        format!("fields of view {narrow:.0} to {wide:.0}°, principal points up to {:.1} % off centre", 100.0 * worst);
    let mut findings = Vec::new();
    for camera in cameras {
        let place = format!("view {}", camera.name);
        let suffers = "hull, lift: rays of this view go astray";
        if off(camera) > OFF_CENTRE {
            let [cx, cy] = camera.principal;
            let fact = format!(
                "the principal point ({cx:.0}, {cy:.0}) lies {:.0} % off the centre of the image",
                100.0 * off(camera)
            );
            let hint = "check cx and cy, and that the calibration is of this image size and not of a part of it";
            findings.push(Finding::look("principal-point", place.clone(), fact).suffers(suffers).hint(hint));
        }
        if !FIELD_DEG.contains(&field(camera)) {
            let fact =
                format!("a focal length of {:.0} px gives a field of view of {:.1}°", camera.focal[0], field(camera));
            let hint = "give fx and fy in pixels of this image, not in millimetres";
            findings.push(Finding::look("focal-length", place.clone(), fact).suffers(suffers).hint(hint));
        }
        if (camera.focal[1] / camera.focal[0] - 1.0).abs() > SQUARE {
            let fact = format!(
                "fx {:.0} and fy {:.0} differ by {:.0} %",
                camera.focal[0],
                camera.focal[1],
                100.0 * (camera.focal[1] / camera.focal[0] - 1.0).abs()
            );
            let hint = "pixels are square: was the footage scaled after the calibration?";
            findings.push(Finding::look("focal-length", place, fact).suffers(suffers).hint(hint));
        }
    }
    Outcome::of(measured, findings)
}

/// Sizes of gravity \[mm/s²\] that are no mistake: on earth 9,764 to 9,834.
const GRAVITY: std::ops::RangeInclusive<f64> = 9000.0..=10_600.0;
/// Angle between gravity and a witness of it from which on they contradict one another \[°\]: cameras that look down by 45°
/// still have a down that is within it.
const CONTRADICTS_DEG: f64 = 60.0;

/// The check `gravity`.
pub(crate) fn gravity(evidence: &mut Evidence) -> Outcome {
    let gravity = evidence.gravity;
    let suffers = "fit: springs and drag are fitted against a force that was not there";
    let mut findings = Vec::new();
    if !GRAVITY.contains(&gravity.length()) {
        let fact = format!("gravity is {:.0} mm/s² strong, on earth it is 9810", gravity.length());
        let hint = "give gravity in mm/s² in the manifest, whatever the unit of the calibration";
        findings.push(Finding::look("gravity", "manifest", fact).suffers(suffers).hint(hint));
    }
    let rig = &evidence.mended;
    let trusted = rig.cameras.iter().enumerate().filter(|(view, _)| !evidence.distrusted.contains(view));
    let down = trusted.map(|(_, c)| c.camera_from_world.rotation.row(1)).sum::<DVec3>();
    let from = |witness: DVec3| {
        (witness.length() > 0.1 && gravity.length() > 0.0).then(|| witness.angle_between(gravity).to_degrees())
    };
    let cameras = from(down.normalize_or_zero());
    let hair = hair_hangs(evidence).and_then(from);
    let words = |angle: Option<f64>| angle.map_or_else(|| "?".to_owned(), |a| format!("{a:.0}°"));
    let measured = format!(
        "{:.0} mm/s², {} from the cameras' down, {} from the way the hair hangs",
        gravity.length(),
        words(cameras),
        words(hair)
    );
    let witnesses: Vec<f64> = [cameras, hair].into_iter().flatten().collect();
    // Cameras may be rolled, and hair may fly: one that agrees is enough.
    if !witnesses.is_empty() && witnesses.iter().all(|angle| *angle > CONTRADICTS_DEG) {
        let axis = nearest_axis(down);
        let fact = format!(
            "gravity points {} from the cameras' down and {} from the way the hair hangs",
            words(cameras),
            words(hair)
        );
        let hint = format!("check `gravity` in the manifest: {:?} would fit the cameras", (axis * 9810.0).to_array());
        findings.push(Finding::look("gravity", "manifest", fact).suffers(suffers).hint(hint));
    }
    Outcome::of(measured, findings)
}

/// From the markers on the upper head to the middle of the hair.
fn hair_hangs(evidence: &Evidence) -> Option<DVec3> {
    let rig = &evidence.mended;
    let fits = |(view, camera): &(usize, &Camera)| {
        let mask = evidence.views[*view].hair.as_ref()?;
        let fits = (mask.width, mask.height) == (camera.width, camera.height) && !evidence.distrusted.contains(view);
        fits.then(|| centre_of(mask)).flatten().map(|at| (rig.cameras.get(*view), at))
    };
    let seen: Vec<_> = rig.cameras.iter().enumerate().filter_map(|view| fits(&view)).collect();
    let seen: Vec<(&Camera, DVec2)> = seen.into_iter().filter_map(|(camera, at)| Some((camera?, at))).collect();
    if seen.len() < 2 {
        return None;
    }
    (midpoint(&seen)? - head_of(evidence)?).try_normalize()
}

/// The middle of a mask \[px\]; `None` where it is empty.
fn centre_of(mask: &Mask) -> Option<DVec2> {
    let (mut sum, mut count) = (DVec2::ZERO, 0.0);
    for y in 0..mask.height {
        for (x, _) in mask.row(y).iter().enumerate().filter(|(_, m)| **m >= 128) {
            sum += DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            count += 1.0;
        }
    }
    (count > 0.0).then(|| sum / count)
}

/// The axis of the world nearest to a direction.
fn nearest_axis(direction: DVec3) -> DVec3 {
    let axes = DMat3::IDENTITY;
    let all = [axes.x_axis, axes.y_axis, axes.z_axis].into_iter().flat_map(|axis| [axis, -axis]);
    all.max_by(|a, b| a.dot(direction).total_cmp(&b.dot(direction))).unwrap_or(DVec3::NEG_Z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::labels::tests::rig;

    #[test]
    fn places_are_seen_from_a_camera() {
        let camera = &rig().cameras[2];
        assert!(off_axis(camera, DVec3::ZERO) < 1e-9);
        let behind = camera.centre_in_world() * 1.5;
        assert!((off_axis(camera, behind) - std::f64::consts::PI).abs() < 1e-9);
        assert!((diagonal_view(camera).to_degrees() - 31.9).abs() < 0.1);
        assert!(meeting_of_axes(&rig()).unwrap().length() < 10.0);
    }

    #[test]
    fn axes_and_middles() {
        assert_eq!(nearest_axis(DVec3::new(0.2, -0.9, 0.3)), DVec3::NEG_Y);
        let mask = Mask::from_fn(10, 8, |x, y| if (2..4).contains(&x) && y == 5 { 255 } else { 0 });
        assert_eq!(centre_of(&mask), Some(DVec2::new(3.0, 5.5)));
        assert_eq!(centre_of(&Mask::filled(3, 3, 0)), None);
    }
}
