//! Writes one grid as a file: header, metadata, transform, the tree's masks, then its values.

use std::io::Write;

use flate2::{Compression, write::ZlibEncoder};
use glam::Vec3;

use super::{
    VectorGrid,
    tree::{LEAF, LOWER, UPPER, children, mask, sorted},
};

pub(super) const MAGIC: u64 = 0x5644_4220;
pub(super) const VERSION: u32 = 224;
pub(super) const TYPE: &str = "Tree_vec3s_5_4_3";
pub(super) const ZIP: u32 = 1;
/// Only active values are stored; the others are the background.
pub(super) const ACTIVE_ONLY: u32 = 2;
/// A node whose inactive values all are the background.
const ALL_BACKGROUND: u8 = 0;
/// Characters of a UUID.
const UUID: usize = 36;
/// The library whose files these are like.
const LIBRARY: [u32; 2] = [10, 0];

pub(super) fn file(grid: &VectorGrid, unit: &str, zip: bool) -> Vec<u8> {
    let tree = sorted(&grid.voxels);
    let mut out = Out { bytes: Vec::new(), zip };
    out.bytes.extend(MAGIC.to_le_bytes());
    [VERSION, LIBRARY[0], LIBRARY[1]].into_iter().for_each(|x| out.u32(x));
    // The grids' positions are stored.
    out.bytes.push(1);
    let name = out.bytes.len();
    out.bytes.extend([0; UUID]);
    out.u32(1);
    out.metadata("creator", "string", concat!("strandflow ", env!("CARGO_PKG_VERSION")).as_bytes());

    // The one grid: where its parts lie is filled in at the end.
    out.u32(1);
    out.text(&grid.name);
    out.text(TYPE);
    out.text("");
    let positions = out.bytes.len();
    out.bytes.extend([0; 24]);
    let start = out.bytes.len();
    out.u32(ACTIVE_ONLY | if zip { ZIP } else { 0 });
    out.u32(5);
    out.metadata("class", "string", b"unknown");
    out.metadata("is_saved_as_half_float", "bool", &[0]);
    out.metadata("name", "string", grid.name.as_bytes());
    out.metadata("unit", "string", unit.as_bytes());
    // Velocities turn with the space and do not move with it.
    out.metadata("vector_type", "string", b"contravariant relative");
    // Rows times matrices: the matrix's rows are our columns.
    out.text("AffineMap");
    grid.space_from_index.to_cols_array().into_iter().for_each(|x| out.bytes.extend(x.to_le_bytes()));

    // Masks of all nodes, parents first.
    out.u32(1);
    out.bytes.extend([0; 12]);
    out.u32(0);
    out.u32(tree.len() as u32);
    for (first, upper) in &tree {
        first.iter().for_each(|x| out.bytes.extend(x.to_le_bytes()));
        out.node(&mask(UPPER, upper.keys()));
        for lower in upper.values() {
            out.node(&mask(LOWER, lower.keys()));
            lower.values().for_each(|leaf| out.bytes.extend(mask(LEAF, leaf.keys())));
        }
    }
    // Values of all leaves, in the same order.
    let blocks = out.bytes.len();
    for leaf in tree.values().flat_map(|upper| upper.values()).flat_map(|lower| lower.values()) {
        out.bytes.extend(mask(LEAF, leaf.keys()));
        out.values(leaf.values());
    }
    let ends = [start, blocks, out.bytes.len()];
    for (at, end) in ends.into_iter().enumerate() {
        out.bytes[positions + 8 * at..positions + 8 * at + 8].copy_from_slice(&(end as u64).to_le_bytes());
    }
    let uuid = identity(&out.bytes);
    out.bytes[name..name + UUID].copy_from_slice(uuid.as_bytes());
    out.bytes
}

struct Out {
    bytes: Vec<u8>,
    zip: bool,
}

impl Out {
    fn u32(&mut self, number: u32) {
        self.bytes.extend(number.to_le_bytes());
    }

    fn text(&mut self, text: &str) {
        self.u32(text.len() as u32);
        self.bytes.extend(text.bytes());
    }

    fn metadata(&mut self, name: &str, kind: &str, value: &[u8]) {
        self.text(name);
        self.text(kind);
        self.u32(value.len() as u32);
        self.bytes.extend(value);
    }

    /// An inner node: which children it has, and that it has no tiles.
    fn node(&mut self, child_mask: &[u8]) {
        debug_assert!(!children(child_mask).is_empty());
        self.bytes.extend(child_mask);
        self.bytes.extend(vec![0; child_mask.len()]);
        self.values([].iter());
    }

    /// Active values; zipped ones behind their length, which is negative where they did not shrink.
    fn values<'a>(&mut self, values: impl Iterator<Item = &'a Vec3>) {
        self.bytes.push(ALL_BACKGROUND);
        let raw: Vec<u8> = values.flat_map(|v| v.to_array()).flat_map(f32::to_le_bytes).collect();
        if !self.zip {
            return self.bytes.extend(raw);
        }
        let packed = zipped(&raw).filter(|packed| packed.len() < raw.len());
        let length = packed.as_ref().map_or(-(raw.len() as i64), |packed| packed.len() as i64);
        self.bytes.extend(length.to_le_bytes());
        self.bytes.extend(packed.unwrap_or(raw));
    }
}

/// `None` where there is nothing to zip.
fn zipped(raw: &[u8]) -> Option<Vec<u8>> {
    if raw.is_empty() {
        return None;
    }
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(raw).ok()?;
    encoder.finish().ok()
}

/// A UUID that says what the file holds: the same grid has the same.
fn identity(bytes: &[u8]) -> String {
    let hex = blake3::hash(bytes).to_hex();
    [&hex[..8], &hex[8..12], &hex[12..16], &hex[16..20], &hex[20..32]].join("-")
}
