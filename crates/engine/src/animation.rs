//! Animations of a take: another groom driven by its captured motion, frame after frame, in the results store.
//!
//! Frames follow from one another, so they are made in order; a run that was stopped goes on behind the last finished frame,
//! and gives the same bytes. Memory: the groom, a state, and the two to four fields around a frame.

use std::{
    collections::{BTreeMap, btree_map::Entry},
    ops::Range,
    path::PathBuf,
    sync::atomic::{AtomicBool, Ordering},
    time::Instant,
};

use glam::{DVec3, Vec3};
use serde::Serialize;
use strandflow_core::{Finding, Provenance, Report, RigidTransform, SparseVoxels, StrandSequence};
use strandflow_dynamics::{Params, driven::DrivenState};
use strandflow_geometry::{icp::Similarity, signed_distance::SignedDistance};
use strandflow_io::{At, IoError, strands::StrandFrames};
use strandflow_stages::animate::{
    Alignment, AnimateSettings, Animation, Captured, FrameCheck, PlacedGroom, Timeline, needed, place,
};

use crate::{
    EngineError, Performance,
    item::BLOCK_STRANDS,
    memory,
    needs::Identities,
    store::{Record, Store, Writer},
};

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
    /// Most strands with a point in the head in any frame.
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
    let (found, mut state) = folder.resumed(&inputs, plan.timeline.frames)?;
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
    let mut checks = (0..found).filter_map(|k| folder.check_of(k)).collect::<Vec<FrameCheck>>();
    let mut fields = BTreeMap::new();
    let (started, mut simulating) = (Instant::now(), 0.0);
    for k in found..plan.timeline.frames {
        if stop.load(Ordering::Relaxed) {
            summary.interrupted = true;
            break;
        }
        if k == 0 {
            state = animation.start(&first_pose);
        } else {
            let frames = needed(&plan.timeline, k - 1);
            load(performance, plan, &mut fields, frames.clone())?;
            let poses = frames.clone().map(|f| performance.pose(f)).collect::<Result<Vec<_>, _>>()?;
            let held: Vec<&SparseVoxels<Vec3>> = fields.values().collect();
            let captured = Captured { first: *frames.start(), poses: &poses, fields: &held, skin: &skin };
            let before = Instant::now();
            animation.advance(&mut state, k - 1, &plan.timeline, &captured);
            simulating += before.elapsed().as_secs_f64();
        }
        let pose = pose_at(performance, plan.timeline.source(k as f64))?;
        let check = animation.check(&state, &pose, &skin);
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
    use rayon::prelude::*;
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
    needs.value("settings", "timeline", &(t.first, t.last, t.speed, to_and_fro));
    let Similarity { scale, rigid } = placed.transform;
    needs.value("settings", "placed", &(scale, rigid.to_rows()));
    needs.value("values", "take", &(performance.fps(), performance.gravity().to_array()));
    for strand in plan.groom {
        needs.value("groom", "strand", &strand.iter().map(|p| p.to_array()).collect::<Vec<_>>());
    }
    for frame in t.first..=t.last {
        needs.value("stage flow", "field", &performance.record_of(frame).map(|record| record.outputs));
    }
    for item in ["pose/pose/take", "scalp/scalp/take", "fit/fit"] {
        needs.value("stages", item, &performance.store().record(item).map(|record| record.outputs));
    }
    Ok(needs.finish().0)
}

/// Raised when the same input would give another animation.
const VERSION: u32 = 1;

/// An animation's arrays.
struct Folder<'a> {
    store: &'a Store,
    name: String,
    counts: Vec<u16>,
    width: usize,
}

impl<'a> Folder<'a> {
    fn new(store: &'a Store, name: &str, counts: &[usize]) -> Self {
        let counts: Vec<u16> = counts.iter().map(|&n| n.min(u16::MAX.into()) as u16).collect();
        let width = counts.iter().copied().max().unwrap_or(0).into();
        Self { store, name: name.to_owned(), counts, width }
    }

    fn array(&self, array: &str) -> String {
        format!("animate/{}/{array}", self.name)
    }

    fn item(&self, k: usize) -> String {
        format!("animate/{}/{k:06}", self.name)
    }

    /// How many first frames are finished and of these inputs, and the state after the last of them.
    fn resumed(&self, inputs: &BTreeMap<String, String>, frames: usize) -> Result<(usize, DrivenState), EngineError> {
        let same = |k: usize| self.store.record(&self.item(k)).is_some_and(|record| record.inputs == *inputs);
        let done = (0..frames).take_while(|k| same(*k)).count();
        let fits = self.store.shape(&self.array("points")).is_ok_and(|s| s[1..] == [self.counts.len(), self.width, 3]);
        if done == 0 || !fits {
            return Ok((0, DrivenState::default()));
        }
        // The array may have been made for fewer frames.
        self.shape(frames)?;
        let part = |array: &str| read_frame(self.store, &self.array(array), done - 1, &self.counts, self.width);
        Ok((done, DrivenState { points: part("points")?, velocities: part("velocities")? }))
    }

    /// Makes the arrays anew.
    fn begin(&self, frames: usize) -> Result<(), EngineError> {
        self.store.forget_phase(&format!("animate/{}", self.name))?;
        self.store.remove(&format!("animate/{}", self.name))?;
        self.shape(frames)?;
        let mut writer = Writer::new(self.store);
        writer.whole(&self.array("counts"), &[self.counts.len()], &self.counts)
    }

