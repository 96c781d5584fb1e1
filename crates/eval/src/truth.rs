//! The truth of a capture, read from its `gt` folder: strands, head, markers, all in millimetres.

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3, Vec3};
use strandflow_core::{RigidTransform, TriMesh};
use strandflow_io::read_obj;

/// What is true of a capture. World coordinates are those of the calibration, in millimetres.
#[derive(Clone, Debug, Default)]
pub struct Truth {
    /// Frame numbers of `points`, rising.
    pub frames: Vec<u32>,
    /// Per frame: points of all strands, root first \[mm\]; the same topology in every frame.
    pub points: Vec<Vec<Vec3>>,
    /// Where each strand starts; strand_count + 1 entries.
    pub offsets: Vec<u32>,
    /// Strands whose length and path stay whole; motion is scored on these.
    pub stable: Vec<bool>,
    /// The head's motion since the first frame of the capture, by frame number.
    pub world_from_head: Vec<RigidTransform>,
    /// Head surface at the first frame of the capture, world \[mm\] (empty where not given).
    pub head: TriMesh,
    /// Marker centres at the first frame \[mm\].
    pub markers: Vec<DVec3>,
    /// Radius of the marker balls \[mm\]; 0 where not given.
    pub marker_radius: f64,
    /// Marker projections \[px\] and visible shares, by frame number, view and marker.
    pub marker_views: Vec<Vec<Vec<(DVec2, f32)>>>,
}

impl Truth {
    /// Number of strands.
    pub fn strand_count(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// The points of a strand in the `t`-th frame of `frames` \[mm\].
    pub fn strand(&self, t: usize, strand: usize) -> &[Vec3] {
        &self.points[t][self.offsets[strand] as usize..self.offsets[strand + 1] as usize]
    }

    /// The position of a frame number in `frames`.
    pub fn at(&self, frame: u32) -> Option<usize> {
        self.frames.binary_search(&frame).ok()
    }

    /// The head surface in the frame of this number, world \[mm\].
    pub fn head_at(&self, frame: u32) -> TriMesh {
        let pose = self.world_from_head.get(frame as usize).copied().unwrap_or_default();
        TriMesh {
            vertices: self.head.vertices.iter().map(|v| pose.point(*v)).collect(),
            faces: self.head.faces.clone(),
        }
    }
}

/// Why a truth folder cannot be read.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{}: {fact}", file.display())]
pub struct TruthError {
    /// The file.
    pub file: PathBuf,
    /// What is wrong.
    pub fact: String,
}

/// The frames of a `gt` folder, rising, without a gap.
///
/// # Errors
/// There is none, or they begin later than with frame 1.
pub fn frames(folder: &Path) -> Result<Vec<u32>, TruthError> {
    let there = |frame: &u32| strands_file(folder, *frame).is_file();
    let first = u32::from(!there(&0));
    let found: Vec<u32> = (first..1_000_000).take_while(there).collect();
    if found.is_empty() {
        return Err(TruthError { file: strands_file(folder, 0), fact: "there is no such file".into() });
    }
    Ok(found)
}

/// The true strands of one frame alone: points of all, root first \[mm\], and where each strand starts (one entry more).
///
/// # Errors
/// A file that cannot be read, an array that is missing or of the wrong shape.
pub fn read_strands(folder: &Path, frame: u32) -> Result<(Vec<Vec3>, Vec<u32>), TruthError> {
    let mut archive = Archive::open(&strands_file(folder, frame))?;
    let points: Vec<Vec3> = archive.vectors("points")?.into_iter().map(|p| (p * 1000.0).as_vec3()).collect();
    let offsets: Vec<u32> = archive.numbers("offsets")?.1.into_iter().map(|x| x as u32).collect();
    let total = offsets.last().copied().unwrap_or(0) as usize;
    if points.len() != total || offsets.windows(2).any(|o| o[0] > o[1]) {
        return Err(archive.wrong("offsets and points do not belong together"));
    }
    Ok((points, offsets))
}

fn strands_file(folder: &Path, frame: u32) -> PathBuf {
    folder.join(format!("strands_{frame:06}.npz"))
}

/// Reads a `gt` folder: `strands_%06d.npz` are required; `stable.npz`, `head_pose.npz`, `head.obj` and `markers.npz` may be
/// absent (all strands stable, no motion, no head, no markers). Metres become millimetres.
///
/// # Errors
/// A file that cannot be read, an array that is missing or of the wrong shape, frames of differing topology.
pub fn read(folder: &Path) -> Result<Truth, TruthError> {
    let mut truth = Truth::default();
    for frame in frames(folder)? {
        let (points, offsets) = read_strands(folder, frame)?;
        if !truth.frames.is_empty() && offsets != truth.offsets {
            let fact = "another strand topology than the frame before".into();
            return Err(TruthError { file: strands_file(folder, frame), fact });
        }
        truth.offsets = offsets;
        truth.frames.push(frame);
        truth.points.push(points);
    }
    truth.stable = vec![true; truth.strand_count()];
    if let Some(mut archive) = Archive::open_if_there(&folder.join("stable.npz"))? {
        truth.stable = archive.numbers("stable")?.1.into_iter().map(|x| x != 0.0).collect();
        if truth.stable.len() != truth.strand_count() {
            return Err(archive.wrong("as many entries as strands are needed"));
        }
    }
    read_head(folder, &mut truth)?;
    if let Some(mut archive) = Archive::open_if_there(&folder.join("markers.npz"))? {
        read_markers(&mut archive, &mut truth)?;
    }
    Ok(truth)
}

fn read_head(folder: &Path, truth: &mut Truth) -> Result<(), TruthError> {
    let Some(mut archive) = Archive::open_if_there(&folder.join("head_pose.npz"))? else { return Ok(()) };
    truth.world_from_head = archive.poses("relative_to_frame0")?;
    let world_from_mesh = archive.poses("head_to_world")?.first().copied().unwrap_or_default();
    let path = folder.join("head.obj");
    if path.is_file() {
        truth.head = read_obj(&path).map_err(|error| TruthError { fact: error.fact(), file: path })?;
        truth.head.vertices.iter_mut().for_each(|v| *v = world_from_mesh.point(*v * 1000.0));
    }
    Ok(())
}

fn read_markers(archive: &mut Archive, truth: &mut Truth) -> Result<(), TruthError> {
    truth.markers = archive.vectors("points_frame0")?.into_iter().map(|p| p * 1000.0).collect();
    truth.marker_radius =
        archive.numbers("radius").ok().and_then(|(_, radius)| radius.first().copied()).unwrap_or(0.0) * 1000.0;
    let (shape, uv) = archive.numbers("uv")?;
    let (_, visible) = archive.numbers("visible_fraction")?;
    let [_, views, markers, 2] = shape[..] else { return Err(archive.wrong("`uv` is not (T, views, M, 2)")) };
    if visible.len() * 2 != uv.len() || views == 0 || markers == 0 {
        return Err(archive.wrong("`uv` and `visible_fraction` do not belong together"));
    }
    let all: Vec<(DVec2, f32)> =
        uv.chunks_exact(2).zip(&visible).map(|(p, v)| (DVec2::new(p[0], p[1]), *v as f32)).collect();
    let frames = all.chunks_exact(views * markers);
    truth.marker_views = frames.map(|f| f.chunks_exact(markers).map(<[_]>::to_vec).collect()).collect();
    Ok(())
}

/// A `.npz` file.
struct Archive {
    path: PathBuf,
    file: npyz::npz::NpzArchive<std::io::BufReader<std::fs::File>>,
}

impl Archive {
    fn open(path: &Path) -> Result<Self, TruthError> {
        let file = npyz::npz::NpzArchive::open(path)
            .map_err(|error| TruthError { file: path.into(), fact: error.to_string() })?;
        Ok(Self { path: path.into(), file })
    }

