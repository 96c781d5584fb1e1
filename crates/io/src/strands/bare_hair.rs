//! MonoHair's `.hair`, which has no header: strand count, point count, points of each strand, points.
//!
//! u32, u32, u16 a strand, 3 × f32 a point, little endian; no unit. Reference: Wu et al. 2024, the program's output.

use std::path::Path;

use strandflow_core::Strands;

use super::hair::push_strand;
use crate::{Groom, IoError, bytes::Bytes, groom::from_bytes};

/// Reads a groom in units of the file.
pub(crate) fn read(path: &Path) -> Result<Groom, IoError> {
    from_bytes(path, "a .hair file begins with `HAIR`, or with its counts of strands and points as MonoHair's", groom)
}

fn groom(data: &[u8]) -> Result<Groom, String> {
    let mut bytes = Bytes::new(data);
    let counts = bytes.u32().zip(bytes.u32());
    let (strand_count, point_count) = counts.ok_or("ends in its header")?;
    let wrong = || format!("is no .hair file: {strand_count} strands of {point_count} points do not fill it");
    // Without a magic number the length is what tells the format.
    let expected = u64::from(strand_count) * 2 + u64::from(point_count) * 12;
    if expected != bytes.remaining() as u64 {
        return Err(wrong());
    }
    let counts = bytes.take(strand_count as usize * 2).ok_or_else(wrong)?;
    let counts = counts.as_chunks::<2>().0.iter().map(|&count| usize::from(u16::from_le_bytes(count)));
    if counts.clone().sum::<usize>() != point_count as usize {
        return Err("is no .hair file: its strands have more or fewer points than it says".into());
    }
    let mut strands = Strands::new();
    for (strand, count) in counts.enumerate() {
        push_strand(&mut strands, &mut bytes, count, 1.0).map_err(|fact| format!("strand {strand}: {fact}"))?;
    }
    Ok(Groom::of(&strands, false))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sample() -> Vec<u8> {
        let mut data = Vec::new();
        [2u32, 5].iter().for_each(|n| data.extend(n.to_le_bytes()));
        [3u16, 2].iter().for_each(|n| data.extend(n.to_le_bytes()));
        (0..15).for_each(|x| data.extend((x as f32).to_le_bytes()));
        data
    }

    #[test]
    fn a_groom_is_read_and_another_length_is_told() {
        let read = groom(&sample()).unwrap();
        assert_eq!(read.strands.iter().map(Vec::len).collect::<Vec<_>>(), [3, 2]);
        assert_eq!((read.strands[1][0].to_array(), read.unit_known), ([9.0, 10.0, 11.0], false));
        let mut other = sample();
        other[8] = 4;
        assert!(groom(&other).unwrap_err().contains("more or fewer"));
        assert!(groom(&[sample(), vec![0]].concat()).unwrap_err().contains("do not fill"));
    }

    proptest! {
        #[test]
        fn any_bytes_are_safe(cut in 0usize..73, flips in prop::collection::vec((0usize..73, any::<u8>()), 0..6)) {
            let mut data = sample();
            for (at, value) in flips { let n = data.len(); data[at % n] = value; }
            data.truncate(cut);
            let _ = groom(&data);
        }
    }
}
