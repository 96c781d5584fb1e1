//! Figures and pages for people: nothing here knows a take, a stage or a file.
//!
//! - [`axis`] and [`plot`]: plots as SVG that follow the page's colours.
//! - [`timeline`]: who did what when.
//! - [`picture`]: images as part of the page; [`hue`]: orientation maps in colour.
//! - [`html`] and [`page`]: one self-contained file, readable without a network and without scripts.

pub mod axis;
pub mod html;
pub mod hue;
pub mod page;
pub mod picture;
pub mod plot;
pub mod timeline;

pub use axis::Axis;
pub use html::Html;
pub use page::Page;
pub use picture::Picture;
pub use plot::{Mark, Plot, Tone};
pub use timeline::Timeline;
