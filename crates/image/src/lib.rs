//! Filters, orientation maps, robust optical flow and mattes.

pub mod colour;
pub mod filter;
pub mod gabor;
pub mod pool;
pub mod region;
pub mod sample;
