//! What strands can be coloured by.

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use strandflow_core::RigidTransform;
use strandflow_engine::Item;
use strandflow_eval::lengths::present_length;
use strandflow_view::{PerStrand, Refusal, Selection, describe::Attribute};

use super::{
    chosen::Chosen,
    sets::{Kind, Set, of_set},
    viewer::Viewer,
};

/// Names of the attributes, as requests call them.
pub mod name {
    pub const PROVENANCE: &str = "provenance";
    pub const CONFIDENCE: &str = "confidence";
    pub const SPEED: &str = "speed";
    pub const RELATIVE_SPEED: &str = "relative_speed";
    pub const LENGTH: &str = "length";
    pub const LENGTH_CHANGE: &str = "length_change";
    pub const RESIDUAL: &str = "residual";
    pub const REJECTED: &str = "rejected";
    pub const ERROR: &str = "error";
}

/// Every attribute with a range to begin with.
pub fn all() -> Vec<Attribute> {
    let measure =
        |name, per, unit, title, most| Attribute { name, per, unit, title, range: [0.0, most], categories: None };
    vec![
        Attribute {
            categories: Some(vec!["missing", "observed", "diffused", "simulated", "completed"]),
            ..measure(name::PROVENANCE, "point", "", "where a point comes from", 4.0)
        },
        measure(name::CONFIDENCE, "point", "", "trust in a point", 1.0),
        measure(name::SPEED, "point", "mm/s", "speed", 1000.0),
        measure(name::RELATIVE_SPEED, "point", "mm/s", "speed beside the head's motion", 1000.0),
        measure(name::LENGTH, "strand", "mm", "length in this frame", 300.0),
        Attribute {
            range: [-10.0, 10.0],
            ..measure(name::LENGTH_CHANGE, "strand", "%", "length against its median over time", 0.0)
        },
        measure(name::RESIDUAL, "strand", "mm", "distance of the fitted to the given points", 5.0),
        Attribute {
            categories: Some(vec!["kept", "by reprojection", "by the voxel field", "by its length"]),
            ..measure(name::REJECTED, "strand", "", "why the strand was rejected", 3.0)
        },
        measure(name::ERROR, "point", "mm", "distance to the nearest true strand", 10.0),
    ]
}

/// Names of the attributes that a set has.
pub fn of(viewer: &Viewer, set: &Set) -> Vec<String> {
    let source = viewer.source();
    let store = source.store().ok();
    let has = |path: &str| store.as_ref().is_some_and(|store| store.shape(path).is_ok());
    let mut names = vec![name::PROVENANCE, name::CONFIDENCE, name::SPEED];
    if has("pose/world_from_head") {
        names.push(name::RELATIVE_SPEED);
    }
    names.extend([name::LENGTH, name::LENGTH_CHANGE]);
    if set.is_fitted() && has("fit/residual_mm") {
        names.push(name::RESIDUAL);
    }
    if is_flagged(set) && has("prune/flags") {
        names.push(name::REJECTED);
    }
    if source.truth().is_some() && matches!(set.kind, Kind::Frames | Kind::Blocks) {
        names.push(name::ERROR);
    }
    names.into_iter().map(str::to_owned).collect()
}

/// Whether its strands are those that stage `prune` judged.
fn is_flagged(set: &Set) -> bool {
    set.id == "grow" || set.id == "prune"
}

/// Values of an attribute.
///
/// # Errors
/// The set has no such attribute or no such frame; results cannot be read.
pub fn values(
    viewer: &Viewer,
    set: &Set,
    wanted: &str,
    frame: usize,
    s: &Selection,
) -> Result<PerStrand<f32>, Refusal> {
    let have = of(viewer, set);
    if !have.iter().any(|known| known == wanted) {
        let truth = if wanted == name::ERROR { "; errors need --truth" } else { "" };
        let hint = format!("there are: {}{truth}", have.join(", "));
        return Err(Refusal::missing(format!("set {} has no attribute `{wanted}`", set.id), hint));
    }
    let chosen = viewer.chosen(set, frame, s)?;
    match wanted {
        name::PROVENANCE => Ok(marks(&chosen, |part| &part.provenance, 1.0, true)),
        name::CONFIDENCE => Ok(marks(&chosen, |part| &part.confidence, 255.0, false)),
        name::SPEED => speed(viewer, &chosen, frame, |_| Some(RigidTransform::IDENTITY)),
        name::RELATIVE_SPEED => {
            speed(viewer, &chosen, frame, |frame| chosen.set().head_from_world(viewer.source(), frame))
        }
        name::LENGTH => Ok(lengths(&chosen)),
        name::LENGTH_CHANGE => {
            let usual = viewer.usual_lengths(set)?;
            Ok(chosen.each(1, f32::NAN, |strand, row| {
                let length = present_length(chosen.strand(strand)).unwrap_or(f64::NAN);
                row[0] = (100.0 * (length / f64::from(usual[strand]) - 1.0)) as f32;
            }))
        }
        name::RESIDUAL => {
            let residual: Vec<f32> = viewer.source().store()?.read_all("fit/residual_mm").map_err(of_set(set))?;
            Ok(chosen.each(1, f32::NAN, |strand, row| row[0] = residual.get(strand).copied().unwrap_or(f32::NAN)))
        }
        name::REJECTED => rejected(viewer, &chosen, frame),
        _ => errors(viewer, &chosen, frame),
    }
}

