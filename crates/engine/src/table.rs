//! The stage table: `run`, `status`, resume and progress all derive from it.

use std::ops::Range;

use strandflow_core::Report;

use crate::{
    EngineError, Needs, Plan, Settings, Take,
    item::{Item, Kind},
    needs::Records,
    rooms,
    store::Writer,
};

/// A take and what is to be done with it.
#[derive(Clone, Copy)]
pub struct Job<'a> {
    /// The take.
    pub take: &'a Take,
    /// Mode, settings, frames.
    pub plan: &'a Plan,
    /// Whether this is one of many tasks: what others may have written is not removed.
    pub is_task: bool,
}

impl<'a> Job<'a> {
    /// All that is to be done with a take.
    pub fn new(take: &'a Take, plan: &'a Plan) -> Self {
        Self { take, plan, is_task: false }
    }
}

/// Which frames the per-frame items of a phase cover.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Span {
    /// The take's first frame up to the last asked for.
    Lead,
    /// The frames asked for.
    Frames,
}

/// One row of the table.
pub struct Stage {
    /// Name in the manifest, on the command line and in the store.
    pub name: &'static str,
    /// What it does, in words.
    pub summary: &'static str,
    /// Raised when the same input would give another result; results of other versions are stale.
    pub version: u32,
    /// Whether `paper` and `robust` differ.
    pub has_modes: bool,
    /// Its settings.
    pub settings: fn(&Settings) -> serde_json::Value,
    /// Its phases, in order.
    pub phases: &'static [Phase],
}

/// A part of a stage with one kind of work item.
pub struct Phase {
    /// `stage/phase`; where its records are.
    pub name: &'static str,
    /// Its work items.
    pub kind: Kind,
    /// Which frames they cover.
    pub span: Span,
    /// Phases of which an item reads the item of its own frame, view or block, and no other.
    pub same: &'static [&'static str],
    /// Phases of which an item reads others.
    pub others: &'static [&'static str],
    /// Makes the arrays; called once the stages before have run.
    pub prepare: fn(&Job) -> Result<(), EngineError>,
    /// States what an item rests on.
    pub needs: fn(&Job, Item, &mut Needs) -> Result<(), EngineError>,
    /// Loads, computes, stores.
    pub run: fn(&Job, Item, &mut Writer, &mut Report) -> Result<(), EngineError>,
}

macro_rules! settings_of {
    ($stage:ident) => {
        |settings| serde_json::to_value(&settings.$stage).unwrap_or_default()
    };
}

macro_rules! phase {
    ($name:literal, $kind:ident, $span:ident, $($room:ident)::+, same $same:expr, others $others:expr) => {{
        use $($room)::+ as room;
        Phase {
            name: $name,
            kind: Kind::$kind,
            span: Span::$span,
            same: &$same,
            others: &$others,
            prepare: room::prepare,
            needs: room::needs,
            run: room::run,
        }
    }};
}

