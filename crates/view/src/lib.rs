//! The server of `strandflow view` and `strandflow annotate`: it knows HTTP, the token, the encodings and the pages, and no take.
//!
//! - [`answers`]: what has to be answered, by whoever knows a take; [`refusal`]: how it may fail.
//! - [`describe`]: the JSON of the protocol; [`encode`]: its binary bodies; [`pictures`]: its images.
//! - [`selection`]: which strands and how many points a request asks for.
//! - [`desk`]: the same for the page that labels and corrects; [`upload`]: what it may send.
//! - [`token`] and [`guard`]: who may ask; [`server`]: the loopback server; [`page`]: the pages within the program.
//!
//! `docs/view.md` and `docs/annotate.md` are the protocols.

pub mod answers;
pub mod describe;
pub mod desk;
mod desk_routes;
pub mod encode;
pub mod guard;
mod http;
pub mod page;
pub mod pictures;
pub mod refusal;
mod routes;
pub mod selection;
pub mod server;
pub mod token;
pub mod upload;

pub use answers::{Answers, PerStrand, Picture};
pub use desk::Desk;
pub use refusal::Refusal;
pub use selection::Selection;
pub use server::{Server, Stop};
pub use token::Token;
