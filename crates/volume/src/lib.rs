//! Hull carving, line and velocity fields, diffusion and sampling.

pub mod velocity;
pub mod tensor;
pub mod visibility;
pub mod carve;
pub mod silhouette;
pub mod diffuse;
