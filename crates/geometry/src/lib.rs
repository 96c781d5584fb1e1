//! Projection and distortion, triangulation, rigid alignment, polylines and meshes.

pub mod align;
pub mod blue_noise;
pub mod epipolar;
pub mod icp;
pub mod lens;
pub mod mesh_distance;
pub mod order;
pub mod polyline;
pub mod primitives;
pub mod project;
pub mod signed_distance;
pub mod sketch;
pub mod surface_nets;
pub mod triangulate;
