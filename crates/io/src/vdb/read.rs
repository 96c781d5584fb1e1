//! Reads grids of vectors. Whatever a file claims, memory follows the bytes that are there.

use std::io::Read;

use flate2::read::ZlibDecoder;
use glam::{DMat4, Vec3};

use super::{
    VectorGrid,
    tree::{LEAF, LOWER, Level, UPPER, children},
    write::{ACTIVE_ONLY, MAGIC, TYPE, VERSION, ZIP},
};
use crate::bytes::Bytes;

const CUT: &str = "ends too early, or is damaged";
const BLOSC: u32 = 4;
/// Bytes of a value.
const VALUE: usize = 12;

pub(super) fn file(data: &[u8]) -> Result<Vec<VectorGrid>, String> {
    let mut bytes = Bytes::new(data);
    if bytes.u64() != Some(MAGIC) {
        return Err("is not an OpenVDB file".into());
    }
    let version = bytes.u32().ok_or(CUT)?;
    if version != VERSION {
        return Err(format!("is of file version {version}, not {VERSION}"));
    }
    // The library's version, that positions are stored, the file's identity.
    bytes.skip(8 + 1 + 36).ok_or(CUT)?;
    metadata(&mut bytes)?;
    let mut grids = Vec::new();
    for _ in 0..bytes.u32().ok_or(CUT)? {
        let name = text(&mut bytes)?;
        let kind = text(&mut bytes)?;
        text(&mut bytes)?;
        let [start, _, end] = [bytes.u64(), bytes.u64(), bytes.u64()].map(|x| x.and_then(|x| usize::try_from(x).ok()));
        let (start, end) = (start.ok_or(CUT)?, end.ok_or(CUT)?);
        if kind == TYPE {
            let own = data.get(start..end).ok_or(CUT)?;
            // A file may hold grids of one name: then a number follows it behind a separator.
            let name = name.split('\u{1e}').next().unwrap_or_default().to_owned();
            grids.push(grid(own, name.clone()).map_err(|fact| format!("grid `{name}` {fact}"))?);
        }
        bytes = Bytes::new(data.get(end..).ok_or(CUT)?);
    }
    if grids.is_empty() { Err("holds no grid of vectors (Vec3s, tree 5-4-3)".into()) } else { Ok(grids) }
}

fn text(bytes: &mut Bytes) -> Result<String, String> {
    let length = bytes.u32().ok_or(CUT)? as usize;
    Ok(String::from_utf8_lossy(bytes.take(length).ok_or(CUT)?).into_owned())
}

/// Passes over metadata: name, type, value each.
fn metadata(bytes: &mut Bytes) -> Result<(), String> {
    for _ in 0..bytes.u32().ok_or(CUT)? {
        text(bytes)?;
        text(bytes)?;
        let length = bytes.u32().ok_or(CUT)? as usize;
        bytes.skip(length).ok_or(CUT)?;
    }
    Ok(())
}

fn grid(data: &[u8], name: String) -> Result<VectorGrid, String> {
    let mut bytes = Bytes::new(data);
    let compression = bytes.u32().ok_or(CUT)?;
    if compression & BLOSC != 0 {
        return Err("is compressed with Blosc".into());
    }
    metadata(&mut bytes)?;
    let space_from_index = transform(&mut bytes)?;
    let mut tree = Tree { bytes, compression, leaves: Vec::new() };
    tree.topology()?;
    let voxels = tree.values()?;
    Ok(VectorGrid { name, space_from_index, voxels })
}

/// Affine maps, and the scales (with translation or without) that OpenVDB simplifies them to.
fn transform(bytes: &mut Bytes) -> Result<DMat4, String> {
    let kind = text(bytes)?;
    let mut numbers = |count: usize| (0..count).map(|_| bytes.f64()).collect::<Option<Vec<f64>>>().ok_or(CUT);
    let scaled = |scale: &[f64], translation: &[f64]| {
        let place = |x: &[f64]| glam::DVec3::new(x[0], x[1], x[2]);
        DMat4::from_translation(place(translation)) * DMat4::from_scale(place(scale))
    };
    match kind.as_str() {
        "AffineMap" => Ok(DMat4::from_cols_slice(&numbers(16)?)),
        // Scale, voxel size and three things that follow from it.
        "ScaleMap" | "UniformScaleMap" => Ok(scaled(&numbers(15)?, &[0.0; 3])),
        "ScaleTranslateMap" | "UniformScaleTranslateMap" => {
            let all = numbers(18)?;
            Ok(scaled(&all[3..], &all))
        }
        other => Err(format!("has a transform of kind `{other}`")),
    }
}

