//! Hull carving, line and velocity fields, diffusion and sampling.

pub mod carve;
pub mod diffuse;
pub mod parts;
pub mod silhouette;
pub mod tensor;
pub mod velocity;
pub mod visibility;
