//! A groom brought onto the captured scalp: which way up, how large, and its roots on the skin.
//!
//! Reference: Zhang, Wu, Zhang et al. 2012, §5.5 ("align hair roots to our captured scalp by the iterative closest point method
//! and project them onto the scalp").

use std::collections::BTreeSet;

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use strandflow_core::{Place, Report, RigidTransform, TriMesh};
use strandflow_dynamics::driven::{Contact, lay_outside};
use strandflow_geometry::{
    icp::{Icp, Similarity, icp},
    mesh_distance::MeshDistance,
    signed_distance::SignedDistance,
};

use crate::StageError;

/// How the groom is brought onto the scalp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Alignment {
    /// As it is, in the world of the take's first frame.
    AsGiven,
    /// By this transform from the groom's space into the world of the first frame.
    Given(Similarity),
    /// By the way up in which its roots cover the captured ones best, then ICP with scale.
    Find,
}

/// A groom on the scalp, in head space.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedGroom {
    /// Strands, root first \[mm\].
    pub strands: Vec<Vec<DVec3>>,
    /// Head space from the groom's space.
    pub transform: Similarity,
    /// Root mean square distance of the roots to the scalp before they are projected \[mm\].
    pub rms_mm: f64,
    /// Farthest root from the scalp before that \[mm\].
    pub worst_mm: f64,
    /// Particles that lay in the head and were moved out.
    pub moved_out: usize,
}

/// Units a groom may be in, by their millimetres.
const UNITS: [(&str, f64); 5] =
    [("millimetres", 1.0), ("centimetres", 10.0), ("inches", 25.4), ("decimetres", 100.0), ("metres", 1000.0)];
/// A groom's roots spread over 0.5 to 1.6 times as much as the captured ones: parts of a head, and larger heads. A unit that is
/// wrong is wrong by a factor of 2.5 at least.
const SPREAD_RANGE: std::ops::RangeInclusive<f64> = 0.5..=1.6;
/// Roots and captured roots that the search for the way up looks at; more do not change it.
const LOOKED_AT: usize = 400;
/// Share of the steepest fall that a way up must have. On a groom that hangs straight it leaves the turns about the vertical.
const HANGS: f64 = 0.8;
/// Steps of ICP for each way up, and for the best.
const STEPS: (usize, usize) = (15, 100);
/// A groom whose roots end further than this from the scalp on average is not on it \[mm\].
const NEAR_MM: f64 = 15.0;

/// Brings a groom onto a scalp.
///
/// `groom`: strands, root first, in the groom's space \[mm\]; `roots`: the captured roots; `gravity`: down, any length; `mesh` and
/// `skin`: the head's surface and its signed distance; all in head space. `clearance_mm`: strands keep this distance.
///
/// # Errors
/// No strand of two points; points that are not finite; roots that spread as if in another unit (the error names the unit);
/// roots that end nowhere near the scalp.
pub fn place(
    groom: &[Vec<DVec3>],
    (mesh, skin, roots): (&TriMesh, &SignedDistance, &[DVec3]),
    gravity: DVec3,
    alignment: Alignment,
    clearance_mm: f64,
    report: &mut Report,
) -> Result<PlacedGroom, StageError> {
    check(groom)?;
    let own_roots: Vec<DVec3> = groom.iter().filter(|s| s.len() > 1).map(|s| s[0]).collect();
    let surface = MeshDistance::new(mesh);
    let transform = match alignment {
        Alignment::AsGiven => Similarity::IDENTITY,
        Alignment::Given(transform) => transform,
        Alignment::Find => {
            check_unit(&own_roots, roots)?;
            find(groom, &own_roots, roots, &surface, gravity)?
        }
    };
    let distance = |p: &DVec3| surface.nearest(transform.point(*p)).map_or(f64::INFINITY, |n| n.signed_distance.abs());
    let distances: Vec<f64> = own_roots.par_iter().map(distance).collect();
    let rms_mm = (distances.iter().map(|d| d * d).sum::<f64>() / distances.len() as f64).sqrt();
    let worst_mm = distances.iter().copied().fold(0.0, f64::max);
    if rms_mm.is_nan() || rms_mm > NEAR_MM {
        return Err(StageError::Input {
            place: Place::default(),
            fact: format!("the groom's roots lie {rms_mm:.0} mm from the captured scalp (root mean square)"),
            hint: "check its unit and axes, or give the transform by hand (--transform)".into(),
        });
    }
    let placed: Vec<(Vec<DVec3>, usize)> = groom
        .par_iter()
        .map(|strand| {
            let mut points: Vec<DVec3> = strand.iter().map(|p| transform.point(*p)).collect();
            if let Some(nearest) = points.first().and_then(|root| surface.nearest(*root)) {
                let shift = nearest.point - points[0];
                points.iter_mut().for_each(|p| *p += shift);
            }
            let moved = push_out(&mut points, skin, clearance_mm);
            (points, moved)
        })
        .collect();
    let moved_out = placed.iter().map(|(_, moved)| moved).sum();
    if moved_out > 0 {
        let fact = format!("{moved_out} particles of the groom lie in the captured head");
        report.warn(Place::default(), fact, "they are moved out; lengths are kept");
    }
    Ok(PlacedGroom { strands: placed.into_iter().map(|(s, _)| s).collect(), transform, rms_mm, worst_mm, moved_out })
}