    fn shape(&self, frames: usize) -> Result<(), EngineError> {
        let longest = self.store.shape(&self.array("points")).map_or(0, |shape| shape[0]).max(frames);
        let (shape, chunk) = ([longest, self.counts.len(), self.width, 3], [1, BLOCK_STRANDS, self.width, 3]);
        for array in ["points", "velocities"] {
            self.store.ensure(&self.array(array), &shape, &chunk, serde_json::Value::Null)?;
        }
        self.store.ensure(&self.array("world_from_head"), &[longest, 4, 4], &[1, 4, 4], serde_json::Value::Null)
    }

    /// Writes a frame and declares it finished.
    fn write(
        &self,
        k: usize,
        (state, pose): (&DrivenState, &RigidTransform),
        inputs: &BTreeMap<String, String>,
        check: &FrameCheck,
    ) -> Result<(), EngineError> {
        self.store.forget(&self.item(k))?;
        let mut writer = Writer::new(self.store);
        writer.chunk(&self.array("world_from_head"), &[k, 0, 0], pose.to_rows().as_flattened())?;
        for (array, values) in [("points", &state.points), ("velocities", &state.velocities)] {
            let mut at = 0;
            for (block, counts) in self.counts.chunks(BLOCK_STRANDS).enumerate() {
                let mut chunk = vec![f32::NAN; BLOCK_STRANDS * self.width * 3];
                for (strand, &count) in counts.iter().enumerate() {
                    let rows = chunk[strand * self.width * 3..].chunks_exact_mut(3);
                    rows.zip(&values[at..at + usize::from(count)])
                        .for_each(|(row, v)| row.copy_from_slice(&v.to_array()));
                    at += usize::from(count);
                }
                writer.chunk(&self.array(array), &[k, block, 0, 0], &chunk)?;
            }
        }
        let mut outputs = writer.finish();
        // What the frame was found to be goes with it, so that a resumed run knows it too.
        outputs.insert("check".into(), serde_json::to_string(check).unwrap_or_default());
        self.store.write_record(&self.item(k), &Record { inputs: inputs.clone(), outputs, findings: Vec::new() })
    }

    fn check_of(&self, k: usize) -> Option<FrameCheck> {
        serde_json::from_str(self.store.record(&self.item(k))?.outputs.get("check")?).ok()
    }
}

/// One frame of an array of vectors, strand after strand without the padding.
fn read_frame(store: &Store, path: &str, k: usize, counts: &[u16], width: usize) -> Result<Vec<Vec3>, EngineError> {
    let values: Vec<f32> = store.read(path, &[k..k + 1, 0..counts.len(), 0..width, 0..3])?;
    let rows = counts.iter().enumerate().flat_map(|(n, &count)| n * width..n * width + usize::from(count));
    Ok(rows.map(|i| Vec3::from_slice(&values[3 * i..])).collect())
}

/// A finished animation, read frame by frame.
pub struct AnimationStrands<'a> {
    store: &'a Store,
    name: String,
    numbers: Vec<u32>,
    counts: Vec<u16>,
    width: usize,
}

/// Which animations a store holds, by name.
pub fn animations(store: &Store) -> Vec<String> {
    let entries = std::fs::read_dir(store.root().join("animate")).into_iter().flatten().flatten();
    let folders = entries.filter(|entry| entry.path().is_dir());
    let mut names: Vec<String> = folders.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

impl<'a> AnimationStrands<'a> {
    /// The finished frames of an animation.
    ///
    /// # Errors
    /// `Input` where there is no such animation; `Store`.
    pub fn open(store: &'a Store, name: &str) -> Result<Self, EngineError> {
        let done = (0..).take_while(|k| store.record(&format!("animate/{name}/{k:06}")).is_some()).count();
        if done == 0 {
            let names = animations(store).join(", ");
            let hint =
                if names.is_empty() { "make one: `strandflow animate`".into() } else { format!("there are: {names}") };
            return Err(EngineError::input(format!("animation {name}"), "is not there", hint));
        }
        let counts = store.read_all(&format!("animate/{name}/counts"))?;
        let width = store.shape(&format!("animate/{name}/points"))?[2];
        Ok(Self { store, name: name.to_owned(), numbers: (0..done as u32).collect(), counts, width })
    }
}

impl AnimationStrands<'_> {
    /// World from head in the `t`-th frame.
    ///
    /// # Errors
    /// `Store`.
    pub fn world_from_head(&self, t: usize) -> Result<RigidTransform, EngineError> {
        let rows: Vec<f64> =
            self.store.read(&format!("animate/{}/world_from_head", self.name), &[t..t + 1, 0..4, 0..4])?;
        Ok(crate::read::transform_from_slice(&rows))
    }
}

impl StrandFrames for AnimationStrands<'_> {
    fn frames(&self) -> &[u32] {
        &self.numbers
    }

    fn counts(&self) -> &[u16] {
        &self.counts
    }

    fn point_count(&self) -> usize {
        self.width
    }

    fn frame(&self, t: usize) -> Result<StrandSequence, IoError> {
        let path = format!("animate/{}/points", self.name);
        let read =
            |range: Range<usize>| self.store.read::<f32>(&path, &[range, 0..self.counts.len(), 0..self.width, 0..3]);
        let values = read(t..t + 1).map_err(|error| {
            let at = At { frame: Some(t), ..At::FILE };
            IoError::content(self.store.root(), at, error.to_string(), error.hint())
        })?;
        let mut sequence = StrandSequence::missing(vec![self.numbers[t]], self.counts.clone(), self.width);
        for (i, point) in values.chunks_exact(3).map(Vec3::from_slice).enumerate() {
            if point.is_finite() {
                sequence.points[i] = point;
                (sequence.provenance[i], sequence.confidence[i]) = (Provenance::Simulated, 1.0);
            }
        }
        Ok(sequence)
    }
}
