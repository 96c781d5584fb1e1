//! Stage 3.

use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, PoisonError},
};

use glam::DVec2;
use strandflow_core::{FrameRange, Place, Report, RigidTransform};
use strandflow_stages::{
    StageError,
    pose::{HeadPoses, MarkerLabel, PoseInput},
};

use super::{need_rig, of_stage};
use crate::{
    EngineError, Needs,
    item::Item,
    sources::{NumberedMarker, TakeLabels},
    store::{Record, Store, Writer},
    table::Job,
};

/// The motion of the head in all frames, which most items rest on: read once as long as its record stays the same.
#[derive(Default)]
pub(crate) struct KnownMotion(Mutex<Option<(String, Arc<Motion>)>>);

/// `world_from_head` by frame of the take, from its first.
pub(crate) type Motion = Vec<RigidTransform>;

const MOTION: &str = "pose/world_from_head";

impl KnownMotion {
    /// The motion that a record tells of.
    pub(crate) fn of(&self, store: &Store, record: &Record) -> Result<Arc<Motion>, EngineError> {
        let hash = record.outputs.get(MOTION).cloned().unwrap_or_default();
        let known = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, motion)) = known().as_ref().filter(|(of, _)| *of == hash) {
            return Ok(motion.clone());
        }
        let motion: Arc<Motion> = Arc::new(store.read_head_motion()?);
        *known() = Some((hash, motion.clone()));
        Ok(motion)
    }
}

pub(crate) fn prepare(_: &Job) -> Result<(), EngineError> {
    Ok(())
}

pub(crate) fn needs(job: &Job, _: Item, needs: &mut Needs) -> Result<(), EngineError> {
    need_rig(job, needs);
    needs.file(job.take.sources().labels_file())?;
    needs.value("values", "frames", &job.plan.lead);
    let frames = looked_at(job, &job.take.sources().labels(job.take.views().rig())?);
    for &view in job.take.views().taking_part() {
        for frame in frames.start..frames.end {
            needs.file(&job.take.sources().image_file(view, frame)?)?;
        }
    }
    Ok(())
}

/// The frames asked for, and those up to the labelled one where it lies behind them: tracks begin there.
fn looked_at(job: &Job, labels: &TakeLabels) -> FrameRange {
    FrameRange { end: job.plan.lead.end.max(labels.frame + 1), ..job.plan.lead }
}

pub(crate) fn run(job: &Job, _: Item, out: &mut Writer, report: &mut Report) -> Result<(), EngineError> {
    let views = job.take.views();
    let labelled = job.take.sources().labels(views.rig())?;
    let frames = looked_at(job, &labelled);
    let labels: Vec<MarkerLabel> = labelled.markers.into_iter().map(label).collect();
    let corrections =
        labelled.corrections.into_iter().map(|(frame, markers)| (frame, markers.into_iter().map(label).collect()));
    let corrections: BTreeMap<usize, Vec<MarkerLabel>> = corrections.collect();
    let images = views.images(job.take.images());
    let (rig, labelled) = (views.rig(), labelled.frame);
    let input = PoseInput { rig, images: &images, frames, labelled, labels: &labels, corrections: &corrections };
    let mut poses = strandflow_stages::pose::pose(&input, job.plan.mode, &job.plan.settings.pose, report)
        .map_err(of_stage("pose"))?;
    cut(&mut poses, job.plan.lead.len());
    let ids: Vec<u32> = labels.iter().map(|label| label.id).collect();
    write(job, out, &poses, &ids)
}

/// Leaves the first frames.
fn cut(poses: &mut HeadPoses, times: usize) {
    poses.world_from_head.truncate(times);
    poses.markers.truncate(times);
    poses.tracks.truncate(times);
    poses.rms_px.truncate(times);
    poses.used.truncate(times);
    poses.interpolated.truncate(times);
}

fn label((id, views): NumberedMarker) -> MarkerLabel {
    MarkerLabel { id, views: views.into_iter().map(|(v, uv)| (v, DVec2::from_array(uv))).collect() }
}

fn write(job: &Job, out: &mut Writer, poses: &HeadPoses, ids: &[u32]) -> Result<(), EngineError> {
    let markers = ids.len();
    let (times, views) = (poses.world_from_head.len(), job.take.rig().view_count());
    let part = job.take.views().taking_part();
    for (t, pose) in poses.world_from_head.iter().enumerate() {
        if !(pose.translation.is_finite() && pose.rotation.is_finite()) {
            let place = Place::frame(job.plan.lead.start + t);
            return Err(of_stage("pose")(StageError::NonFinite { place, what: "the head pose".into() }));
        }
    }
    let rows: Vec<f64> = poses.world_from_head.iter().flat_map(|pose| pose.to_rows()).flatten().collect();
    out.whole(MOTION, &[times, 4, 4], &rows)?;
    let positions = poses.markers.iter().flatten().flat_map(|m| m.map_or([f64::NAN; 3], |p| p.to_array()));
    out.whole("pose/markers", &[times, markers, 3], &positions.collect::<Vec<_>>())?;
    let mut tracks = vec![[f64::NAN; 2]; times * views * markers];
    for (t, seen) in poses.tracks.iter().enumerate() {
        for (&view, points) in part.iter().zip(seen) {
            let row = &mut tracks[(t * views + view) * markers..][..markers];
            row.iter_mut().zip(points).for_each(|(to, p)| *to = p.map_or([f64::NAN; 2], |p| p.to_array()));
        }
    }
    out.whole("pose/tracks", &[times, views, markers, 2], tracks.as_flattened())?;
    out.whole("pose/ids", &[markers], ids)?;
    out.whole("pose/rms_px", &[times], &poses.rms_px)?;
    out.whole("pose/used", &[times], &poses.used)?;
    out.whole("pose/interpolated", &[times], &poses.interpolated.iter().map(|&i| u8::from(i)).collect::<Vec<_>>())
}
