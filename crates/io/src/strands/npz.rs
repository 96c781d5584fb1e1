//! Strand sequences as NumPy archives.
//!
//! `points` float32 (T, N, P, 3) world \[mm\]; `valid` bool (T, N, P); `frame` int32 (T); `provenance` uint8 (T, N, P);
//! `confidence` float32 (T, N, P); `head_from_world` float64 (T, 4, 4). Stored, not deflated: noise does not shrink.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{BufReader, BufWriter},
    path::Path,
};

use glam::Vec3;
use npyz::{
    AutoSerialize, WriterBuilder,
    npz::NpzWriter,
    zip::{CompressionMethod, DateTime, ZipArchive, write::FileOptions},
};
use strandflow_core::{Provenance, RigidTransform, StrandSequence};

use super::{StrandFrames, npy::NpyArray};
use crate::{
    IoError,
    error::At,
    whole_file::{Unfinished, write_whole},
};

/// A sequence with the head's poses.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NpzStrands {
    /// The strands, world \[mm\].
    pub sequence: StrandSequence,
    /// World to head of each frame, where the file has them.
    pub head_from_world: Option<Vec<RigidTransform>>,
}

/// Writes strands and the head's poses (one a frame). Memory: one frame; every frame is read once an array.
///
/// # Errors
/// The file cannot be written, or a frame cannot be read; the file is then as it was before.
pub fn write_npz(path: &Path, strands: &dyn StrandFrames, head_from_world: &[RigidTransform]) -> Result<(), IoError> {
    let (t, n, p) = (strands.frames().len(), strands.counts().len(), strands.point_count());
    let samples = [t, n, p];
    write_whole(path, |out| {
        let mut npz = NpzWriter::new(out);
        let points = |frame: &StrandSequence| frame.points.iter().flat_map(|point| point.to_array()).collect();
        put_frames(&mut npz, "points", &[t, n, p, 3], strands, points)?;
        let valid = |frame: &StrandSequence| (0..frame.points.len()).map(|at| frame.valid(at)).collect();
        put_frames(&mut npz, "valid", &samples, strands, valid)?;
        put(&mut npz, "frame", &[t], strands.frames().iter().map(|&frame| frame as i32))?;
        let how = |frame: &StrandSequence| frame.provenance.iter().map(|&how| how as u8).collect();
        put_frames(&mut npz, "provenance", &samples, strands, how)?;
        put_frames(&mut npz, "confidence", &samples, strands, |frame| frame.confidence.clone())?;
        let rows = head_from_world.iter().flat_map(|pose| pose.to_rows()).flatten();
        put(&mut npz, "head_from_world", &[head_from_world.len(), 4, 4], rows)?;
        npz.zip_writer().finish().map_err(std::io::Error::other)?;
        Ok(())
    })
}

type Archive<'a> = NpzWriter<&'a mut BufWriter<File>>;

/// An array of all frames, one frame at a time.
fn put_frames<T: AutoSerialize>(
    npz: &mut Archive,
    name: &str,
    shape: &[usize],
    strands: &dyn StrandFrames,
    values: impl Fn(&StrandSequence) -> Vec<T>,
) -> Result<(), Unfinished> {
    let shape: Vec<u64> = shape.iter().map(|&n| n as u64).collect();
    let mut array = npz.array::<T>(name, options())?.default_dtype().shape(&shape).begin_nd()?;
    for t in 0..strands.frames().len() {
        array.extend(values(&strands.frame(t)?))?;
    }
    Ok(array.finish()?)
}

fn put<T: AutoSerialize>(
    npz: &mut Archive,
    name: &str,
    shape: &[usize],
    values: impl Iterator<Item = T>,
) -> Result<(), Unfinished> {
    let shape: Vec<u64> = shape.iter().map(|&n| n as u64).collect();
    let mut array = npz.array::<T>(name, options())?.default_dtype().shape(&shape).begin_nd()?;
    array.extend(values)?;
    Ok(array.finish()?)
}

/// A fixed time, so that the same strands give the same bytes; ZIP64, because points of long takes pass 4 GiB.
fn options() -> FileOptions {
    FileOptions::default()
        .compression_method(CompressionMethod::Stored)
        .last_modified_time(DateTime::default())
        .large_file(true)
}

