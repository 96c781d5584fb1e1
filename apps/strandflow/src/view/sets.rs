//! What has strands: stages, animations, truth.

use strandflow_core::FrameRange;
use strandflow_engine::{
    Item,
    animation::{animations, world_from_head},
    store::Store,
};
use strandflow_view::Refusal;

use super::source::{Source, broken};

/// Strands of the stages, in the order of the pipeline, with what the page calls them.
const STAGES: [(&str, &str); 5] = [
    ("grow", "strands as grown"),
    ("prune", "strands without outliers"),
    ("smooth", "smoothed strands"),
    ("fit", "strands explained by simulation"),
    ("blend", "blended strands"),
];
/// What begins the name of an animation.
const ANIMATE: &str = "animate/";
/// The truth of a synthetic capture.
pub const TRUTH: &str = "truth";

/// Where the strands of a set are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A stage with one work item a frame.
    Frames,
    /// A stage with one work item a block of strands.
    Blocks,
    /// An animation.
    Animation,
    /// True strands, in files of their own.
    Truth,
}

/// Strands over time.
#[derive(Clone, Debug)]
pub struct Set {
    /// What requests call it; also its folder in the store.
    pub id: String,
    /// Where it is.
    pub kind: Kind,
    /// Strands of every frame, absent ones included.
    pub strands: usize,
    /// Points of the longest.
    pub points: usize,
    /// First frame and one past the last that it may have.
    pub frames: FrameRange,
}

impl Set {
    /// The set of a name.
    ///
    /// # Errors
    /// There is none, or it has no strands yet.
    pub fn find(source: &Source, id: &str) -> Result<Self, Refusal> {
        let unknown = || {
            let hint = "`/api/take` lists the sets; `/` in a name is written %2F";
            Refusal::missing(format!("there is no set `{id}`"), hint)
        };
        if id == TRUTH {
            return source.truth().map(|truth| truth.set()).ok_or_else(unknown);
        }
        let kind = match id {
            "grow" | "prune" | "blend" => Kind::Frames,
            "smooth" | "fit" => Kind::Blocks,
            _ => match id.strip_prefix(ANIMATE) {
                Some(name) if animations(&source.store()?).iter().any(|known| known == name) => Kind::Animation,
                _ => return Err(unknown()),
            },
        };
        let store = source.store()?;
        let shape = store.shape(&format!("{id}/points"));
        let shape = shape.map_err(|_| Refusal::missing(format!("stage {id} has no strands yet"), source.run_hint()))?;
        let [end, strands, points, _] = shape[..] else {
            return Err(Refusal::broken(format!("`{id}/points` has {} dimensions", shape.len()), source.run_hint()));
        };
        let frames = match kind {
            Kind::Animation => FrameRange { start: 0, end },
            _ => source.plan().map_or(FrameRange { start: 0, end }, |plan| plan.frames),
        };
        Ok(Self { id: id.to_owned(), kind, strands, points, frames })
    }

    /// All sets that have strands, in the order of the pipeline.
    pub fn all(source: &Source) -> Vec<Self> {
        let stages = STAGES.iter().map(|(stage, _)| (*stage).to_owned());
        let animations = source.store().map(|store| animations(&store)).unwrap_or_default();
        let animations = animations.into_iter().map(|name| format!("{ANIMATE}{name}"));
        let ids = stages.chain(animations).chain([TRUTH.to_owned()]);
        ids.filter_map(|id| Self::find(source, &id).ok()).collect()
    }

    /// What a person calls it.
    pub fn title(&self) -> String {
        let known = STAGES.iter().find(|(stage, _)| *stage == self.id).map(|(_, title)| (*title).to_owned());
        match self.kind {
            Kind::Truth => "true strands".into(),
            Kind::Animation => format!("animation {}", self.id.trim_start_matches(ANIMATE)),
            _ => known.unwrap_or_else(|| self.id.clone()),
        }
    }

    /// Whether a frame is there. A stage made block by block has a frame as soon as it has a block: the others are missing.
    pub fn has(&self, source: &Source, frame: usize) -> bool {
        if !self.frames.contains(frame) {
            return false;
        }
        let Ok(store) = source.store() else { return self.kind == Kind::Truth };
        let id = &self.id;
        match self.kind {
            Kind::Truth => true,
            Kind::Frames => store.record(&Item::Frame(frame).key(&format!("{id}/{id}"))).is_some(),
            Kind::Animation => store.record(&format!("{id}/{frame:06}")).is_some(),
            Kind::Blocks => self.has_a_block(&store),
        }
    }

    /// The frames that are there.
    pub fn done(&self, source: &Source) -> Vec<usize> {
        let all = self.frames.start..self.frames.end;
        match self.kind {
            Kind::Truth => all.collect(),
            Kind::Blocks if self.has(source, self.frames.start) => all.collect(),
            Kind::Blocks => Vec::new(),
            Kind::Frames | Kind::Animation => all.filter(|frame| self.has(source, *frame)).collect(),
        }
    }

    /// Asks for a frame.
    ///
    /// # Errors
    /// It is not there.
    pub fn must_have(&self, source: &Source, frame: usize) -> Result<(), Refusal> {
        if self.has(source, frame) {
            return Ok(());
        }
        let hint = if self.frames.contains(frame) {
            source.run_hint()
        } else {
            format!("ask for frames within {}", self.frames)
        };
        Err(Refusal::missing(format!("set {} has no frame {frame}", self.id), hint))
    }

    fn has_a_block(&self, store: &Store) -> bool {
        let phase = if self.id == "smooth" { "smooth/trim" } else { "fit/fit" };
        store.items_of(phase).iter().any(|key| store.record(key).is_some())
    }

    /// Whether its strands are numbered like those that were fitted.
    pub fn is_fitted(&self) -> bool {
        self.id == "fit" || self.id == "blend"
    }

    /// Head from world in a frame, where it is known.
    pub fn head_from_world(&self, source: &Source, frame: usize) -> Option<strandflow_core::RigidTransform> {
        let store = source.store().ok()?;
        let pose = match self.kind {
            Kind::Animation => world_from_head(&store, self.id.strip_prefix(ANIMATE)?, frame).ok()?,
            _ => store.read_pose(frame.checked_sub(source.begins())?).ok()?,
        };
        (pose.rotation.is_finite() && pose.translation.is_finite()).then(|| pose.inverse())
    }
}

/// For errors of the store within a set.
pub fn of_set(set: &Set) -> impl Fn(strandflow_engine::EngineError) -> Refusal + '_ {
    move |error| {
        let refusal = broken(error);
        Refusal { error: format!("set {}: {}", set.id, refusal.error), ..refusal }
    }
}