fn check(groom: &[Vec<DVec3>]) -> Result<(), StageError> {
    let input = |place: Place, fact: String, hint: &str| Err(StageError::Input { place, fact, hint: hint.into() });
    if !groom.iter().any(|s| s.len() > 1) {
        let fact =
            if groom.is_empty() { "the groom has no strands" } else { "all strands of the groom have one point" };
        return input(Place::default(), fact.into(), "give strands of two points or more, root first");
    }
    match groom.iter().position(|s| s.iter().any(|p| !p.is_finite())) {
        Some(n) => {
            input(Place::strand(n), "a point is not a number".into(), "repair the file that the groom comes from")
        }
        None => Ok(()),
    }
}

/// How much wider than the captured roots a groom's spread.
pub fn spread_ratio(own: &[DVec3], captured: &[DVec3]) -> f64 {
    spread(own) / spread(captured)
}

/// Whether roots that spread by this ratio may be those of a head.
pub fn is_of_a_head(ratio: f64) -> bool {
    SPREAD_RANGE.contains(&ratio)
}

/// Root mean square distance from the mean.
fn spread(points: &[DVec3]) -> f64 {
    let middle = mean(points);
    (points.iter().map(|p| p.distance_squared(middle)).sum::<f64>() / points.len().max(1) as f64).sqrt()
}

fn mean(points: &[DVec3]) -> DVec3 {
    points.iter().sum::<DVec3>() / points.len().max(1) as f64
}

fn check_unit(own: &[DVec3], captured: &[DVec3]) -> Result<(), StageError> {
    let ratio = spread_ratio(own, captured);
    if is_of_a_head(ratio) {
        return Ok(());
    }
    let unit = UNITS.iter().find(|(_, mm)| is_of_a_head(ratio * mm));
    let hint = match unit {
        Some((name, mm)) => format!("it seems to be in {name}: give --scale {mm}"),
        None => "give its scale to millimetres (--scale), or the whole transform (--transform)".into(),
    };
    let fact = format!("the groom's roots spread over {ratio:.3} times as much as the captured ones");
    Err(StageError::Input { place: Place::default(), fact, hint })
}

