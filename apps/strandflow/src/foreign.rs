//! Strands of other programs, as a sequence: `.npz`, or `.hair` and `.data` files, one a frame.

use std::path::Path;

use strandflow_core::{StrandSequence, Strands};
use strandflow_engine::footage::numbered;
use strandflow_io::{read_hair, read_npz, read_usc_data};

use crate::failure::Failed;

const HINT: &str = "give a .npz, or a folder of .hair (mm) or .data (m) files named by their frame, like 000012.hair";

/// Reads a `.npz` with all frames, one `.hair` or `.data` file as the frame in its name, or a folder of them.
pub fn read(path: &Path) -> Result<StrandSequence, Failed> {
    if !path.exists() {
        return Err(Failed::input(format!("{}: there is no such file or folder", path.display()), HINT));
    }
    if path.extension().is_some_and(|ending| ending == "npz") {
        return Ok(read_npz(path)?.sequence);
    }
    let files = if path.is_dir() { numbered(path, is_groom)? } else { [(frame_of(path), path.to_owned())].into() };
    if files.is_empty() {
        return Err(Failed::input(format!("{}: holds no strands", path.display()), HINT));
    }
    let frames = files.iter().map(|(frame, file)| Ok((*frame, groom(file)?))).collect::<Result<Vec<_>, Failed>>()?;
    sequence(path, &frames)
}

fn is_groom(file: &Path) -> bool {
    file.extension().is_some_and(|ending| ending == "hair" || ending == "data")
}

fn groom(file: &Path) -> Result<Strands, Failed> {
    match file.extension().and_then(|ending| ending.to_str()) {
        Some("hair") => Ok(read_hair(file, 1.0)?),
        Some("data") => Ok(read_usc_data(file)?),
        _ => Err(Failed::input(format!("{}: is of no format that is read", file.display()), HINT)),
    }
}

/// The number at the end of a file's name; 0 without one.
fn frame_of(file: &Path) -> usize {
    let stem = file.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    stem[stem.trim_end_matches(|c: char| c.is_ascii_digit()).len()..].parse().unwrap_or(0)
}

/// Strands with the same number are the same strand in every frame; where a frame's has fewer points, the rest is missing.
fn sequence(path: &Path, frames: &[(usize, Strands)]) -> Result<StrandSequence, Failed> {
    let strand_count = frames[0].1.strand_count();
    if let Some((frame, groom)) = frames.iter().find(|(_, groom)| groom.strand_count() != strand_count) {
        let fact = format!("frame {frame} has {} strands, the first one {strand_count}", groom.strand_count());
        let hint = "strands are followed by their number: write the same strands in every frame";
        return Err(Failed::input(format!("{}: {fact}", path.display()), hint));
    }
    let longest = |n: usize| frames.iter().map(|(_, groom)| groom.strand(n).len()).max().unwrap_or(0);
    let counts: Vec<u16> = (0..strand_count).map(|n| longest(n).min(usize::from(u16::MAX)) as u16).collect();
    let points = counts.iter().copied().max().unwrap_or(0).into();
    let mut sequence = StrandSequence::missing(frames.iter().map(|(f, _)| *f as u32).collect(), counts, points);
    for (t, (_, groom)) in frames.iter().enumerate() {
        for n in 0..strand_count {
            let (from, to) = (groom.range(n), sequence.range(t, n));
            for (at, i) in to.zip(from) {
                sequence.points[at] = groom.points[i];
                sequence.provenance[at] = groom.provenance[i];
                sequence.confidence[at] = groom.confidence[i];
            }
        }
    }
    Ok(sequence)
}

#[cfg(test)]
mod tests {
    use strandflow_core::Provenance;
    use strandflow_io::{Interchange, write_hair, write_usc_data};

    use super::*;

    #[test]
    fn files_of_frames_become_a_sequence() {
        let dir = tempfile::tempdir().unwrap();
        let mut sequence = StrandSequence::missing(vec![7, 8], vec![2, 3], 3);
        for t in 0..2 {
            for n in 0..2 {
                for (p, at) in sequence.range(t, n).enumerate() {
                    sequence.points[at] = glam::Vec3::new(n as f32, t as f32, p as f32);
                    sequence.provenance[at] = Provenance::Observed;
                    sequence.confidence[at] = 1.0;
                }
            }
        }
        let strands = Interchange::new(&sequence).unwrap();
        (0..2).for_each(|t| write_hair(&dir.path().join(format!("{:06}.hair", t + 7)), &strands, t).unwrap());
        let read = read(dir.path()).unwrap();
        assert_eq!((&read.frames, &read.counts), (&sequence.frames, &sequence.counts));
        assert_eq!((read.strand(1, 1), &read.provenance), (sequence.strand(1, 1), &sequence.provenance));
        let one = dir.path().join("groom_0003.data");
        write_usc_data(&one, &strands, 0).unwrap();
        assert_eq!(super::read(&one).unwrap().frames, [3]);
        assert!(super::read(&dir.path().join("none.npz")).unwrap_err().error.contains("no such file"));
    }
}
