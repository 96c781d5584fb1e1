//! Cem Yuksel's `.hair`: header, segments per strand, points, optional thickness, transparency and colours.
//!
//! Reference: Yuksel 2009, "HAIR file format" (cemyuksel.com). The format has no unit; ours are millimetres.

use std::path::Path;

use glam::Vec3;
use strandflow_core::{Provenance, Strands};

use super::Interchange;
use crate::{Groom, IoError, bytes::Bytes, error::At, groom::from_bytes, whole_file::write_bytes};

const HAS_SEGMENTS: u32 = 1;
const HAS_POINTS: u32 = 2;
const HEADER_BYTES: usize = 128;
const REMARK_BYTES: usize = 88;
const REMARK: &[u8] = b"strandflow; millimetres; world axes";

/// Writes the `t`-th frame \[mm, world\].
///
/// # Errors
/// The file cannot be written, or a strand has more points than the format takes (65,536).
pub fn write_hair(path: &Path, strands: &Interchange, t: usize) -> Result<(), IoError> {
    let (frame, counts) = (strands.frame(t)?, strands.counts());
    let mut out = Vec::with_capacity(HEADER_BYTES + frame.points.len() * 12 + counts.len() * 2);
    out.extend(b"HAIR");
    for number in [counts.len() as u32, frame.points.len() as u32, HAS_SEGMENTS | HAS_POINTS, 0] {
        out.extend(number.to_le_bytes());
    }
    // Defaults: thickness, transparency, colour.
    for number in [0.08f32, 0.0, 0.35, 0.25, 0.2] {
        out.extend(number.to_le_bytes());
    }
    let mut remark = [b' '; REMARK_BYTES];
    remark[..REMARK.len()].copy_from_slice(REMARK);
    remark[REMARK_BYTES - 1] = 0;
    out.extend(remark);
    counts.iter().for_each(|&count| out.extend(((count - 1) as u16).to_le_bytes()));
    frame.points.iter().flat_map(|p| p.to_array()).for_each(|x| out.extend(x.to_le_bytes()));
    write_bytes(path, &out)
}

/// Reads a groom; `unit_mm` millimetres are one unit of the file. Points count as observed with confidence 1.
///
/// # Errors
/// The file cannot be read, is no `.hair`, is cut, or a point is not finite (with the strand).
pub fn read_hair(path: &Path, unit_mm: f32) -> Result<Strands, IoError> {
    let data = std::fs::read(path).map_err(IoError::reading(path))?;
    strands_from_bytes(&data, unit_mm)
        .map_err(|fact| IoError::content(path, At::FILE, fact, "check that it is the right file, or copy it again"))
}

/// Reads a groom; the unit is known where the remark is that of [`write_hair`].
pub(crate) fn read_hair_groom(path: &Path) -> Result<Groom, IoError> {
    from_bytes(path, "check that it is the right file, or copy it again", |data| {
        let remark = data.get(HEADER_BYTES - REMARK_BYTES..HEADER_BYTES).unwrap_or_default();
        Ok(Groom::of(&strands_from_bytes(data, 1.0)?, remark.starts_with(REMARK)))
    })
}

fn strands_from_bytes(data: &[u8], unit_mm: f32) -> Result<Strands, String> {
    let mut bytes = Bytes::new(data);
    if bytes.take(4) != Some(b"HAIR") {
        return Err("is not a .hair file".into());
    }
    let header = (|| Some([bytes.u32()?, bytes.u32()?, bytes.u32()?, bytes.u32()?]))();
    let [strand_count, point_count, flags, segments] = header.ok_or("ends in its header")?;
    bytes.skip(HEADER_BYTES - 20).ok_or("ends in its header")?;
    if flags & HAS_POINTS == 0 {
        return Err("holds no points".into());
    }
    let cut = || "ends too early".to_owned();
    let mut own = match flags & HAS_SEGMENTS {
        0 => None,
        _ => Some(Bytes::new(bytes.take((strand_count as usize).checked_mul(2).ok_or_else(cut)?).ok_or_else(cut)?)),
    };
    let length = (point_count as usize).checked_mul(12).ok_or_else(cut)?;
    let mut points = Bytes::new(bytes.take(length).ok_or_else(cut)?);
    let mut strands = Strands::new();
    for strand in 0..strand_count {
        let segments = own.as_mut().map_or(Some(segments), |own| own.u16().map(u32::from)).ok_or_else(cut)?;
        let count = segments as usize + 1;
        if points.remaining() / 12 < count {
            return Err(format!("strand {strand} has more points than the file"));
        }
        push_strand(&mut strands, &mut points, count, unit_mm).map_err(|fact| format!("strand {strand}: {fact}"))?;
    }
    Ok(strands)
}

/// Reads `count` points as one strand; the caller has seen that they are there.
pub(super) fn push_strand(strands: &mut Strands, bytes: &mut Bytes, count: usize, unit_mm: f32) -> Result<(), String> {
    let mut points = Vec::with_capacity(count.min(bytes.remaining() / 12));
    for at in 0..count {
        let (x, y, z) = (bytes.f32(), bytes.f32(), bytes.f32());
        let (Some(x), Some(y), Some(z)) = (x, y, z) else { return Err("ends too early".into()) };
        let point = Vec3::new(x, y, z) * unit_mm;
        if !point.is_finite() {
            return Err(format!("point {at} is not finite"));
        }
        points.push(point);
    }
    strands.push(&points, &vec![Provenance::Observed; points.len()], &vec![1.0; points.len()]);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strands::sample;
    use proptest::prelude::*;

    fn written() -> Vec<u8> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.hair");
        let sequence = sample();
        write_hair(&path, &Interchange::new(&sequence).unwrap(), 0).unwrap();
        std::fs::read(&path).unwrap()
    }

    #[test]
    fn a_frame_comes_back() {
        let (data, sequence) = (written(), sample());
        assert_eq!(data.len(), 128 + 3 * 2 + 12 * 12);
        let strands = strands_from_bytes(&data, 1.0).unwrap();
        assert_eq!(strands.strand_count(), 3);
        assert_eq!(strands.strand(1), sequence.strand(0, 2));
        assert!(strands_from_bytes(&data[..data.len() - 1], 1.0).is_err());
    }

    #[test]
    fn one_segment_count_for_all_strands() {
        let mut data = written();
        data.drain(128..134);
        data[4] = 4;
        data[12] = 2;
        data[16] = 2;
        let strands = strands_from_bytes(&data, 10.0).unwrap();
        assert_eq!((strands.strand_count(), strands.strand(3).len()), (4, 3));
    }

    proptest! {
        #[test]
        fn any_bytes_are_safe(cut in 0usize..290, flips in prop::collection::vec((0usize..290, any::<u8>()), 0..6)) {
            let mut data = written();
            for (at, value) in flips { let n = data.len(); data[at % n] = value; }
            data.truncate(cut);
            let _ = strands_from_bytes(&data, 1.0);
        }
    }
}
