//! Repairs of cameras that people's mistakes ask for, tried one by one: the one that lets the markers agree names the mistake.

use rayon::prelude::*;
use strandflow_core::{Camera, Distortion, Rig, RigidTransform};

use crate::labels::{Agreement, Label};

/// A mistake in a calibration, and how it is undone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Repair {
    /// Rows and columns of R were exchanged.
    TransposeRotation,
    /// R and t are camera to world.
    InvertPose,
    /// t is the camera's place in the world.
    PlaceForTranslation,
    /// Axes are OpenGL's: y up, z backward.
    OpenGlAxes,
    /// t has another unit than the rest: too small a thousand times.
    MetresForMillimetres,
    /// The distortion has the wrong sign, as one that undistorts.
    NegateDistortion,
    /// The footage is undistorted already.
    DropDistortion,
    /// The principal point is not that of this image.
    CentrePrincipal,
    /// K belongs to an image of half the size.
    DoubleMatrix,
    /// K belongs to an image of twice the size.
    HalveMatrix,
}

impl Repair {
    /// All, the likelier first: of two that mend alike the first counts.
    pub const ALL: [Self; 10] = [
        Self::TransposeRotation,
        Self::InvertPose,
        Self::PlaceForTranslation,
        Self::OpenGlAxes,
        Self::MetresForMillimetres,
        Self::NegateDistortion,
        Self::DropDistortion,
        Self::CentrePrincipal,
        Self::DoubleMatrix,
        Self::HalveMatrix,
    ];

    /// The fault's name.
    pub fn fault(self) -> &'static str {
        match self {
            Self::TransposeRotation => "transposed-rotation",
            Self::InvertPose => "inverted-pose",
            Self::PlaceForTranslation => "place-for-translation",
            Self::OpenGlAxes => "opengl-axes",
            Self::MetresForMillimetres => "metres-for-millimetres",
            Self::NegateDistortion => "distortion-sign",
            Self::DropDistortion => "distortion-twice",
            Self::CentrePrincipal => "principal-point",
            Self::DoubleMatrix | Self::HalveMatrix => "matrix-size",
        }
    }

    /// The fault in words, and what to do.
    pub fn in_words(self) -> (&'static str, &'static str) {
        match self {
            Self::TransposeRotation => ("R is transposed", "exchange rows and columns of R: x_cam = R x_world + t"),
            Self::InvertPose => {
                ("the pose is camera to world", "give world to camera: R transposed, and t = −Rᵀ t of what is given")
            }
            Self::PlaceForTranslation => {
                ("t is the camera's place in the world", "give t = −R · place: x_cam = R x_world + t")
            }
            Self::OpenGlAxes => (
                "the camera's axes are OpenGL's (y up, z backward)",
                "turn the signs of the second and third row of R and t, or name the convention in the file",
            ),
            Self::MetresForMillimetres => {
                ("t is in metres where the rest is in millimetres", "give all lengths in one unit, and name it")
            }
            Self::NegateDistortion => (
                "the distortion has the wrong sign",
                "give coefficients that distort (OpenCV's), not those that undistort",
            ),
            Self::DropDistortion => (
                "the footage has no distortion, the calibration has",
                "give zero distortion where the footage was undistorted, or the footage as it was recorded",
            ),
            Self::CentrePrincipal => {
                ("the principal point is not this image's", "check cx and cy: they lie near the middle of the image")
            }
            Self::DoubleMatrix => ("K belongs to an image of half the size", "multiply fx, fy, cx and cy by two"),
            Self::HalveMatrix => ("K belongs to an image of twice the size", "divide fx, fy, cx and cy by two"),
        }
    }

    /// Whether a camera can have the mistake. A principal point as near to the middle as lenses have it is none: centring it
    /// would only do in part what a turn of the camera does.
    fn is_thinkable(self, camera: &Camera) -> bool {
        let off = |k: usize, side: usize| (camera.principal[k] / side as f64 - 0.5).abs();
        self != Self::CentrePrincipal || off(0, camera.width).max(off(1, camera.height)) > LENS_OFF
    }

    /// The camera without the mistake.
    pub fn mended(self, camera: &Camera) -> Camera {
        let mut out = camera.clone();
        let RigidTransform { rotation, translation } = camera.camera_from_world;
        let scaled = |by: f64| (camera.focal.map(|f| f * by), camera.principal.map(|c| c * by));
        match self {
            Self::TransposeRotation => out.camera_from_world.rotation = rotation.transpose(),
            Self::InvertPose => out.camera_from_world = camera.camera_from_world.inverse(),
            Self::PlaceForTranslation => out.camera_from_world.translation = -(rotation * translation),
            Self::OpenGlAxes => {
                let flip = RigidTransform {
                    rotation: glam::DMat3::from_diagonal(glam::DVec3::new(1.0, -1.0, -1.0)),
                    translation: glam::DVec3::ZERO,
                };
                out.camera_from_world = flip.after(&camera.camera_from_world);
            }
            Self::MetresForMillimetres => out.camera_from_world.translation = translation * 1000.0,
            Self::NegateDistortion => {
                if let Distortion::BrownConrady(terms) = &mut out.distortion {
                    *terms = terms.map(|x| -x);
                }
            }
            Self::DropDistortion => out.distortion = Distortion::None,
            Self::CentrePrincipal => out.principal = [0.5 * camera.width as f64, 0.5 * camera.height as f64],
            Self::DoubleMatrix => (out.focal, out.principal) = scaled(2.0),
            Self::HalveMatrix => (out.focal, out.principal) = scaled(0.5),
        }
        out
    }
}

