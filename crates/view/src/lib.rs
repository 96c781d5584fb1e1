//! The viewer's server: it knows HTTP, the token, the encodings and the page, and no take.
//!
//! - [`answers`]: what has to be answered, by whoever knows a take; [`refusal`]: how it may fail.
//! - [`describe`]: the JSON of the protocol; [`encode`]: its binary bodies; [`pictures`]: its images.
//! - [`selection`]: which strands and how many points a request asks for.
//! - [`token`] and [`guard`]: who may ask; [`server`]: the loopback server; [`page`]: the page within the program.
//!
//! `docs/view.md` is the protocol.

pub mod answers;
pub mod describe;
pub mod encode;
pub mod guard;
pub mod page;
pub mod pictures;
pub mod refusal;
mod routes;
pub mod selection;
pub mod server;
pub mod token;

pub use answers::{Answers, PerStrand, Picture};
pub use refusal::Refusal;
pub use selection::Selection;
pub use server::{Server, Stop};
pub use token::Token;
