//! A take on many machines: the work items of each phase as an array of tasks of somebody else's scheduler.
//!
//! A task is our own command, `run --from PHASE --to PHASE --items A..B`. It may run anywhere that sees the take, again and
//! beside others: no two items write one chunk, and what is finished is left alone.
//!
//! - [`arrays`](mod@arrays): which tasks there are, how long, and what each waits for; from the stage table and what is done.
//! - [`durations`]: how long items take. [`script`]: what a task runs.
//! - [`slurm`]: submission, queue, cancellation. [`template`]: the same as text for other schedulers.
//! - [`ledger`]: what was submitted, kept within the take.

pub mod arrays;
pub mod durations;
pub mod ledger;
pub mod script;
pub mod slurm;
pub mod template;

pub use arrays::{After, Array, Sizes, arrays};
pub use durations::Durations;
pub use ledger::{Ledger, Submitted};
pub use script::Work;