/// The way up under which the roots cover the captured ones best, refined by ICP with scale.
fn find(
    groom: &[Vec<DVec3>],
    own: &[DVec3],
    captured: &[DVec3],
    surface: &MeshDistance,
    gravity: DVec3,
) -> Result<Similarity, StageError> {
    let few = |points: &[DVec3]| -> Vec<DVec3> {
        let step = points.len().div_ceil(LOOKED_AT).max(1);
        points.iter().step_by(step).copied().collect()
    };
    let (some, seen) = (few(own), few(captured));
    let hang: DVec3 = groom.iter().filter(|s| s.len() > 1).map(|s| s[s.len() - 1] - s[0]).sum();
    let scale = (spread(captured) / spread(own)).clamp(0.5, 2.0);
    let start = |rotation: DMat3| Similarity {
        scale,
        rigid: RigidTransform { rotation, translation: mean(captured) - rotation * (mean(own) * scale) },
    };
    let fall = |turn: DMat3| (turn * hang).normalize_or_zero().dot(gravity.normalize_or_zero());
    let steepest = ways_up().into_iter().map(fall).fold(0.0, f64::max);
    // Hair falls: of the ways up only those count in which it hangs about as well as it can, before and after ICP.
    let hangs = |turn: DMat3| fall(turn) > HANGS * steepest;
    let in_place = mean(own).distance(mean(captured)) < spread(captured);
    let as_given = in_place.then_some(Similarity::IDENTITY).filter(|_| hangs(DMat3::IDENTITY));
    let turned = ways_up().into_iter().filter(|turn| hangs(*turn)).map(start);
    let starts: Vec<Similarity> = as_given.into_iter().chain(turned).collect();
    let tried: Vec<(f64, Similarity)> = starts
        .into_par_iter()
        .filter_map(|start| {
            let found: Icp = icp(&some, surface, start, true, STEPS.0)?;
            if !hangs(found.surface_from_source.rigid.rotation) {
                return None;
            }
            let moved: Vec<DVec3> = some.iter().map(|p| found.surface_from_source.point(*p)).collect();
            let to = |from: &[DVec3], points: &[DVec3]| {
                let nearest = |p: &DVec3| points.iter().map(|q| q.distance(*p)).fold(f64::INFINITY, f64::min);
                from.iter().map(nearest).sum::<f64>() / from.len() as f64
            };
            Some((to(&seen, &moved) + to(&moved, &seen) + found.rms_mm, found.surface_from_source))
        })
        .collect();
    let best = tried.iter().min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, transform)| *transform);
    let refined = best.and_then(|best| icp(&some, surface, best, true, STEPS.1)).map(|found| found.surface_from_source);
    refined.ok_or_else(|| StageError::Input {
        place: Place::default(),
        fact: "the groom's roots lie on a line or a point: nothing to align".into(),
        hint: "give the transform by hand (--transform)".into(),
    })
}

/// The 24 rotations that take axes to axes.
fn ways_up() -> Vec<DMat3> {
    let axes = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
    let pairs = axes.iter().flat_map(|x| axes.iter().map(move |y| (*x, *y)));
    pairs.filter(|(x, y)| x.dot(*y) == 0.0).map(|(x, y)| DMat3::from_cols(x, y, x.cross(y))).collect()
}

/// Moves a strand's particles, the root excepted, out of the head and keeps its edges; how many had to move.
fn push_out(points: &mut [DVec3], skin: &SignedDistance, clearance_mm: f64) -> usize {
    let edges: Vec<f64> = points.windows(2).map(|p| p[0].distance(p[1])).collect();
    let meets = |point: DVec3| {
        let way = lifted(point, skin, clearance_mm) - point;
        (way != DVec3::ZERO).then(|| Contact { depth: way.length(), normal: way.normalize_or_zero(), on_head: true })
    };
    let mut moved = BTreeSet::new();
    lay_outside(
        points,
        1,
        |i| (edges[i - 1], edges[i - 1]),
        meets,
        |i, _| {
            moved.insert(i);
        },
    );
    moved.len()
}

/// A point moved out of the head along the gradient.
pub(super) fn lifted(mut point: DVec3, skin: &SignedDistance, clearance_mm: f64) -> DVec3 {
    for _ in 0..4 {
        let (distance, gradient) = skin.distance_and_gradient(point);
        if distance >= clearance_mm {
            break;
        }
        point += gradient * ((clearance_mm - distance) / gradient.length_squared().max(1e-2));
    }
    point
}
