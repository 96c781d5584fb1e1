//! Filters, orientation maps, robust optical flow and mattes.

pub mod blob;
pub mod boost;
pub mod colour;
pub mod filter;
pub mod flow;
pub mod gabor;
pub mod matte;
pub mod morph;
pub mod pool;
pub mod region;
pub mod sample;