/// The thirteen stages, in the order of the pipeline.
pub static STAGES: [Stage; 13] = [
    Stage {
        name: "masks",
        summary: "subject and hair masks",
        version: 7,
        has_modes: true,
        settings: settings_of!(masks),
        phases: &[phase!("masks/masks", ViewFrameChained, Lead, rooms::masks, same [], others [])],
    },
    Stage {
        name: "hull",
        summary: "the take's grid and visual hulls",
        version: 2,
        has_modes: false,
        settings: settings_of!(hull),
        phases: &[
            phase!("hull/grid", Take, Lead, rooms::hull::grid, same [], others ["masks/masks"]),
            phase!("hull/hull", Frame, Lead, rooms::hull, same [], others ["masks/masks", "hull/grid"]),
        ],
    },
    Stage {
        name: "pose",
        summary: "marker tracks and head poses",
        version: 4,
        has_modes: true,
        settings: settings_of!(pose),
        phases: &[phase!("pose/pose", Take, Lead, rooms::pose, same [], others [])],
    },
    Stage {
        name: "scalp",
        summary: "the scalp and its roots",
        version: 3,
        has_modes: false,
        settings: settings_of!(scalp),
        phases: &[
            phase!("scalp/scalp", Take, Lead, rooms::scalp, same [], others ["masks/masks", "hull/grid", "hull/hull", "pose/pose"]),
        ],
    },
    Stage {
        name: "orient",
        summary: "orientation of every hair pixel",
        version: 8,
        has_modes: true,
        settings: settings_of!(orient),
        phases: &[
            phase!("orient/frames", ViewFrame, Frames, rooms::orient::frames, same [], others ["masks/masks"]),
            phase!("orient/orient", ViewFrame, Frames, rooms::orient, same [], others ["orient/frames"]),
        ],
    },
    Stage {
        name: "lift",
        summary: "3D lines that views agree on",
        version: 2,
        has_modes: true,
        settings: settings_of!(lift),
        phases: &[
            phase!("lift/lift", Frame, Frames, rooms::lift, same ["hull/hull"], others ["masks/masks", "hull/grid", "orient/orient"]),
        ],
    },
    Stage {
        name: "field",
        summary: "the dense line field",
        version: 6,
        has_modes: true,
        settings: settings_of!(field),
        phases: &[
            phase!("field/field", Frame, Frames, rooms::field, same ["hull/hull", "lift/lift"], others ["masks/masks", "hull/grid", "pose/pose", "scalp/scalp"]),
            phase!("field/motion", Frame, Frames, rooms::field::motion, same ["field/field"], others ["masks/masks", "hull/grid", "pose/pose", "scalp/scalp", "orient/orient"]),
        ],
    },
    Stage {
        name: "grow",
        summary: "strands from the roots",
        version: 6,
        has_modes: true,
        settings: settings_of!(grow),
        phases: &[
            phase!("grow/grow", FrameChained, Frames, rooms::grow, same ["field/field", "field/motion"], others ["hull/grid", "pose/pose", "scalp/scalp"]),
        ],
    },
    Stage {
        name: "prune",
        summary: "outliers removed",
        version: 3,
        has_modes: true,
        settings: settings_of!(prune),
        phases: &[
            phase!("prune/prune", Frame, Frames, rooms::prune, same ["hull/hull", "grow/grow"], others ["hull/grid", "orient/orient"]),
        ],
    },
    Stage {
        name: "smooth",
        summary: "strands resampled, smoothed and trimmed",
        version: 4,
        has_modes: true,
        settings: settings_of!(smooth),
        phases: &[
            phase!("smooth/frames", Frame, Frames, rooms::smooth::frames, same ["prune/prune"], others []),
            phase!("smooth/topology", Take, Frames, rooms::smooth::topology, same [], others ["scalp/scalp", "smooth/frames"]),
            phase!("smooth/trim", Block, Frames, rooms::smooth::trim, same [], others ["smooth/frames", "smooth/topology"]),
        ],
    },
    Stage {
        name: "fit",
        summary: "strands explained by simulation",
        version: 12,
        has_modes: true,
        settings: settings_of!(fit),
        phases: &[phase!("fit/fit", Block, Frames, rooms::fit, same["smooth/trim"], others["pose/pose"])],
    },
    Stage {
        name: "flow",
        summary: "the velocity field",
        version: 1,
        has_modes: true,
        settings: settings_of!(flow),
        phases: &[phase!("flow/flow", Frame, Frames, rooms::flow, same ["hull/hull"], others ["hull/grid", "fit/fit"])],
    },
    Stage {
        name: "blend",
        summary: "strands warped, interpolated and completed",
        version: 2,
        has_modes: true,
        settings: settings_of!(blend),
        phases: &[
            phase!("blend/blend", Frame, Frames, rooms::blend, same ["hull/hull"], others ["hull/grid", "pose/pose", "scalp/scalp", "fit/fit", "flow/flow"]),
        ],
    },
];

/// The index of a stage by name.
///
/// # Errors
/// `Input` for a name that the table does not have.
pub fn stage_index(name: &str) -> Result<usize, EngineError> {
    STAGES.iter().position(|stage| stage.name == name).ok_or_else(|| {
        let names: Vec<&str> = STAGES.iter().map(|stage| stage.name).collect();
        EngineError::input(
            format!("stage `{name}`"),
            "there is no such stage",
            format!("choose one of {}", names.join(", ")),
        )
    })
}

/// All phases with their stages, in order.
pub fn phases() -> impl Iterator<Item = (&'static Stage, &'static Phase)> {
    STAGES.iter().flat_map(|stage| stage.phases.iter().map(move |phase| (stage, phase)))
}

