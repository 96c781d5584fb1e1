//! The results store: Zarr v3 arrays, and the record of every finished work item.
//!
//! An item is done when its record exists. The record is removed before the item's arrays are touched and written, by
//! rename, after them; so whatever a killed run leaves behind is either whole or written again. Every file gets its name by a
//! rename, so that processes that make the same item side by side end with the same bytes. Chunks end in a checksum, which is
//! looked at whenever they are read; beside a record stand the hashes of all files of the item, for what is lost.

pub mod arrays;
pub mod catalogue;
mod files;
pub mod records;
mod sums;

pub use arrays::{Element, Store, Writer};
pub use catalogue::{ARRAYS, ArraySpec};
pub use records::{Failure, Record};
