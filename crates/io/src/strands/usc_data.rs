//! USC's `.data` (USC-HairSalon): strand count, then per strand its point count and points; in metres there and here.
//!
//! Reference: Hu et al. 2015, the data set's notes.

use std::path::Path;

use strandflow_core::Strands;

use super::{Interchange, hair::push_strand};
use crate::{IoError, bytes::Bytes, error::At, whole_file::write_bytes};

/// Writes the `t`-th frame, in metres.
///
/// # Errors
/// The file cannot be written.
pub fn write_usc_data(path: &Path, strands: &Interchange, t: usize) -> Result<(), IoError> {
    let (frame, counts) = (strands.frame(t)?, strands.counts());
    let mut out = Vec::with_capacity(4 + counts.len() * 4 + frame.points.len() * 12);
    out.extend((counts.len() as i32).to_le_bytes());
    let mut points = frame.points.iter();
    for count in counts {
        out.extend((count as i32).to_le_bytes());
        for point in points.by_ref().take(count as usize) {
            (*point * 1e-3).to_array().iter().for_each(|x| out.extend(x.to_le_bytes()));
        }
    }
    write_bytes(path, &out)
}

/// Reads a groom in metres. Points count as observed with confidence 1.
///
/// # Errors
/// The file cannot be read, is cut, or a point is not finite (with the strand).
pub fn read_usc_data(path: &Path) -> Result<Strands, IoError> {
    let data = std::fs::read(path).map_err(IoError::reading(path))?;
    strands_from_bytes(&data)
        .map_err(|fact| IoError::content(path, At::FILE, fact, "check that it is the right file, or copy it again"))
}

fn strands_from_bytes(data: &[u8]) -> Result<Strands, String> {
    let mut bytes = Bytes::new(data);
    let count = bytes.i32().ok_or("ends in its header")?;
    let mut strands = Strands::new();
    for strand in 0..count {
        let points = bytes.i32().and_then(|n| usize::try_from(n).ok()).filter(|n| *n <= bytes.remaining() / 12);
        let points = points.ok_or_else(|| format!("strand {strand} has more points than the file"))?;
        push_strand(&mut strands, &mut bytes, points, 1000.0).map_err(|fact| format!("strand {strand}: {fact}"))?;
    }
    Ok(strands)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strands::sample;
    use proptest::prelude::*;

    fn written() -> Vec<u8> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.data");
        let sequence = sample();
        write_usc_data(&path, &Interchange::new(&sequence).unwrap(), 0).unwrap();
        std::fs::read(&path).unwrap()
    }

    #[test]
    fn a_frame_comes_back_in_millimetres() {
        let strands = strands_from_bytes(&written()).unwrap();
        assert_eq!(strands.strand_count(), 3);
        let sequence = sample();
        let far = strands.strand(1).iter().zip(sequence.strand(0, 2)).map(|(a, b)| a.distance(*b));
        assert!(far.fold(0.0, f32::max) < 1e-4);
    }

    proptest! {
        #[test]
        fn any_bytes_are_safe(cut in 0usize..170, flips in prop::collection::vec((0usize..170, any::<u8>()), 0..6)) {
            let mut data = written();
            for (at, value) in flips { let n = data.len(); data[at % n] = value; }
            data.truncate(cut);
            let _ = strands_from_bytes(&data);
        }
    }
}