    fn open_if_there(path: &Path) -> Result<Option<Self>, TruthError> {
        if path.is_file() { Self::open(path).map(Some) } else { Ok(None) }
    }

    fn wrong(&self, fact: impl ToString) -> TruthError {
        TruthError { file: self.path.clone(), fact: fact.to_string() }
    }

    /// Shape and values of an array of any plain number type.
    fn numbers(&mut self, name: &str) -> Result<(Vec<usize>, Vec<f64>), TruthError> {
        let path = self.path.clone();
        let wrong = |fact: String| TruthError { file: path.clone(), fact };
        let array = self.file.by_name(name).map_err(|e| wrong(format!("`{name}`: {e}")))?;
        let array = array.ok_or_else(|| wrong(format!("array `{name}` is missing")))?;
        let shape: Vec<usize> = array.shape().iter().map(|n| *n as usize).collect();
        let kind = array.dtype().descr();
        let values = match kind.trim_matches(|c| c == '\'' || c == '"') {
            "<f4" => array.into_vec::<f32>().map(|v| v.into_iter().map(f64::from).collect()),
            "<f8" => array.into_vec::<f64>(),
            "<i4" => array.into_vec::<i32>().map(|v| v.into_iter().map(f64::from).collect()),
            "<i8" => array.into_vec::<i64>().map(|v| v.into_iter().map(|x| x as f64).collect()),
            "|u1" => array.into_vec::<u8>().map(|v| v.into_iter().map(f64::from).collect()),
            "|b1" => array.into_vec::<bool>().map(|v| v.into_iter().map(|x| f64::from(u8::from(x))).collect()),
            other => return Err(wrong(format!("array `{name}` is of type {other}, which is not read"))),
        };
        Ok((shape, values.map_err(|e| wrong(format!("`{name}`: {e}")))?))
    }

    fn vectors(&mut self, name: &str) -> Result<Vec<DVec3>, TruthError> {
        let (shape, values) = self.numbers(name)?;
        if shape.last() != Some(&3) {
            return Err(self.wrong(format!("array `{name}` is not (…, 3)")));
        }
        Ok(values.chunks_exact(3).map(DVec3::from_slice).collect())
    }

    /// Rigid transforms (T, 4, 4), translations in metres made millimetres.
    fn poses(&mut self, name: &str) -> Result<Vec<RigidTransform>, TruthError> {
        let (shape, values) = self.numbers(name)?;
        if shape.len() != 3 || shape[1..] != [4, 4] {
            return Err(self.wrong(format!("array `{name}` is not (T, 4, 4)")));
        }
        Ok(values
            .chunks_exact(16)
            .map(|m| {
                let mut pose = RigidTransform::from_rows(&[0, 4, 8, 12].map(|r| [m[r], m[r + 1], m[r + 2], m[r + 3]]));
                pose.translation *= 1000.0;
                pose
            })
            .collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_without_truth_is_named() {
        let folder = tempfile::tempdir().unwrap();
        assert!(read(folder.path()).unwrap_err().to_string().contains("strands_000000.npz"));
    }
}