struct Tree<'a> {
    bytes: Bytes<'a>,
    compression: u32,
    /// First voxel of each leaf, in the order of the file.
    leaves: Vec<[i32; 3]>,
}

impl Tree<'_> {
    fn topology(&mut self) -> Result<(), String> {
        // One buffer; the background; tiles and nodes of the root.
        self.bytes.skip(4 + VALUE).ok_or(CUT)?;
        let (tiles, nodes) = (self.bytes.u32().ok_or(CUT)?, self.bytes.u32().ok_or(CUT)?);
        for _ in 0..tiles {
            let tile = self.bytes.take(12 + VALUE + 1).ok_or(CUT)?;
            no_tile(tile.last() == Some(&0))?;
        }
        for _ in 0..nodes {
            let first = [self.bytes.i32(), self.bytes.i32(), self.bytes.i32()];
            let [Some(x), Some(y), Some(z)] = first else { return Err(CUT.into()) };
            for lower in self.inner_node(UPPER, [x, y, z])? {
                for leaf in self.inner_node(LOWER, lower)? {
                    self.bytes.skip(LEAF.size() / 8).ok_or(CUT)?;
                    self.leaves.push(leaf);
                }
            }
        }
        Ok(())
    }

    /// The first voxels of a node's children.
    fn inner_node(&mut self, level: Level, first: [i32; 3]) -> Result<Vec<[i32; 3]>, String> {
        let child_mask = self.bytes.take(level.size() / 8).ok_or(CUT)?;
        let value_mask = self.bytes.take(level.size() / 8).ok_or(CUT)?;
        no_tile(value_mask.iter().all(|byte| *byte == 0))?;
        self.node_values(level, 0)?;
        let place = |child| {
            let at = level.voxel_of(child);
            [0, 1, 2].map(|axis| first[axis].wrapping_add(at[axis]))
        };
        Ok(children(child_mask).into_iter().map(place).collect())
    }

    fn values(&mut self) -> Result<Vec<([i32; 3], Vec3)>, String> {
        let mut voxels = Vec::new();
        for leaf in std::mem::take(&mut self.leaves) {
            let active = children(self.bytes.take(LEAF.size() / 8).ok_or(CUT)?);
            let values = self.node_values(LEAF, active.len())?;
            let value = |at: usize| {
                let number = |axis: usize| {
                    values.get(at * VALUE + axis * 4..)?.first_chunk::<4>().map(|x| f32::from_le_bytes(*x))
                };
                Some(Vec3::new(number(0)?, number(1)?, number(2)?))
            };
            let all = values.len() > active.len() * VALUE;
            for (rank, &child) in active.iter().enumerate() {
                let value = value(if all { child } else { rank }).ok_or(CUT)?;
                let at = LEAF.voxel_of(child);
                voxels.push(([0, 1, 2].map(|axis| leaf[axis].wrapping_add(at[axis])), value));
            }
        }
        Ok(voxels)
    }

    /// The stored values of a node with so many active ones: those, or all.
    fn node_values(&mut self, level: Level, active: usize) -> Result<Vec<u8>, String> {
        let how = *self.bytes.take(1).and_then(|byte| byte.first()).ok_or(CUT)?;
        // What inactive voxels are: nothing to read, one value, a mask of two, one and a mask, two and a mask, all values.
        let inactive = match how {
            0 | 1 | 6 => 0,
            2 => VALUE,
            3 => level.size() / 8,
            4 => VALUE + level.size() / 8,
            5 => 2 * VALUE + level.size() / 8,
            _ => return Err(CUT.into()),
        };
        self.bytes.skip(inactive).ok_or(CUT)?;
        let only_active = self.compression & ACTIVE_ONLY != 0 && how != 6;
        let size = VALUE * if only_active { active } else { level.size() };
        if self.compression & ZIP == 0 {
            return Ok(self.bytes.take(size).ok_or(CUT)?.to_vec());
        }
        let length = self.bytes.u64().ok_or(CUT)? as i64;
        let stored = self.bytes.take(usize::try_from(length.unsigned_abs()).map_err(|_| CUT)?).ok_or(CUT)?;
        if length <= 0 {
            return if stored.len() == size { Ok(stored.to_vec()) } else { Err(CUT.into()) };
        }
        let mut values = Vec::new();
        ZlibDecoder::new(stored).take(size as u64 + 1).read_to_end(&mut values).map_err(|_| CUT)?;
        if values.len() == size { Ok(values) } else { Err(CUT.into()) }
    }
}

fn no_tile(none: bool) -> Result<(), String> {
    if none { Ok(()) } else { Err("has active tiles, which are not read".into()) }
}