/// All arrays of an archive by name.
///
/// # Errors
/// The file cannot be read, is no archive, or an array is broken.
pub fn read_arrays(path: &Path) -> Result<BTreeMap<String, NpyArray>, IoError> {
    let wrong = |fact: String| IoError::content(path, At::FILE, fact, "save it again with numpy.savez");
    let file = File::open(path).map_err(IoError::reading(path))?;
    let mut archive =
        ZipArchive::new(BufReader::new(file)).map_err(|cause| wrong(format!("is no .npz archive: {cause}")))?;
    let mut arrays = BTreeMap::new();
    for index in 0..archive.len() {
        let mut entry = archive.by_index(index).map_err(|cause| wrong(format!("is damaged: {cause}")))?;
        let Some(name) = entry.name().strip_suffix(".npy").map(str::to_owned) else { continue };
        let array = NpyArray::read(&mut entry).map_err(|fact| wrong(format!("the array `{name}` {fact}")))?;
        arrays.insert(name, array);
    }
    Ok(arrays)
}

/// Reads a sequence, of ours or of another program. Only `points` is required: without `valid` (or `provenance`), finite
/// points are valid; without `provenance`, valid points count as observed; without `confidence`, as certain; without
/// `frame`, frames count from 0. A strand's particle count is one past its last valid particle in any frame.
///
/// # Errors
/// The file cannot be read, is no archive, or an array has another shape than it should; a valid point is not finite.
pub fn read_npz(path: &Path) -> Result<NpzStrands, IoError> {
    strands_of(&read_arrays(path)?).map_err(|fact| {
        let hint = "save points float32 (T, N, P, 3) in world mm, valid bool (T, N, P), frame int32 (T)";
        IoError::content(path, At::FILE, fact, hint)
    })
}

fn strands_of(arrays: &BTreeMap<String, NpyArray>) -> Result<NpzStrands, String> {
    let points = arrays.get("points").ok_or("has no array `points`")?;
    let &[t_count, n_count, p_count, 3] = points.shape.as_slice() else {
        return Err(format!("`points` has the shape {:?}", points.shape));
    };
    let len = t_count * n_count * p_count;
    if p_count > usize::from(u16::MAX) || n_count > u32::MAX as usize {
        return Err(format!("`points` has the shape {:?}", points.shape));
    }
    let points: Vec<Vec3> = points.as_f32()?.as_chunks::<3>().0.iter().map(|&p| Vec3::from(p)).collect();
    let per_point = |name: &str| match arrays.get(name) {
        None => Ok(None),
        Some(array) if array.shape == [t_count, n_count, p_count] => array.as_f32().map(Some),
        Some(array) => Err(format!("`{name}` has the shape {:?}", array.shape)),
    };
    let (valid, provenance, confidence) = (per_point("valid")?, per_point("provenance")?, per_point("confidence")?);
    let frames = match arrays.get("frame") {
        Some(array) if array.shape == [t_count] => array.as_f64()?.into_iter().map(|x| x as u32).collect(),
        Some(array) => return Err(format!("`frame` has the shape {:?}", array.shape)),
        None => (0..t_count as u32).collect(),
    };
    let mut sequence = StrandSequence {
        frames,
        strand_count: n_count,
        point_count: p_count,
        counts: vec![0; n_count],
        points,
        provenance: vec![Provenance::Missing; len],
        confidence: vec![0.0; len],
    };
    for at in 0..len {
        let how = provenance.as_ref().map(|all| Provenance::from_number(all[at] as u8));
        let given = valid.as_ref().map(|all| all[at] != 0.0).or(how.map(|how| how != Provenance::Missing));
        let is_finite = sequence.points[at].is_finite();
        let (t, n, p) = (at / p_count / n_count, at / p_count % n_count, at % p_count);
        if given == Some(true) && !is_finite {
            return Err(format!("frame {}, strand {n}: the valid point {p} is not finite", sequence.frames[t]));
        }
        if !given.unwrap_or(is_finite) {
            sequence.points[at] = Vec3::NAN;
            continue;
        }
        sequence.counts[n] = sequence.counts[n].max(p as u16 + 1);
        sequence.provenance[at] = how.filter(|how| *how != Provenance::Missing).unwrap_or(Provenance::Observed);
        sequence.confidence[at] = confidence.as_ref().map_or(1.0, |all| all[at]);
    }
    Ok(NpzStrands { sequence, head_from_world: poses_of(arrays, t_count)? })
}