/// Bytes of the store, divided; `nearest` for what cannot be mixed.
fn marks(chosen: &Chosen, of: fn(&super::parts::Part) -> &Vec<u8>, divisor: f32, nearest: bool) -> PerStrand<f32> {
    let own = |strand: usize| -> Vec<f32> {
        let part = chosen.part(strand);
        of(part)[part.range(strand)].iter().map(|mark| f32::from(*mark) / divisor).collect()
    };
    let missing = if nearest { 0.0 } else { f32::NAN };
    chosen.at_points(missing, own, |place, values| if nearest { values[place.nearer()] } else { place.mix(values) })
}

/// Lengths of what the frame has of each strand \[mm\].
pub fn lengths(chosen: &Chosen) -> PerStrand<f32> {
    chosen.each(1, f32::NAN, |strand, row| {
        row[0] = present_length(chosen.strand(strand)).map_or(f32::NAN, |length| length as f32);
    })
}

/// Speeds \[mm/s\] in a space that moves: over both neighbouring frames where both have the point, else over one.
fn speed(
    viewer: &Viewer,
    chosen: &Chosen,
    frame: usize,
    moving_from_world: impl Fn(usize) -> Option<RigidTransform>,
) -> Result<PerStrand<f32>, Refusal> {
    let (read, fps) = (viewer.read(), viewer.source().manifest().fps);
    let before = frame.checked_sub(1);
    let frames = [before, Some(frame), Some(frame + 1)];
    let poses = frames.map(|frame| frame.and_then(&moving_from_world));
    let (back, on) = (chosen.beside(read, before)?, chosen.beside(read, Some(frame + 1))?);
    let own = |strand: usize| -> Vec<f32> {
        let at = |blocks: &Option<_>, k: usize| -> Option<Vec3> {
            let part = chosen.part_in(blocks.as_ref()?, strand);
            part.points.get(part.range(strand).start + k).copied()
        };
        let now = chosen.strand(strand);
        let one = |k: usize| {
            let points = [at(&back, k), Some(now[k]), at(&on, k)];
            let moved = std::array::from_fn(|i| {
                let point = points[i].filter(|p| p.is_finite())?;
                Some(poses[i]?.point(point.as_dvec3()))
            });
            velocity(moved, fps).map_or(f32::NAN, |v| v.length() as f32)
        };
        (0..now.len()).map(one).collect()
    };
    Ok(chosen.at_points(f32::NAN, own, |place, values| place.mix(values)))
}

/// Velocity from positions before, now and after, a frame apart: the central difference where both neighbours are there, else
/// over one; `None` where there is no position now or no neighbour.
pub fn velocity([before, now, after]: [Option<DVec3>; 3], fps: f64) -> Option<DVec3> {
    let now = now?;
    match (before, after) {
        (Some(before), Some(after)) => Some((after - before) * 0.5 * fps),
        (Some(before), None) => Some((now - before) * fps),
        (None, Some(after)) => Some((after - now) * fps),
        (None, None) => None,
    }
}

/// Why stage `prune` rejected strands; NaN where it has not looked at the frame.
fn rejected(viewer: &Viewer, chosen: &Chosen, frame: usize) -> Result<PerStrand<f32>, Refusal> {
    let store = viewer.source().store()?;
    if store.record(&Item::Frame(frame).key("prune/prune")).is_none() {
        return Err(Refusal::missing(format!("stage prune has no frame {frame}"), viewer.source().run_hint()));
    }
    let flags: Vec<u8> =
        store.read("prune/flags", &[frame..frame + 1, 0..chosen.set().strands]).map_err(of_set(chosen.set()))?;
    Ok(chosen.each(1, f32::NAN, |strand, row| row[0] = flags.get(strand).copied().map_or(f32::NAN, f32::from)))
}

/// Distances to the truth \[mm\], at the points of the answer themselves.
fn errors(viewer: &Viewer, chosen: &Chosen, frame: usize) -> Result<PerStrand<f32>, Refusal> {
    let truth = viewer.source().truth().map(|truth| truth.frame(frame)).transpose()?.flatten();
    let Some(truth) = truth else {
        return Err(Refusal::missing(format!("the truth has no frame {frame}"), "errors need the truth of the frame"));
    };
    let PerStrand { points, values } = chosen.positions();
    let mut distances = vec![f32::NAN; values.len()];
    let strands = distances.par_chunks_mut(points.max(1)).zip(values.par_chunks(points.max(1)));
    strands.for_each(|(distances, strand)| truth.distances(strand, distances));
    Ok(PerStrand { points, values: distances })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn velocity_uses_what_is_there() {
        let at = |x: f64| Some(DVec3::X * x);
        let cases = [([at(1.0), at(9.0), at(3.0)], Some(100.0)), ([None, at(1.0), at(3.0)], Some(200.0))];
        for (points, expected) in cases {
            assert_eq!(velocity(points, 100.0).map(|v| v.x), expected);
        }
        assert_eq!(velocity([at(1.0), at(2.0), None], 100.0), Some(DVec3::X * 100.0));
        assert_eq!((velocity([None, at(1.0), None], 1.0), velocity([at(1.0), None, at(3.0)], 1.0)), (None, None));
    }

    #[test]
    fn every_attribute_has_a_range_and_a_name_of_its_own() {
        let all = all();
        assert!(all.iter().all(|a| a.range[0] < a.range[1] && !a.title.is_empty()));
        assert_eq!(all.iter().map(|a| a.name).collect::<std::collections::BTreeSet<_>>().len(), all.len());
    }
}