/// Distance of the principal point from the image's middle, against the side, that lenses reach.
const LENS_OFF: f64 = 0.04;

/// What mends a rig.
#[derive(Clone, Debug, PartialEq)]
pub enum Mend {
    /// The cameras of two views are exchanged.
    Exchange(usize, usize),
    /// These views' cameras have a mistake.
    Repair(Repair, Vec<usize>),
}

impl Mend {
    /// The rig with it.
    pub fn applied(&self, rig: &Rig) -> Rig {
        let mut out = rig.clone();
        match self {
            Self::Exchange(a, b) => exchange(&mut out, *a, *b),
            Self::Repair(repair, views) => {
                views.iter().for_each(|&view| out.cameras[view] = repair.mended(&rig.cameras[view]));
            }
        }
        out
    }

    /// The views it touches.
    pub fn views(&self) -> Vec<usize> {
        match self {
            Self::Exchange(a, b) => vec![*a, *b],
            Self::Repair(_, views) => views.clone(),
        }
    }
}

/// The names stay where they are: the footage of a name gets the other's camera.
fn exchange(rig: &mut Rig, a: usize, b: usize) {
    rig.cameras.swap(a, b);
    let name = std::mem::take(&mut rig.cameras[a].name);
    rig.cameras[a].name = std::mem::replace(&mut rig.cameras[b].name, name);
}

/// A mend and how the markers agree with it.
#[derive(Clone, Debug)]
pub struct Mended {
    /// What was done.
    pub mend: Mend,
    /// The rig with it.
    pub rig: Rig,
    /// How markers agree now.
    pub agreement: Agreement,
}

/// Share of its labels that must agree for a view to count as mended. A person mislabels one in ten.
const MENDED: f64 = 0.8;

/// The mend after which the most labels agree, of views that disagree now. `None` where none helps them.
///
/// One view that is wrong is found among those that are right; where all are wrong in the same way, all are mended at once.
pub fn best_mend(rig: &Rig, labels: &[Label], now: &Agreement) -> Option<Mended> {
    let wrong = now.disagreeing(rig.view_count());
    if wrong.is_empty() {
        return None;
    }
    let mut tried: Vec<Mend> = Vec::new();
    let all: Vec<usize> = (0..rig.view_count()).collect();
    for (i, &a) in wrong.iter().enumerate() {
        tried.extend(wrong[..i].iter().map(|&b| Mend::Exchange(b, a)));
    }
    for repair in Repair::ALL {
        let is_thinkable = |view: &usize| repair.is_thinkable(&rig.cameras[*view]);
        tried.extend(wrong.iter().filter(|view| is_thinkable(view)).map(|&view| Mend::Repair(repair, vec![view])));
        for several in [&all, &wrong] {
            let mend = Mend::Repair(repair, several.clone());
            if several.len() > 1 && several.iter().any(is_thinkable) && !tried.contains(&mend) {
                tried.push(mend);
            }
        }
    }
    let agreements: Vec<Agreement> =
        tried.par_iter().map(|mend| Agreement::of(&mend.applied(rig), labels, now.tolerance)).collect();
    let mut best: Option<(Mend, Agreement)> = None;
    for (mend, agreement) in tried.into_iter().zip(agreements) {
        let helped =
            mend.views().iter().all(|&view| agreement.count_of(view) > 0 && agreement.share_of(view) >= MENDED);
        let better = best.as_ref().is_none_or(|(_, best)| agreement.share() > best.share() + 1e-9);
        if helped && agreement.share() > now.share() && better {
            best = Some((mend, agreement));
        }
    }
    best.map(|(mend, agreement)| Mended { rig: mend.applied(rig), mend, agreement })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::labels::tests::{labels, rig};

    fn faulty(mend: &Mend) -> Rig {
        // Exchanges and transpositions undo themselves, and so does an inversion.
        mend.applied(&rig())
    }

    #[test]
    fn mistakes_of_one_view_are_named() {
        for mend in [
            Mend::Exchange(1, 4),
            Mend::Repair(Repair::TransposeRotation, vec![2]),
            Mend::Repair(Repair::InvertPose, vec![5]),
            Mend::Repair(Repair::OpenGlAxes, vec![0]),
        ] {
            let (rig, labels) = (faulty(&mend), labels());
            let found = best_mend(&rig, &labels, &Agreement::of(&rig, &labels, 2.5)).unwrap();
            assert_eq!(found.mend, mend);
            assert_eq!(found.agreement.share(), 1.0);
        }
    }

    #[test]
    fn mistakes_of_all_views_are_named() {
        for repair in [Repair::TransposeRotation, Repair::InvertPose, Repair::OpenGlAxes] {
            let mend = Mend::Repair(repair, (0..6).collect());
            let (rig, labels) = (faulty(&mend), labels());
            let found = best_mend(&rig, &labels, &Agreement::of(&rig, &labels, 2.5)).unwrap();
            assert_eq!(found.mend, mend);
        }
    }

    #[test]
    fn a_sound_rig_needs_none() {
        let agreement = Agreement::of(&rig(), &labels(), 2.5);
        assert_eq!((agreement.share(), best_mend(&rig(), &labels(), &agreement).is_none()), (1.0, true));
    }
}
