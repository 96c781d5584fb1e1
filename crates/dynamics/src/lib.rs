//! Strand springs, implicit Euler, exact adjoint, bound-constrained fit and warp.

pub mod eq2;
pub mod warp;

pub mod altitude;
pub mod band;
pub mod bench;
pub mod counted;
pub mod derivative;
pub mod driven;
pub mod exact;
pub mod fused;
pub mod kernels;
pub mod lanes;
#[cfg(target_arch = "x86_64")]
pub mod lanes_x86;
pub mod lbfgs;
pub mod linear;
pub mod lu;
pub mod params;
pub mod refine;
pub mod rest;
pub mod step;
pub mod system;
pub mod window;

pub use derivative::{DerivativeError, check_derivative};
pub use params::Params;
pub use rest::RestShape;
pub use step::{Forces, GRAVITY, Model, State, Workspace, step};
pub use system::Jacobian;
