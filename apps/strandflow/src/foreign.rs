//! Strands of other programs, as a sequence: a `.npz` with all frames, or any file that `animate` takes as a groom, one a
//! frame.

use std::path::Path;

use glam::{DVec3, Vec3};
use strandflow_core::{Provenance, StrandSequence};
use strandflow_engine::footage::numbered;
use strandflow_io::{Groom, Space, Up, read_groom, read_npz};

use crate::failure::Failed;

const HINT: &str = "give a .npz, a file of strands (.hair, .data, .ply, .abc, .usd, .usda or .usdc), or a folder of such \
                    files named by their frame, like 000012.hair";

/// Endings of files that hold one frame, or of which one frame is read.
const ENDINGS: [&str; 7] = ["hair", "data", "ply", "abc", "usd", "usda", "usdc"];

/// Reads a `.npz` with all frames, one file as the frame in its name, or a folder of files. Formats that state their way up
/// (USD), or are written upright (Alembic), are turned into the world of a take with this gravity; `tell` hears what is not
/// obvious of them.
pub fn read(path: &Path, gravity: DVec3, tell: &mut dyn FnMut(&str)) -> Result<StrandSequence, Failed> {
    if !path.exists() {
        return Err(Failed::input(format!("{}: there is no such file or folder", path.display()), HINT));
    }
    if ending(path) == "npz" {
        return npz(path);
    }
    let files = if path.is_dir() { numbered(path, is_groom)? } else { [(frame_of(path), path.to_owned())].into() };
    if files.is_empty() {
        return Err(Failed::input(format!("{}: holds no strands", path.display()), HINT));
    }
    let mut frames = Vec::new();
    for (frame, file) in &files {
        let groom = read_groom(file)?;
        if frames.is_empty() {
            explain(file, *frame, &groom, files.len(), tell);
        }
        frames.push((*frame, in_world(file, groom, gravity)));
    }
    sequence(path, &frames)
}

/// Ours with all frames, or the strands (N, P, 3) of one.
fn npz(path: &Path) -> Result<StrandSequence, Failed> {
    read_npz(path).map(|read| read.sequence).or_else(|error| match read_groom(path) {
        Ok(groom) => sequence(path, &[(frame_of(path), groom.strands)]),
        Err(_) => Err(error.into()),
    })
}

