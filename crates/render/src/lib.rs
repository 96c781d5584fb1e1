//! Pictures of strands.
//!
//! [`render`] draws [`Hair`] and a [`Head`] as a camera sees them and returns linear light with coverage; a [`Backdrop`]
//! goes behind it and [`Picture::over`] makes 8-bit sRGB of both. The same input gives the same bytes at any number of
//! threads. What is drawn, and what is approximate, is in `docs/render.md`.
//!
//! ```
//! use glam::{DVec3, Vec3};
//! use strandflow_render::{Backdrop, Hair, LightRig, Settings, Subject, look_at, render};
//!
//! let mut hair = Hair::default();
//! for x in 0..100 {
//!     let strand: Vec<Vec3> = (0..20).map(|k| Vec3::new(x as f32, 0.0, -5.0 * k as f32)).collect();
//!     hair.push(x, &strand, &[]);
//! }
//! let camera = look_at(DVec3::new(50.0, -600.0, -50.0), DVec3::new(50.0, 0.0, -50.0), DVec3::Z, 0.5, [64, 48]);
//! let lights = LightRig::studio(&camera, DVec3::Z);
//! let picture = render(&Subject { hair: &hair, head: None }, &camera, &lights, &Settings::default())?;
//! assert_eq!(picture.over(&Backdrop::Solid(Vec3::ONE)).width, 64);
//! # Ok::<(), strandflow_render::RenderError>(())
//! ```

pub mod account;
mod chance;
pub mod colour;
mod dome;
mod draw;
pub mod error;
mod fibre;
mod groom;
mod light;
pub mod picture;
mod raster;
mod render;
mod scattering;
mod shadow;
mod skin;
pub mod subject;
mod thread;
pub mod view;

pub use account::Phase;
pub use colour::HairColour;
pub use error::RenderError;
pub use fibre::Roughness;
pub use light::{Light, LightRig};
pub use picture::{Backdrop, Picture};
pub use render::{MAX_DENSITY, MAX_POINTS, MAX_SIDE, Settings, full_density, render, render_accounted};
pub use subject::{Hair, Head, Subject};
pub use view::{look_at, resized, turntable};
