//! Animations of a take: another groom driven by its captured motion, frame after frame, in the results store.
//!
//! Frames follow from one another, so they are made in order; a run that was stopped goes on behind the last finished frame,
//! and gives the same bytes. Memory: the groom, a state, and the two to four fields around a frame.

use std::{
    collections::{BTreeMap, btree_map::Entry},
    path::PathBuf,
    sync::atomic::{AtomicBool, Ordering},
    time::Instant,
};

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use serde::Serialize;
use strandflow_core::{Finding, Report, RigidTransform, SparseVoxels, TriMesh};
use strandflow_dynamics::{Params, driven::DrivenState};
use strandflow_geometry::{icp::Similarity, signed_distance::SignedDistance};
use strandflow_stages::animate::{
    Alignment, AnimateSettings, Animation, Captured, Obstacles, PlacedGroom, Timeline, needed, place,
};

use crate::{EngineError, Performance, memory, needs::Identities};

mod frames;

pub use frames::{AnimationStrands, animations, world_from_head};

use frames::Folder;

/// What is to be animated, and how.
pub struct AnimationPlan<'a> {
    /// Name of the animation: letters, digits, `-` and `_`.
    pub name: &'a str,
    /// The groom, root first, in its own space \[mm\].
    pub groom: &'a [Vec<DVec3>],
    /// How it comes onto the scalp.
    pub alignment: Alignment,
    /// Whether strands take the springs of the captured strand nearest to their root.
    pub fitted_springs: bool,
    /// Captured frames to show.
    pub timeline: Timeline,
    /// Other velocities than the captured ones.
    pub field: Option<OtherField<'a>>,
    /// What stands still and hair may not enter, such as shoulders, world \[mm\].
    pub still: Option<&'a TriMesh>,
    /// All else.
    pub settings: AnimateSettings,
}

/// Velocities that are not the take's.
pub struct OtherField<'a> {
    /// Where they come from, in a word.
    pub from: &'a str,
    /// The files that they are read from.
    pub files: Vec<PathBuf>,
    /// The field of a frame \[mm/s\].
    pub of: FieldOf<'a>,
}

/// A velocity field by frame.
pub type FieldOf<'a> = &'a (dyn Fn(usize) -> Result<SparseVoxels<Vec3>, EngineError> + Sync);

/// What came of it.
#[derive(Clone, Debug, Serialize)]
pub struct AnimationSummary {
    /// Strands and particles.
    pub strands: usize,
    /// See `strands`.
    pub particles: usize,
    /// Distance of the groom's roots to the scalp before they were projected, root mean square and worst \[mm\].
    pub roots_rms_mm: f64,
    /// See `roots_rms_mm`.
    pub roots_worst_mm: f64,
    /// Head space of the first frame shown from the groom's space: scale, and the rigid motion after it.
    pub scale: f64,
    /// Frames made now, and found finished.
    pub made: usize,
    /// See `made`.
    pub found: usize,
    /// Whether it was stopped before the end.
    pub interrupted: bool,
    /// Most strands with a point in the head, or in what stands still, in any frame.
    pub in_head: usize,
    /// Mean relative change of a strand's length against the groom over all frames, and the most of any strand.
    pub length_change_mean: f64,
    /// See `length_change_mean`.
    pub length_change_most: f64,
    /// Seconds a frame made now: all, and without reading fields and writing frames.
    pub secs_a_frame: f64,
    /// See `secs_a_frame`.
    pub simulation_secs_a_frame: f64,
    /// Most memory in use \[MB\], where the system tells.
    pub peak_mb: Option<f64>,
    /// What was survived.
    pub findings: Vec<Finding>,
}

/// Voxels of the head's signed distance \[mm\]: finer takes memory, coarser rounds the ears off.
const SKIN_VOXEL_MM: f64 = 2.0;
/// The same for what stands still, which is larger and smoother.
const STILL_VOXEL_MM: f64 = 4.0;
/// How far around that it is sampled \[mm\]; beyond, the distance is to the box.
const STILL_MARGIN_MM: f64 = 12.0;
/// How far around the head it is sampled \[mm\].
const SKIN_MARGIN_MM: f64 = 24.0;