fn ending(file: &Path) -> String {
    file.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

fn is_groom(file: &Path) -> bool {
    ENDINGS.contains(&ending(file).as_str())
}

/// What a user would else wonder about: which frame it is, and in which unit.
fn explain(file: &Path, frame: usize, groom: &Groom, files: usize, tell: &mut dyn FnMut(&str)) {
    let moves = matches!(ending(file).as_str(), "abc" | "usd" | "usda" | "usdc");
    if moves && files == 1 {
        let file = file.display();
        tell(&format!("{file}: its first frame is taken, as frame {frame}; for more give one file a frame, or a .npz"));
    }
    if !groom.unit_known {
        tell(&format!("{}: states no unit; taken as millimetres", file.display()));
    }
}

/// The strands of a file in the world of a take.
fn in_world(file: &Path, groom: Groom, gravity: DVec3) -> Vec<Vec<Vec3>> {
    let up = groom.up_axis.or((ending(file) == "abc").then_some(Up::Z));
    let Some(up) = up else { return groom.strands };
    let world_from_file = Space { up, ..Space::default() }.linear_from_world(Some(gravity)).inverse().as_mat3();
    let turned = |strand: Vec<Vec3>| strand.into_iter().map(|p| world_from_file * p).collect();
    groom.strands.into_iter().map(turned).collect()
}

/// The number at the end of a file's name; 0 without one.
fn frame_of(file: &Path) -> usize {
    let stem = file.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    stem[stem.trim_end_matches(|c: char| c.is_ascii_digit()).len()..].parse().unwrap_or(0)
}

/// Strands with the same number are the same strand in every frame; where a frame's has fewer points, the rest is missing.
fn sequence(path: &Path, frames: &[(usize, Vec<Vec<Vec3>>)]) -> Result<StrandSequence, Failed> {
    let strand_count = frames[0].1.len();
    if let Some((frame, strands)) = frames.iter().find(|(_, strands)| strands.len() != strand_count) {
        let fact = format!("frame {frame} has {} strands, the first one {strand_count}", strands.len());
        let hint = "strands are followed by their number: write the same strands in every frame";
        return Err(Failed::input(format!("{}: {fact}", path.display()), hint));
    }
    let longest = |n: usize| frames.iter().map(|(_, strands)| strands[n].len()).max().unwrap_or(0);
    let counts: Vec<u16> = (0..strand_count).map(|n| longest(n).min(usize::from(u16::MAX)) as u16).collect();
    let points = counts.iter().copied().max().unwrap_or(0).into();
    let mut sequence = StrandSequence::missing(frames.iter().map(|(f, _)| *f as u32).collect(), counts, points);
    for (t, (_, strands)) in frames.iter().enumerate() {
        for (n, strand) in strands.iter().enumerate() {
            for (at, point) in sequence.range(t, n).zip(strand) {
                sequence.points[at] = *point;
                sequence.provenance[at] = Provenance::Observed;
                sequence.confidence[at] = 1.0;
            }
        }
    }
    Ok(sequence)
}

#[cfg(test)]
mod tests {
    use strandflow_io::{
        Carrier, Interchange, SceneOptions, Target, write_alembic, write_hair, write_ply, write_usc_data, write_usd,
    };

    use super::*;

    const GRAVITY: DVec3 = DVec3::new(0.0, 9810.0, 0.0);

    fn sample() -> StrandSequence {
        let mut sequence = StrandSequence::missing(vec![7, 8], vec![2, 3], 3);
        for t in 0..2 {
            for n in 0..2 {
                for (p, at) in sequence.range(t, n).enumerate() {
                    sequence.points[at] = Vec3::new(n as f32, t as f32, p as f32);
                    sequence.provenance[at] = Provenance::Observed;
                    sequence.confidence[at] = 1.0;
                }
            }
        }
        sequence
    }

    fn silent(path: &Path) -> Result<StrandSequence, Failed> {
        read(path, GRAVITY, &mut |_| {})
    }

    #[test]
    fn files_of_frames_become_a_sequence() {
        let dir = tempfile::tempdir().unwrap();
        let sequence = sample();
        let strands = Interchange::new(&sequence).unwrap();
        (0..2).for_each(|t| write_hair(&dir.path().join(format!("{:06}.hair", t + 7)), &strands, t).unwrap());
        let read = silent(dir.path()).unwrap();
        assert_eq!((&read.frames, &read.counts), (&sequence.frames, &sequence.counts));
        assert_eq!((read.strand(1, 1), &read.provenance), (sequence.strand(1, 1), &sequence.provenance));
        let one = dir.path().join("groom_0003.data");
        write_usc_data(&one, &strands, 0).unwrap();
        assert_eq!(silent(&one).unwrap().frames, [3]);
        assert!(silent(&dir.path().join("none.npz")).unwrap_err().error.contains("no such file"));
    }

    /// The world's up is −y; the files are written upright, in other units, and come back where they were.
    #[test]
    fn every_format_of_grooms_is_read_into_the_take_s_world() {
        let dir = tempfile::tempdir().unwrap();
        let sequence = sample();
        let strands = Interchange::new(&sequence).unwrap();
        let options = |target: Target| SceneOptions {
            gravity: Some(GRAVITY),
            space: target.space(Carrier::Usd),
            ..SceneOptions::default()
        };
        let file = |name: &str| dir.path().join(name);
        write_usd(&file("metres_7.usdc"), &sequence, &options(Target::Houdini)).unwrap();
        write_usd(&file("centimetres_7.usda"), &sequence, &options(Target::Unreal)).unwrap();
        let upright = SceneOptions { gravity: Some(GRAVITY), ..SceneOptions::default() };
        write_alembic(&file("plain_7.abc"), &sequence, None, &upright).unwrap();
        write_ply(&file("plain_7.ply"), &strands, 0).unwrap();
        for name in ["metres_7.usdc", "centimetres_7.usda", "plain_7.abc", "plain_7.ply"] {
            let mut told = String::new();
            let read = read(&file(name), GRAVITY, &mut |line| told += line).unwrap();
            assert_eq!((&read.frames[..], &read.counts), (&[7][..], &sequence.counts), "{name}");
            for n in 0..2 {
                let far = read.strand(0, n).iter().zip(sequence.strand(0, n)).map(|(p, q)| p.distance(*q));
                assert!(far.fold(0.0, f32::max) < 1e-4, "{name}: {:?}", read.strand(0, n));
            }
            assert_eq!(told.contains("its first frame is taken, as frame 7"), name != "plain_7.ply", "{name}: {told}");
            assert_eq!(told.contains("states no unit"), name == "plain_7.abc", "{name}: {told}");
        }
    }
}