/// The phases of a stage, or the one phase of a name `stage/phase`, as indices into [`phases`].
///
/// # Errors
/// `Input` for a name that the table does not have.
pub fn phase_range(name: &str) -> Result<Range<usize>, EngineError> {
    let stage = stage_index(name.split('/').next().unwrap_or_default())?;
    let first: usize = STAGES[..stage].iter().map(|stage| stage.phases.len()).sum();
    let phases = STAGES[stage].phases;
    if !name.contains('/') {
        return Ok(first..first + phases.len());
    }
    let at = phases.iter().position(|phase| phase.name == name).ok_or_else(|| {
        let names: Vec<&str> = phases.iter().map(|phase| phase.name).collect();
        let hint = format!("choose one of {}", names.join(", "));
        EngineError::input(format!("phase `{name}`"), "there is no such phase", hint)
    })?;
    Ok(first + at..first + at + 1)
}

/// The item of a key, with its stage and phase.
///
/// # Errors
/// `Missing` where the plan has no such item.
pub fn item_of(key: &str, job: &Job) -> Result<(&'static Stage, &'static Phase, Item), EngineError> {
    let missing = || EngineError::Missing { item: key.to_owned() };
    let of_phase = |phase: &Phase| key.strip_prefix(phase.name).is_some_and(|rest| rest.starts_with('/'));
    let (stage, phase) = phases().find(|(_, phase)| of_phase(phase)).ok_or_else(missing)?;
    let items = phase.chains(job)?.into_iter().flatten();
    let item = { items }.find(|item| item.key(phase.name) == key).ok_or_else(missing)?;
    Ok((stage, phase, item))
}

impl Stage {
    /// What an item rests on: hashes by kind, and the keys of the items it reads.
    ///
    /// # Errors
    /// `Missing` where an item it reads is not finished; `Disk` where a file is gone.
    pub fn inputs(&self, phase: &Phase, job: &Job, item: Item) -> Result<Inputs, EngineError> {
        self.inputs_by(phase, job, item, None)
    }

    /// The same, by records that were read before where there are such.
    pub(crate) fn inputs_by(
        &self,
        phase: &Phase,
        job: &Job,
        item: Item,
        records: Option<&Records>,
    ) -> Result<Inputs, EngineError> {
        let mut needs = Needs::new(job.take.store(), job.take.identities()).by(records);
        needs.value("version", "stage", &self.version);
        needs.value("settings", self.name, &(self.settings)(&job.plan.settings));
        if self.has_modes {
            needs.value("mode", "mode", &job.plan.mode);
        }
        (phase.needs)(job, item, &mut needs)?;
        let (hashes, items) = needs.finish();
        Ok(Inputs { hashes, items })
    }
}

/// What an item rests on.
pub struct Inputs {
    /// Hashes by kind.
    pub hashes: std::collections::BTreeMap<String, String>,
    /// Keys of the items it reads.
    pub items: Vec<String>,
}

impl Phase {
    /// Whether part n reads part n of another phase and no other part of it: one task can do both, or go on where the other's
    /// ends.
    pub fn follows(&self, before: &Self) -> bool {
        let of_frame = |kind| matches!(kind, Kind::Frame | Kind::FrameChained);
        let alike = self.kind == before.kind || of_frame(self.kind) && of_frame(before.kind);
        alike && self.span == before.span && self.same.contains(&before.name) && !self.others.contains(&before.name)
    }

    /// All items, in chains: items of one chain run in order, chains run side by side.
    ///
    /// # Errors
    /// `Missing` where the number of strands is not known yet.
    pub fn chains(&self, job: &Job) -> Result<Vec<Vec<Item>>, EngineError> {
        let frames = match self.span {
            Span::Lead => job.plan.lead,
            Span::Frames => job.plan.frames,
        };
        let views = 0..job.take.rig().view_count();
        let frames = frames.start..frames.end;
        Ok(match self.kind {
            Kind::Take => vec![vec![Item::Take]],
            Kind::Frame => frames.map(|t| vec![Item::Frame(t)]).collect(),
            Kind::FrameChained => vec![frames.map(Item::Frame).collect()],
            Kind::ViewFrame => views.flat_map(|v| frames.clone().map(move |t| vec![Item::ViewFrame(v, t)])).collect(),
            Kind::ViewFrameChained => {
                let chain = |v| rooms::masks::in_order(job, v).into_iter().map(|t| Item::ViewFrame(v, t)).collect();
                views.map(chain).collect()
            }
            Kind::Block => (0..job.take.block_count()?).map(|b| vec![Item::Block(b)]).collect(),
        })
    }
}
