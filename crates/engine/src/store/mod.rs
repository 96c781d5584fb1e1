//! The results store: Zarr v3 arrays, and the record of every finished work item.
//!
//! An item is done when its record exists. The record is removed before the item's arrays are touched and written, by
//! rename, after them; so whatever a killed run leaves behind is either whole or written again.

pub mod arrays;
pub mod catalogue;
pub mod records;

pub use arrays::{Element, Store, Writer};
pub use catalogue::{ARRAYS, ArraySpec};
pub use records::{Failure, Record};