fn poses_of(arrays: &BTreeMap<String, NpyArray>, t_count: usize) -> Result<Option<Vec<RigidTransform>>, String> {
    let Some(array) = arrays.get("head_from_world") else { return Ok(None) };
    if array.shape != [t_count, 4, 4] {
        // An empty array: written without poses.
        return if array.shape.first() == Some(&0) {
            Ok(None)
        } else {
            Err(format!("`head_from_world` has the shape {:?}", array.shape))
        };
    }
    let numbers = array.as_f64()?;
    if let Some(at) = numbers.iter().position(|x| !x.is_finite()) {
        return Err(format!("`head_from_world` is not finite at frame index {}", at / 16));
    }
    let rows = |m: &[f64; 16]| [0, 4, 8, 12].map(|r| [m[r], m[r + 1], m[r + 2], m[r + 3]]);
    Ok(Some(numbers.as_chunks::<16>().0.iter().map(|m| RigidTransform::from_rows(&rows(m))).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strands::sample;
    use proptest::prelude::*;

    fn written() -> (tempfile::TempDir, std::path::PathBuf, Vec<RigidTransform>) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.npz");
        let pose =
            |t: f64| RigidTransform { rotation: glam::DMat3::from_rotation_x(t), translation: glam::DVec3::splat(t) };
        let poses: Vec<_> = [0.1, 0.2, 0.3].map(pose).into();
        write_npz(&path, &sample(), &poses).unwrap();
        (dir, path, poses)
    }

    #[test]
    fn a_sequence_comes_back_and_bytes_repeat() {
        let (_dir, path, poses) = written();
        let read = read_npz(&path).unwrap();
        let expected = sample();
        assert_eq!(read.head_from_world.unwrap(), poses);
        assert_eq!((&read.sequence.frames, &read.sequence.counts), (&expected.frames, &expected.counts));
        assert_eq!(read.sequence.provenance, expected.provenance);
        assert_eq!(format!("{:?}", read.sequence.points), format!("{:?}", expected.points));
        let (_again, second, _) = written();
        assert!(std::fs::read(&path).unwrap() == std::fs::read(&second).unwrap());
    }

    #[test]
    fn only_points_are_needed() {
        let (_dir, path, _) = written();
        let mut arrays = read_arrays(&path).unwrap();
        arrays.retain(|name, _| name == "points");
        let read = strands_of(&arrays).unwrap();
        assert_eq!((read.sequence.frames, read.sequence.counts), (vec![0, 1, 2], vec![5, 0, 3, 4]));
        assert!(strands_of(&BTreeMap::new()).unwrap_err().contains("points"));
    }

    #[test]
    fn numpy_reads_it() {
        let (_dir, path, _) = written();
        let script = "import sys, numpy as np\nz = np.load(sys.argv[1])\n\
            print([(k, str(z[k].dtype), z[k].shape) for k in sorted(z)], int(z['valid'].sum()), float(np.nansum(z['points'])))";
        let Ok(out) = std::process::Command::new(crate::strands::python()).args(["-c", script]).arg(&path).output()
        else {
            println!("skipped: no Python 3");
            return;
        };
        if String::from_utf8_lossy(&out.stderr).contains("No module named") {
            println!("skipped: no numpy");
            return;
        }
        let said = String::from_utf8_lossy(&out.stdout).into_owned();
        for part in [
            "('confidence', 'float32', (3, 4, 5))",
            "('frame', 'int32', (3,))",
            "('head_from_world', 'float64', (3, 4, 4))",
            "('points', 'float32', (3, 4, 5, 3))",
            "('provenance', 'uint8', (3, 4, 5))",
            "('valid', 'bool', (3, 4, 5))] 31 ",
        ] {
            assert!(said.contains(part), "{part} not in {said}\n{}", String::from_utf8_lossy(&out.stderr));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn broken_archives_are_safe(cut in 0usize..6000, flips in prop::collection::vec((0usize..6000, any::<u8>()), 0..5)) {
            let (_dir, path, _) = written();
            let mut file = std::fs::read(&path).unwrap();
            for (at, value) in flips { let n = file.len(); file[at % n] = value; }
            file.truncate(cut);
            std::fs::write(&path, &file).unwrap();
            let _ = read_npz(&path);
        }
    }
}
