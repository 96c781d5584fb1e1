//! Where stage `pose` saw the markers.

use std::collections::BTreeMap;

use glam::DVec3;
use strandflow_core::Rig;
use strandflow_engine::{EngineError, Item, store::Store};
use strandflow_view::{Refusal, desk::Tracks};

use crate::view::source::{Source, broken};

/// Of one frame; nothing where the stage has not seen it.
pub fn get(source: &Source, rig: &Rig, frame: usize) -> Result<Tracks, Refusal> {
    let store = source.store().ok().filter(|store| store.record(&Item::Take.key("pose/pose")).is_some());
    let (Some(store), Some(t)) = (store, frame.checked_sub(source.begins())) else { return Ok(Tracks::default()) };
    // Takes of earlier versions do not say which marker is which.
    let Ok(ids) = store.read_all::<u32>("pose/ids") else { return Ok(Tracks::default()) };
    read(&store, rig, &ids, t).map_err(broken)
}

fn read(store: &Store, rig: &Rig, ids: &[u32], t: usize) -> Result<Tracks, EngineError> {
    let times = store.shape("pose/rms_px")?[0];
    if t >= times {
        return Ok(Tracks::default());
    }
    let count = ids.len();
    let points: Vec<f64> = store.read("pose/tracks", &[t..t + 1, 0..rig.view_count(), 0..count, 0..2])?;
    let first: Vec<f64> = store.read("pose/markers", &[0..1, 0..count, 0..3])?;
    let pose = store.read_pose(t)?;
    let mut views: BTreeMap<String, BTreeMap<u32, [f64; 2]>> = BTreeMap::new();
    for (camera, row) in rig.cameras.iter().zip(points.chunks_exact((2 * count).max(1))) {
        let seen = ids.iter().zip(row.chunks_exact(2)).filter(|(_, uv)| uv[0].is_finite() && uv[1].is_finite());
        views.insert(camera.name.clone(), seen.map(|(&id, uv)| (id, [uv[0], uv[1]])).collect());
    }
    let known = ids.iter().zip(first.chunks_exact(3)).map(|(&id, xyz)| (id, pose.point(DVec3::from_slice(xyz))));
    let rms: Vec<f64> = store.read("pose/rms_px", std::slice::from_ref(&(t..t + 1)))?;
    let used: Vec<u32> = store.read("pose/used", std::slice::from_ref(&(t..t + 1)))?;
    let interpolated: Vec<u8> = store.read("pose/interpolated", std::slice::from_ref(&(t..t + 1)))?;
    Ok(Tracks {
        views,
        markers: known.filter(|(_, p)| p.is_finite()).map(|(id, p)| (id, p.to_array())).collect(),
        used: used.first().copied().unwrap_or(0),
        rms_px: rms.first().copied().filter(|rms| rms.is_finite()),
        interpolated: interpolated.first() == Some(&1),
    })
}
