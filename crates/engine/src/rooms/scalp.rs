//! Stage 4.

use glam::DVec3;
use strandflow_core::{Mask, Occupancy, Report, TriMesh};
use strandflow_stages::scalp::{ScalpFrame, ScalpInput};

use super::{need_hull, need_masks, need_pose, need_rig, of_stage, of_views, refs};
use crate::{EngineError, Needs, item::Item, store::Writer, table::Job};

/// Frames in which the head turned less than this since the first \[rad\] count as still: 2° moves the surface of a
/// 100 mm head by 3.5 mm, under two voxels, which the pose then takes out.
const STILL_RAD: f64 = 2.0 * std::f64::consts::PI / 180.0;
/// And in which its centre moved less than this \[mm\].
const STILL_MM: f64 = 10.0;
/// At most this many still frames are used, spread evenly: more add time, not surface.
const STILL_FRAMES: usize = 8;

pub(crate) fn prepare(_: &Job) -> Result<(), EngineError> {
    Ok(())
}

pub(crate) fn needs(job: &Job, _: Item, needs: &mut Needs) -> Result<(), EngineError> {
    need_rig(job, needs);
    needs.value("values", "seed", &job.plan.seed);
    needs.value("values", "gravity", &job.take.manifest().gravity);
    needs.item("pose/pose/take", &["pose/markers"])?;
    for frame in still_frames(job)? {
        need_pose(job, [frame].into_iter(), needs)?;
        need_hull(frame, needs)?;
        need_masks(job, frame, &["masks/subject", "masks/hair"], needs)?;
    }
    Ok(())
}

/// Frames of the slow start: from the first on as long as the head stays where it was, without those that have no hull.
/// A frame put right joins them: what the scalp rests on has changed then.
fn still_frames(job: &Job) -> Result<Vec<usize>, EngineError> {
    let poses = job.take.read_poses()?;
    let markers: Vec<DVec3> = poses.markers.first().into_iter().flatten().flatten().copied().collect();
    let centre = markers.iter().sum::<DVec3>() / markers.len().max(1) as f64;
    let still = poses
        .world_from_head
        .iter()
        .take_while(|pose| pose.angle() < STILL_RAD && pose.point(centre).distance(centre) < STILL_MM)
        .count()
        .max(1);
    let with_hull = |frame: usize| -> Result<Option<usize>, EngineError> {
        Ok(job.take.store().finished(&Item::Frame(frame).key("hull/hull"))?.map(|_| frame))
    };
    let frames = (0..still).map(|i| job.plan.lead.start + i);
    let still: Vec<usize> = frames.filter_map(|frame| with_hull(frame).transpose()).collect::<Result<_, _>>()?;
    let used = still.len().min(STILL_FRAMES);
    let spread = |i: usize| if used == 1 { 0 } else { i * (still.len() - 1) / (used - 1) };
    Ok((0..used).map(|i| still[spread(i)]).collect())
}

/// One still frame, loaded.
struct Loaded {
    frame: usize,
    hull: Occupancy,
    subjects: Vec<Mask>,
    hairs: Vec<Mask>,
}

fn load(job: &Job, frame: usize) -> Result<Loaded, EngineError> {
    let take = job.take;
    let subjects = of_views(job, |view| take.read_subject(view, frame))?;
    let hairs = of_views(job, |view| take.read_hair(view, frame))?;
    Ok(Loaded { frame, hull: take.read_hull(frame)?, subjects, hairs })
}

pub(crate) fn run(job: &Job, _: Item, out: &mut Writer, report: &mut Report) -> Result<(), EngineError> {
    let loaded = still_frames(job)?.into_iter().map(|frame| load(job, frame)).collect::<Result<Vec<Loaded>, _>>()?;
    let frames = loaded
        .iter()
        .map(|l| {
            Ok(ScalpFrame {
                world_from_head: job.take.read_pose(l.frame)?,
                hull: &l.hull,
                subjects: refs(&l.subjects),
                hairs: refs(&l.hairs),
            })
        })
        .collect::<Result<Vec<_>, EngineError>>()?;
    let poses = job.take.read_poses()?;
    let markers: Vec<DVec3> = poses.markers.first().into_iter().flatten().flatten().copied().collect();
    let input = ScalpInput {
        rig: job.take.views().rig(),
        frames: &frames,
        markers: &markers,
        gravity: job.take.gravity(),
        seed: job.plan.seed,
    };
    let scalp = strandflow_stages::scalp::scalp(&input, &job.plan.settings.scalp, report).map_err(of_stage("scalp"))?;
    let TriMesh { vertices, faces } = &scalp.mesh;
    write_vectors(out, "scalp/vertices", vertices)?;
    out.whole("scalp/faces", &[faces.len(), 3], faces.as_flattened())?;
    write_vectors(out, "scalp/roots", &scalp.roots)?;
    write_vectors(out, "scalp/normals", &scalp.normals)
}

fn write_vectors(out: &mut Writer, path: &str, vectors: &[DVec3]) -> Result<(), EngineError> {
    let samples: Vec<f64> = vectors.iter().flat_map(|v| v.to_array()).collect();
    out.whole(path, &[vectors.len(), 3], &samples)
}
