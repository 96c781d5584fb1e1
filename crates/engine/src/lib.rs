//! The take on disk, the stage table, staleness, resume and executors.
//!
//! - [`manifest`] and [`settings`]: what the user states; [`plan`]: what a run works on, resolved.
//! - [`take`] and [`read`]: a take opened, and its results as types of the vocabulary.
//! - [`table`]: the thirteen stages; [`rooms`]: how each loads, computes and stores.
//! - [`store`]: Zarr arrays and the records of finished items; [`needs`]: what a result rests on.
//! - [`performance`] and [`animation`]: the captured motion by itself, and other grooms driven by it.
//! - [`farm`]: a take on many machines.
//! - [`run`](mod@run), [`status`](mod@status), [`events`]: the executor, what it finds, what it tells.

pub mod animation;
pub mod confined;
pub mod disk;
pub mod error;
pub mod events;
pub mod farm;
mod finding_kinds;
pub mod footage;
pub mod item;
pub mod manifest;
pub mod memory;
pub mod needs;
mod node;
pub mod performance;
pub mod plan;
pub mod read;
pub mod rooms;
pub mod run;
pub mod scaffold;
pub mod settings;
pub mod sources;
pub mod stage_strands;
mod standing;
pub mod status;
pub mod store;
pub mod table;
pub mod take;
pub mod views;

pub use error::EngineError;
pub use events::{Event, Outcome};
pub use finding_kinds::FindingKinds;
pub use item::{Item, ItemRange, Kind};
pub use manifest::Manifest;
pub use needs::Needs;
pub use performance::Performance;
pub use plan::Plan;
pub use run::{RunOptions, Summary, run};
pub use settings::Settings;
pub use status::status;
pub use table::{Job, STAGES, phase_range, stage_index};
pub use take::Take;
pub use views::Views;
