//! PLY, binary little endian: points of one frame with strand, provenance and confidence, and the edges along strands.

use std::{io::Write, path::Path};

use super::{Interchange, InterchangeFrame};
use crate::{IoError, whole_file::write_whole};

/// Writes the `t`-th frame \[mm, world\].
///
/// # Errors
/// The file cannot be written, or the frame cannot be read.
pub fn write_ply(path: &Path, strands: &Interchange, t: usize) -> Result<(), IoError> {
    let frame = strands.frame(t)?;
    write_whole(path, |out| Ok(write_to(out, strands, &frame)?))
}

fn write_to(out: &mut impl Write, strands: &Interchange, frame: &InterchangeFrame) -> std::io::Result<()> {
    let counts = strands.counts();
    let edges: usize = counts.iter().map(|&count| count as usize - 1).sum();
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\ncomment strandflow strands, world millimetres, root first\n\
         comment provenance 0 missing 1 observed 2 diffused 3 simulated 4 completed\n\
         element vertex {}\nproperty float x\nproperty float y\nproperty float z\nproperty uint strand\n\
         property uchar provenance\nproperty float confidence\n\
         element edge {edges}\nproperty int vertex1\nproperty int vertex2\nend_header\n",
        frame.points.len()
    )?;
    let ids = strands.strands.iter().zip(&counts).flat_map(|(&id, &count)| std::iter::repeat_n(id, count as usize));
    for (at, id) in ids.enumerate() {
        for x in frame.points[at].to_array() {
            out.write_all(&x.to_le_bytes())?;
        }
        out.write_all(&id.to_le_bytes())?;
        out.write_all(&[frame.provenance[at] as u8])?;
        out.write_all(&frame.confidence[at].to_le_bytes())?;
    }
    let mut first = 0;
    for count in counts {
        for at in first..first + count as i32 - 1 {
            out.write_all(&at.to_le_bytes())?;
            out.write_all(&(at + 1).to_le_bytes())?;
        }
        first += count as i32;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strands::sample;

    #[test]
    fn counts_and_sizes_fit() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.ply");
        let sequence = sample();
        write_ply(&path, &Interchange::new(&sequence).unwrap(), 2).unwrap();
        let file = std::fs::read(&path).unwrap();
        let end = b"end_header\n";
        let at = file.windows(end.len()).position(|w| w == end).unwrap() + end.len();
        let header = String::from_utf8_lossy(&file[..at]).into_owned();
        assert!(header.contains("element vertex 12\n") && header.contains("element edge 9\n"));
        assert_eq!(file.len() - at, 12 * 21 + 9 * 8);
        let x = f32::from_le_bytes(file[at + 5 * 21..at + 5 * 21 + 4].try_into().unwrap());
        assert_eq!(x, 20.0, "the first point of strand 2");
    }
}