/// Makes an animation, or what is left of it; `tell` hears of every finished frame.
///
/// # Errors
/// `Input` for a name that is none, settings out of range, frames that were not captured; `Stage` for a groom that cannot be
/// placed; `Disk` and `Store`.
pub fn animate(
    performance: &Performance,
    plan: &AnimationPlan,
    stop: &AtomicBool,
    tell: &dyn Fn(usize),
) -> Result<AnimationSummary, EngineError> {
    check(performance, plan)?;
    memory::reset_peak();
    let mut report = Report::default();
    let scalp = performance.scalp()?;
    let skin = SignedDistance::from_mesh(&scalp.mesh, SKIN_VOXEL_MM, SKIN_MARGIN_MM);
    let still = plan.still.map(|mesh| SignedDistance::from_mesh(mesh, STILL_VOXEL_MM, STILL_MARGIN_MM));
    let obstacles = Obstacles { skin: &skin, still: still.as_ref() };
    let first_pose = performance.pose(plan.timeline.first)?;
    let down = first_pose.inverse().vector(performance.gravity());
    // The groom is given in the world of the first frame shown.
    let alignment = match plan.alignment {
        Alignment::AsGiven => in_head(&first_pose, Similarity::IDENTITY),
        Alignment::Given(transform) => in_head(&first_pose, transform),
        Alignment::Find => Alignment::Find,
    };
    let placed =
        place(plan.groom, (&scalp.mesh, &skin, &scalp.roots), down, alignment, plan.settings.clearance_mm, &mut report)
            .map_err(|error| EngineError::Stage { stage: "animate".into(), error: Box::new(error) })?;
    let params = springs(performance, plan, &placed, &scalp.roots)?;
    let frame_secs = 1.0 / performance.fps();
    let animation =
        Animation::new(&placed, |n| params[n], &plan.settings, (performance.gravity(), first_pose), frame_secs);

    let folder = Folder::new(performance.store(), plan.name, &animation.counts());
    let inputs = inputs(performance, plan, &placed)?;
    let (found, mut state): (usize, DrivenState) = folder.resumed(&inputs, plan.timeline.frames)?;
    if found == 0 {
        folder.begin(plan.timeline.frames)?;
    }
    let mut summary = AnimationSummary {
        strands: placed.strands.len(),
        particles: placed.strands.iter().map(Vec::len).sum(),
        roots_rms_mm: placed.rms_mm,
        roots_worst_mm: placed.worst_mm,
        scale: placed.transform.scale,
        made: 0,
        found,
        interrupted: false,
        in_head: 0,
        length_change_mean: 0.0,
        length_change_most: 0.0,
        secs_a_frame: 0.0,
        simulation_secs_a_frame: 0.0,
        peak_mb: None,
        findings: report.findings,
    };
    let mut checks = folder.checks(found)?;
    let mut fields = BTreeMap::new();
    let (started, mut simulating) = (Instant::now(), 0.0);
    for k in found..plan.timeline.frames {
        if stop.load(Ordering::Relaxed) {
            summary.interrupted = true;
            break;
        }
        if k == 0 {
            state = animation.start(&first_pose, &obstacles);
        } else {
            let frames = needed(&plan.timeline, k - 1);
            load(performance, plan, &mut fields, frames.clone())?;
            let poses = frames.clone().map(|f| performance.pose(f)).collect::<Result<Vec<_>, _>>()?;
            let held: Vec<&SparseVoxels<Vec3>> = fields.values().collect();
            let captured = Captured { first: *frames.start(), poses: &poses, fields: &held, obstacles };
            let before = Instant::now();
            animation.advance(&mut state, k - 1, &plan.timeline, &captured);
            simulating += before.elapsed().as_secs_f64();
        }
        let pose = pose_at(performance, plan.timeline.source(k as f64))?;
        let check = animation.check(&state, &pose, &obstacles);
        folder.write(k, (&state, &pose), &inputs, &check)?;
        checks.push(check);
        summary.made += 1;
        tell(k);
    }
    let looked_at: usize = checks.iter().map(|c| c.strands).sum();
    summary.in_head = checks.iter().map(|c| c.in_head).max().unwrap_or(0);
    summary.length_change_mean = checks.iter().map(|c| c.length_change_sum).sum::<f64>() / looked_at.max(1) as f64;
    summary.length_change_most = checks.iter().map(|c| c.length_change_most).fold(0.0, f64::max);
    summary.secs_a_frame = started.elapsed().as_secs_f64() / summary.made.max(1) as f64;
    summary.simulation_secs_a_frame = simulating / summary.made.max(1) as f64;
    summary.peak_mb = memory::peak_mb();
    Ok(summary)
}

fn check(performance: &Performance, plan: &AnimationPlan) -> Result<(), EngineError> {
    let word = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    if plan.name.is_empty() || !plan.name.chars().all(word) {
        let hint = "use letters, digits, `-` and `_`";
        return Err(EngineError::input(format!("--name {}", plan.name), "is no name of an animation", hint));
    }
    let found = plan.settings.check();
    if !found.is_empty() {
        let text: Vec<String> = found.iter().map(ToString::to_string).collect();
        return Err(EngineError::input("animate", text.join("\n  "), "give values within these ranges"));
    }
    let (all, t) = (performance.frames(), &plan.timeline);
    if t.first > t.last || t.first < all.start || t.last >= all.end || !(t.speed > 0.0 && t.speed <= 10.0) {
        let fact = format!("frames {}..{} at speed {}", t.first, t.last + 1, t.speed);
        let hint = format!("the take has the frames {all}; a speed lies above 0 and up to 10");
        return Err(EngineError::input("animate", fact, hint));
    }
    Ok(())
}

