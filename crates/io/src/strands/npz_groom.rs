//! One groom from a NumPy archive: the first frame of ours, or the strands (N, P, 3) of other programs.

use std::path::Path;

use glam::Vec3;

use super::npz::{read_arrays, read_npz};
use crate::{Groom, IoError, error::At};

/// Reads a groom; strands end before their first missing (not finite) point.
pub(crate) fn read(path: &Path) -> Result<Groom, IoError> {
    let mut arrays = read_arrays(path)?;
    let wrong = |fact: String| IoError::content(path, At::FILE, fact, "save `points` as float32 (N, P, 3)");
    let points = arrays.remove("points").ok_or_else(|| wrong("has no array `points`".into()))?;
    // Arrays without elements may claim any number of strands.
    if points.bytes.is_empty() {
        return Ok(Groom::default());
    }
    let &[strand_count, point_count, 3] = points.shape.as_slice() else { return first_frame(path) };
    let numbers = points.as_f32().map_err(|fact| wrong(format!("the array `points` {fact}")))?;
    let points = numbers.as_chunks::<3>().0;
    let strand = |n: usize| points[n * point_count..(n + 1) * point_count].iter().map(|&p| Vec3::from(p));
    let strands = (0..strand_count).map(|n| strand(n).take_while(|p| p.is_finite()).collect()).collect();
    Ok(Groom { strands, unit_known: false, up_axis: None })
}

fn first_frame(path: &Path) -> Result<Groom, IoError> {
    let sequence = read_npz(path)?.sequence;
    if sequence.frames.is_empty() {
        return Ok(Groom::default());
    }
    let known = |n: usize| sequence.strand(0, n).iter().copied().take_while(|p| p.is_finite()).collect();
    Ok(Groom { strands: (0..sequence.strand_count).map(known).collect(), unit_known: true, up_axis: None })
}
