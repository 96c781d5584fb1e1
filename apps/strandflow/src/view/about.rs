//! What a take has to show.

use glam::{DMat3, DVec3, Vec3};
use strandflow_core::{Camera, Rig};
use strandflow_engine::store::Store;
use strandflow_view::{
    Selection,
    describe::{Bounds, Layers, Motion, Note, Set as SetJson, Take, View},
};

use super::{
    attributes, ranges,
    sets::{Kind, Set},
    source::Source,
    stages,
    viewer::Viewer,
};

/// Strands and points of each by which the bounds are found.
const STRANDS_FOR_BOUNDS: usize = 1000;
const POINTS_FOR_BOUNDS: usize = 8;
/// Half the edge of the box that is shown where nothing is known but the cameras \[mm\]: a head with long hair.
const REACH_MM: f64 = 300.0;

/// Everything, as it is now.
pub fn take(viewer: &Viewer) -> Take {
    let source = viewer.source();
    let (store, plan, manifest) = (source.store().ok(), source.plan(), source.manifest());
    let frames = source.frames();
    let sets = Set::all(source);
    let mut notes = source.notes().to_vec();
    if plan.is_none() {
        notes.push(Note { fact: "the take has not been run yet".into(), hint: source.run_hint() });
    }
    Take {
        name: source.name(),
        fps: manifest.fps,
        frames: [frames.start, frames.end],
        gravity: manifest.gravity,
        world_from_head: store.as_ref().and_then(|store| motion(source, store)).unwrap_or_default(),
        bounds: bounds(viewer, &sets, store.as_ref()),
        views: views(source),
        attributes: ranges::attributes(viewer, &sets),
        sets: sets.iter().map(|set| described(viewer, set)).collect(),
        layers: store.as_ref().map_or_else(Layers::default, layers),
        stages: stages::of(store.as_ref(), plan.as_ref(), manifest.views.len()),
        notes,
    }
}

fn described(viewer: &Viewer, set: &Set) -> SetJson {
    SetJson {
        id: set.id.clone(),
        title: set.title(),
        strands: set.strands,
        points: set.points,
        frames: [set.frames.start, set.frames.end],
        done: set.done(viewer.source()),
        attributes: attributes::of(viewer, set),
    }
}

fn motion(source: &Source, store: &Store) -> Option<Motion> {
    let rows: Vec<f64> = store.read_all("pose/world_from_head").ok()?;
    let pose = |rows: &[f64]| rows.iter().all(|v| v.is_finite()).then(|| rows.to_vec());
    Some(Motion { first: source.begins(), poses: rows.chunks_exact(16).map(pose).collect() })
}

/// The cameras; none where the calibration cannot be read.
pub fn views(source: &Source) -> Vec<View> {
    let view = |(i, camera): (usize, &Camera)| View {
        name: camera.name.clone(),
        width: camera.width,
        height: camera.height,
        fx: camera.focal[0],
        fy: camera.focal[1],
        cx: camera.principal[0],
        cy: camera.principal[1],
        camera_from_world: camera.camera_from_world.to_rows().as_flattened().to_vec(),
        center: camera.centre_in_world().to_array(),
        footage: source.footage(i).is_some(),
        held_out: source.manifest().held_out.contains(&camera.name),
    };
    source.rig().map_or_else(Vec::new, |rig| rig.cameras.iter().enumerate().map(view).collect())
}

fn layers(store: &Store) -> Layers {
    let some = |phase: &str| store.items_of(phase).iter().any(|key| store.record(key).is_some());
    Layers {
        hull: some("hull/hull"),
        lines: some("lift/lift"),
        arrows: some("flow/flow"),
        masks: some("masks/masks"),
        orientation: some("orient/orient"),
        head: some("scalp/scalp"),
    }
}

/// A box around the strands of the last set's first frame; else the take's grid, or what the cameras look at.
fn bounds(viewer: &Viewer, sets: &[Set], store: Option<&Store>) -> Bounds {
    // Animations may go anywhere; the take's own strands are where the footage is.
    let own = sets.iter().rev().filter(|set| set.kind != Kind::Animation).find_map(|set| around_strands(viewer, set));
    let grid = || {
        let grid = store?.read_grid().ok()?;
        let [x, y, z] = grid.dims.map(|n| n as f64 * grid.voxel_mm);
        Some((grid.origin, grid.origin + DVec3::new(x, y, z)))
    };
    let looked_at = || viewer.source().rig().and_then(looked_at).map(|p| (p - REACH_MM, p + REACH_MM));
    let found = own.or_else(grid).or_else(looked_at);
    let (lo, hi) = found.unwrap_or((DVec3::splat(-REACH_MM), DVec3::splat(REACH_MM)));
    Bounds { lo: lo.to_array(), hi: hi.to_array() }
}

fn around_strands(viewer: &Viewer, set: &Set) -> Option<(DVec3, DVec3)> {
    let frame = *set.done(viewer.source()).first()?;
    let stride = set.strands.div_ceil(STRANDS_FOR_BOUNDS).max(1);
    let selection = Selection { stride, points: Some(POINTS_FOR_BOUNDS), ..Selection::default() };
    let points = viewer.chosen(set, frame, &selection).ok()?.positions().values;
    let present = || points.iter().copied().filter(|p| p.is_finite());
    let (lo, hi) = (present().reduce(Vec3::min)?, present().reduce(Vec3::max)?);
    Some((lo.as_dvec3(), hi.as_dvec3()))
}

/// The point nearest to all optical axes; none where they do not meet.
fn looked_at(rig: &Rig) -> Option<DVec3> {
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for camera in &rig.cameras {
        let axis = camera.camera_from_world.inverse().vector(DVec3::Z);
        let across = DMat3::IDENTITY - DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        matrix += across;
        right += across * camera.centre_in_world();
    }
    (matrix.determinant().abs() > 1e-6).then(|| matrix.inverse() * right).filter(|p| p.is_finite())
}

#[cfg(test)]
mod tests {
    use strandflow_core::{Distortion, RigidTransform};

    use super::*;

    #[test]
    fn axes_meet_where_the_cameras_look() {
        let target = DVec3::new(30.0, -20.0, 1200.0);
        let camera = |direction: DVec3| {
            let forward = -direction.normalize();
            let side = forward.cross(DVec3::Y).normalize();
            let rotation = DMat3::from_cols(side, forward.cross(side), forward).transpose();
            Camera {
                name: String::new(),
                width: 4,
                height: 4,
                focal: [4.0; 2],
                principal: [2.0; 2],
                distortion: Distortion::None,
                camera_from_world: RigidTransform { rotation, translation: -(rotation * (target + direction)) },
            }
        };
        let cameras = vec![camera(DVec3::X * 900.0), camera(DVec3::new(100.0, 50.0, 800.0))];
        assert!(looked_at(&Rig { cameras: cameras.clone() }).unwrap().distance(target) < 1e-6);
        assert!(looked_at(&Rig { cameras: cameras[..1].to_vec() }).is_none());
    }
}