/// The same transform, into the head.
fn in_head(world_from_head: &RigidTransform, transform: Similarity) -> Alignment {
    Alignment::Given(Similarity { scale: transform.scale, rigid: world_from_head.inverse().after(&transform.rigid) })
}

/// Spring parameters by strand.
fn springs(
    performance: &Performance,
    plan: &AnimationPlan,
    placed: &PlacedGroom,
    roots: &[DVec3],
) -> Result<Vec<Params>, EngineError> {
    if !plan.fitted_springs {
        return Ok(vec![Params::default(); placed.strands.len()]);
    }
    let fitted = performance.fitted()?;
    let nearest = |root: &DVec3| {
        let known = roots.iter().zip(&fitted);
        known.min_by(|a, b| a.0.distance_squared(*root).total_cmp(&b.0.distance_squared(*root))).map(|(_, p)| *p)
    };
    let of = |strand: &Vec<DVec3>| strand.first().and_then(nearest).unwrap_or_default();
    Ok(placed.strands.par_iter().map(of).collect())
}

/// The captured fields of some frames, and no others.
fn load(
    performance: &Performance,
    plan: &AnimationPlan,
    fields: &mut BTreeMap<usize, SparseVoxels<Vec3>>,
    frames: std::ops::RangeInclusive<usize>,
) -> Result<(), EngineError> {
    fields.retain(|frame, _| frames.contains(frame));
    for frame in frames {
        if let Entry::Vacant(place) = fields.entry(frame) {
            let captured = || performance.field(frame);
            place.insert(plan.field.as_ref().map_or_else(captured, |other| (other.of)(frame))?);
        }
    }
    Ok(())
}

/// The head between two captured frames.
fn pose_at(performance: &Performance, time: f64) -> Result<RigidTransform, EngineError> {
    let before = time as usize;
    let poses = [performance.pose(before)?, performance.pose((before + 1).min(performance.frames().end - 1))?];
    Ok(strandflow_stages::animate::pose_at(&poses, (0, 1, time.fract())))
}

/// What an animation rests on, hashed by kind.
fn inputs(
    performance: &Performance,
    plan: &AnimationPlan,
    placed: &PlacedGroom,
) -> Result<BTreeMap<String, String>, EngineError> {
    let files = Identities::default();
    let mut needs = crate::Needs::new(performance.store(), &files);
    needs.value("version", "animate", &VERSION);
    needs.value("settings", "animate", &plan.settings);
    needs.value("settings", "fitted", &plan.fitted_springs);
    needs.value("settings", "field", &plan.field.as_ref().map(|other| other.from));
    plan.field.iter().flat_map(|other| &other.files).try_for_each(|file| needs.file(file))?;
    let t = &plan.timeline;
    // The number of frames is left out where it only says how far to go on.
    let to_and_fro = t.frames > Timeline::once(t.first, t.last, t.speed).frames;
    needs.value("settings", "still", &plan.still.map(mesh_hash));
    needs.value("settings", "timeline", &(t.first, t.last, t.speed, to_and_fro));
    let Similarity { scale, rigid } = placed.transform;
    needs.value("settings", "placed", &(scale, rigid.to_rows()));
    needs.value("values", "take", &(performance.fps(), performance.gravity().to_array()));
    needs.value("groom", "strands", &hash_of(plan.groom));
    for frame in t.first..=t.last {
        needs.value("stage flow", "field", &performance.record_of(frame).map(|record| record.outputs));
    }
    for item in ["pose/pose/take", "scalp/scalp/take", "fit/fit"] {
        needs.value("stages", item, &performance.store().record(item).map(|record| record.outputs));
    }
    Ok(needs.finish().0)
}

/// A hash of a mesh.
fn mesh_hash(mesh: &TriMesh) -> String {
    let corners = mesh.faces.iter().map(|face| face.map(|v| mesh.vertices[v as usize]).to_vec());
    hash_of(&corners.collect::<Vec<_>>())
}

/// A hash of all points.
fn hash_of(groom: &[Vec<DVec3>]) -> String {
    let mut hasher = blake3::Hasher::new();
    for strand in groom {
        hasher.update(&(strand.len() as u64).to_le_bytes());
        strand.iter().flat_map(|p| p.to_array()).for_each(|x| {
            hasher.update(&x.to_le_bytes());
        });
    }
    hasher.finalize().to_hex().to_string()
}

/// Raised when the same input would give another animation.
const VERSION: u32 = 3;
