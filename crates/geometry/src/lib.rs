//! Projection and distortion, triangulation, rigid alignment, polylines and meshes.

pub mod align;
pub mod polyline;
pub mod project;
pub mod triangulate;
