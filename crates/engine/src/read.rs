//! Results of a take, as the types of the vocabulary.

use std::ops::Range;

use glam::{DVec2, DVec3, Vec3};
use strandflow_core::{
    FrameRange, Grid, Mask, Occupancy, Plane, Provenance, RigidTransform, SparseVoxels, StrandSequence, Strands,
    TriMesh,
};
use strandflow_stages::{
    field::FieldVoxel,
    lift::Line,
    masks::Masks,
    orient::{
        OrientationMap,
        steady::{Flow, Moment, flow_size, half_size},
    },
    pose::HeadPoses,
    prune::Pruned,
    scalp::Scalp,
};

use crate::{
    EngineError, Take,
    rooms::orient::frames,
    store::{Element, Store},
};

/// One turn of an angle in `orient/angle` is 65536 steps of π.
pub(crate) const ANGLE_STEPS: f32 = 65536.0;

/// What can be read without the user's files.
impl Store {
    /// The take's grid.
    ///
    /// # Errors
    /// `Store` where it is not there; the same for all readers below.
    pub fn read_grid(&self) -> Result<Grid, EngineError> {
        let origin: Vec<f64> = self.read_all("hull/grid/origin")?;
        let voxel: Vec<f64> = self.read_all("hull/grid/voxel_mm")?;
        let dims: Vec<u32> = self.read_all("hull/grid/dims")?;
        let dims = [dims[0] as usize, dims[1] as usize, dims[2] as usize];
        Ok(Grid { origin: DVec3::from_slice(&origin), voxel_mm: voxel[0], dims })
    }

    /// Hull of a frame.
    pub fn read_hull(&self, frame: usize) -> Result<Occupancy, EngineError> {
        let grid = self.read_grid()?;
        let [nx, ny, nz] = grid.dims;
        let samples: Vec<u8> = self.read("hull/occupancy", &[frame..frame + 1, 0..nz, 0..ny, 0..nx])?;
        let mut occupancy = Occupancy::empty(grid);
        for (word, bits) in occupancy.words.iter_mut().zip(samples.chunks(64)) {
            *word = bits.iter().enumerate().fold(0, |w, (i, &bit)| w | u64::from(bit != 0) << i);
        }
        Ok(occupancy)
    }

    /// The head's motion in the `t`-th frame of the take.
    pub fn read_pose(&self, t: usize) -> Result<RigidTransform, EngineError> {
        let rows: Vec<f64> = self.read("pose/world_from_head", &[t..t + 1, 0..4, 0..4])?;
        Ok(transform_from_slice(&rows))
    }

    /// The head's motion in all frames of the take.
    pub fn read_head_motion(&self) -> Result<Vec<RigidTransform>, EngineError> {
        let rows: Vec<f64> = self.read_all("pose/world_from_head")?;
        Ok(rows.chunks_exact(16).map(transform_from_slice).collect())
    }

    /// The scalp and its roots.
    pub fn read_scalp(&self) -> Result<Scalp, EngineError> {
        let vectors = |path: &str| -> Result<Vec<DVec3>, EngineError> {
            Ok(self.read_all::<f64>(path)?.chunks_exact(3).map(DVec3::from_slice).collect())
        };
        let faces: Vec<u32> = self.read_all("scalp/faces")?;
        let faces = faces.chunks_exact(3).map(|f| [f[0], f[1], f[2]]).collect();
        let mesh = TriMesh { vertices: vectors("scalp/vertices")?, faces };
        Ok(Scalp { mesh, roots: vectors("scalp/roots")?, normals: vectors("scalp/normals")? })
    }

    /// Observed lines of a frame.
    pub fn read_lines(&self, frame: usize) -> Result<SparseVoxels<Line>, EngineError> {
        let array = |name: &str| format!("lift/{frame:06}/{name}");
        let indices: Vec<u32> = self.ragged(&array("voxel"))?;
        let directions: Vec<f32> = self.ragged(&array("direction"))?;
        let confidence: Vec<f32> = self.ragged(&array("confidence"))?;
        let residual: Vec<f32> = self.ragged(&array("residual"))?;
        let views: Vec<u8> = self.ragged(&array("views"))?;
        let line = |i: usize| Line {
            direction: Vec3::from_slice(&directions[3 * i..]),
            confidence: confidence[i],
            residual: residual[i],
            views: views[i],
        };
        Ok(SparseVoxels { grid: self.read_grid()?, values: (0..indices.len()).map(line).collect(), indices })
    }

    /// The velocity field of a frame \[mm/s\].
    pub fn read_flow(&self, frame: usize) -> Result<SparseVoxels<Vec3>, EngineError> {
        let indices: Vec<u32> = self.ragged(&format!("flow/{frame:06}/voxel"))?;
        let velocity: Vec<f32> = self.ragged(&format!("flow/{frame:06}/velocity"))?;
        let values = velocity.chunks_exact(3).map(Vec3::from_slice).collect();
        Ok(SparseVoxels { grid: self.read_grid()?, values, indices })
    }

    /// Orientation map of one view and frame, of a camera's size (width, height).
    pub fn read_orientation(
        &self,
        view: usize,
        frame: usize,
        size: (usize, usize),
    ) -> Result<OrientationMap, EngineError> {
        self.orientation_map(["orient/angle", "orient/confidence"], view, frame, size)
    }

    fn orientation_map(
        &self,
        [angle, confidence]: [&str; 2],
        view: usize,
        frame: usize,
        size: (usize, usize),
    ) -> Result<OrientationMap, EngineError> {
        let angle: Plane<u16> = self.image_plane(angle, view, frame, size)?;
        let confidence: Plane<u8> = self.image_plane(confidence, view, frame, size)?;
        let step = std::f32::consts::PI / ANGLE_STEPS;
        Ok(OrientationMap {
            angle: angle.map(|&a| f32::from(a) * step),
            confidence: confidence.map(|&c| f32::from(c) / 255.0),
        })
    }

    /// Masks of one view and frame, of a camera's size (width, height).
    pub fn read_masks(&self, view: usize, frame: usize, size: (usize, usize)) -> Result<Masks, EngineError> {
        let subject = self.image_plane("masks/subject", view, frame, size)?;
        Ok(Masks { subject, hair: self.image_plane("masks/hair", view, frame, size)? })
    }

    fn image_plane<T: Element>(
        &self,
        path: &str,
        view: usize,
        frame: usize,
        (width, height): (usize, usize),
    ) -> Result<Plane<T>, EngineError> {
        let data = self.read(path, &[frame..frame + 1, view..view + 1, 0..height, 0..width])?;
        Ok(Plane { width, height, data })
    }

    /// Some strands over some frames after `smooth` (trimmed), `fit` or `blend`.
    pub fn read_sequence_part(
        &self,
        stage: &str,
        frames: FrameRange,
        strands: Range<usize>,
    ) -> Result<StrandSequence, EngineError> {
        let point_count = self.shape(&format!("{stage}/provenance"))?[2];
        let samples = [frames.start..frames.end, strands.clone(), 0..point_count];
        let mut positions = samples.to_vec();
        positions.push(0..3);
        let points: Vec<f32> = self.read(&format!("{stage}/points"), &positions)?;
        let provenance: Vec<u8> = self.read(&format!("{stage}/provenance"), &samples)?;
        let confidence: Vec<u8> = self.read(&format!("{stage}/confidence"), &samples)?;
        Ok(StrandSequence {
            frames: (frames.start as u32..frames.end as u32).collect(),
            strand_count: strands.len(),
            point_count,
            counts: self.read_counts(stage, frames, strands)?,
            points: points.chunks_exact(3).map(Vec3::from_slice).collect(),
            provenance: provenance.into_iter().map(Provenance::from_number).collect(),
            confidence: confidence.into_iter().map(|c| f32::from(c) / 255.0).collect(),
        })
    }

    /// Particles of each strand; after `blend` the largest over the frames.
    pub fn read_counts(&self, stage: &str, frames: FrameRange, strands: Range<usize>) -> Result<Vec<u16>, EngineError> {
        let path = format!("{stage}/counts");
        if stage != "blend" {
            return self.read(&path, &[strands]);
        }
        let count = strands.len();
        let all: Vec<u16> = self.read(&path, &[frames.start..frames.end, strands])?;
        Ok((0..count).map(|n| all.iter().skip(n).step_by(count).copied().max().unwrap_or(0)).collect())
    }

    fn ragged<T: Element>(&self, path: &str) -> Result<Vec<T>, EngineError> {
        if self.shape(path)?.first() == Some(&0) { Ok(Vec::new()) } else { self.read_all(path) }
    }
}

impl Take {
    /// Masks of one view and frame.
    ///
    /// # Errors
    /// `Store` where they are not there; the same for all readers below.
    pub fn read_masks(&self, view: usize, frame: usize) -> Result<Masks, EngineError> {
        Ok(Masks { subject: self.read_subject(view, frame)?, hair: self.read_hair(view, frame)? })
    }

    /// Subject mask of one view and frame.
    pub fn read_subject(&self, view: usize, frame: usize) -> Result<Mask, EngineError> {
        self.image_plane("masks/subject", view, frame)
    }

    /// Hair mask of one view and frame.
    pub fn read_hair(&self, view: usize, frame: usize) -> Result<Mask, EngineError> {
        self.image_plane("masks/hair", view, frame)
    }

    /// Orientation map of one view and frame.
    pub fn read_orientation(&self, view: usize, frame: usize) -> Result<OrientationMap, EngineError> {
        self.store().read_orientation(view, frame, self.size_of(view))
    }

    /// Orientation map of one view and frame, from this frame alone.
    pub(crate) fn read_lone_orientation(&self, view: usize, frame: usize) -> Result<OrientationMap, EngineError> {
        self.store().orientation_map(frames::MAP, view, frame, self.size_of(view))
    }

    /// A frame as its neighbours see it.
    pub(crate) fn read_moment(&self, view: usize, frame: usize) -> Result<Moment, EngineError> {
        let half = self.store().orientation_map(frames::HALF, view, frame, half_size(self.size_of(view)))?;
        Ok(Moment { half, back: self.read_flow_back(view, frame)? })
    }

    /// Flow of the image to the frame before.
    pub(crate) fn read_flow_back(&self, view: usize, frame: usize) -> Result<Flow, EngineError> {
        let plane = |path| self.store().image_plane(path, view, frame, flow_size(self.size_of(view)));
        let [u, v] = frames::BACK;
        Ok(Flow { u: plane(u)?, v: plane(v)? })
    }

    fn image_plane<T: Element>(&self, path: &str, view: usize, frame: usize) -> Result<Plane<T>, EngineError> {
        self.store().image_plane(path, view, frame, self.size_of(view))
    }

    fn size_of(&self, view: usize) -> (usize, usize) {
        let camera = &self.rig().cameras[view];
        (camera.width, camera.height)
    }

    /// The take's grid.
    pub fn read_grid(&self) -> Result<Grid, EngineError> {
        self.store().read_grid()
    }

    /// Hull of a frame.
    pub fn read_hull(&self, frame: usize) -> Result<Occupancy, EngineError> {
        self.store().read_hull(frame)
    }

    /// Marker tracks and head poses; frame `lead.start + t` at index `t`.
    pub fn read_poses(&self) -> Result<HeadPoses, EngineError> {
        let shape = self.store().shape("pose/tracks")?;
        let (times, views, markers) = (shape[0], shape[1], shape[2]);
        let positions: Vec<f64> = self.store().read_all("pose/markers")?;
        let tracks: Vec<f64> = self.store().read_all("pose/tracks")?;
        let position = |i: usize| some_finite(DVec3::from_slice(&positions[3 * i..]), DVec3::is_finite);
        let track = |i: usize| some_finite(DVec2::from_slice(&tracks[2 * i..]), DVec2::is_finite);
        let interpolated: Vec<u8> = self.store().read_all("pose/interpolated")?;
        Ok(HeadPoses {
            world_from_head: self.store().read_head_motion()?,
            markers: (0..times).map(|t| (0..markers).map(|m| position(t * markers + m)).collect()).collect(),
            tracks: (0..times * views)
                .map(|tv| (0..markers).map(|m| track(tv * markers + m)).collect())
                .collect::<Vec<Vec<_>>>()
                .chunks(views.max(1))
                .map(<[_]>::to_vec)
                .collect(),
            rms_px: self.store().read_all("pose/rms_px")?,
            used: self.store().read_all("pose/used")?,
            interpolated: interpolated.into_iter().map(|flag| flag != 0).collect(),
        })
    }

    /// The head's motion in some frames.
    pub fn read_poses_of(&self, frames: FrameRange) -> Result<Vec<RigidTransform>, EngineError> {
        let (motion, first) = (self.store().read_head_motion()?, self.frames().start);
        let within = frames.start.saturating_sub(first)..frames.end.saturating_sub(first);
        let missing = || EngineError::store("pose/world_from_head", format!("does not hold the frames {frames}"));
        Ok(motion.get(within).ok_or_else(missing)?.to_vec())
    }

    /// The head's motion in a frame.
    pub fn read_pose(&self, frame: usize) -> Result<RigidTransform, EngineError> {
        self.store().read_pose(frame.saturating_sub(self.frames().start))
    }

    /// The scalp and its roots.
    pub fn read_scalp(&self) -> Result<Scalp, EngineError> {
        self.store().read_scalp()
    }

    /// Observed lines of a frame.
    pub fn read_lines(&self, frame: usize) -> Result<SparseVoxels<Line>, EngineError> {
        self.store().read_lines(frame)
    }

    /// The line field of a frame.
    pub fn read_field(&self, frame: usize) -> Result<SparseVoxels<FieldVoxel>, EngineError> {
        let array = |name: &str| format!("field/{frame:06}/{name}");
        let indices: Vec<u32> = self.ragged(&array("voxel"))?;
        let directions: Vec<f32> = self.ragged(&array("direction"))?;
        let trust: Vec<f32> = self.ragged(&array("trust"))?;
        let observed: Vec<u8> = self.ragged(&array("observed"))?;
        let voxel = |i: usize| FieldVoxel {
            direction: Vec3::from_slice(&directions[3 * i..]),
            trust: trust[i],
            observed: observed[i] != 0,
        };
        Ok(SparseVoxels { grid: self.read_grid()?, values: (0..indices.len()).map(voxel).collect(), indices })
    }

    /// The displacement of the hair since the frame before \[mm\].
    pub fn read_motion(&self, frame: usize) -> Result<SparseVoxels<Vec3>, EngineError> {
        let indices: Vec<u32> = self.ragged(&format!("field/{frame:06}/voxel"))?;
        let motion: Vec<f32> = self.ragged(&format!("field/{frame:06}/motion"))?;
        let values = motion.chunks_exact(3).map(Vec3::from_slice).collect();
        Ok(SparseVoxels { grid: self.read_grid()?, values, indices })
    }

    /// The velocity field of a frame \[mm/s\].
    pub fn read_flow(&self, frame: usize) -> Result<SparseVoxels<Vec3>, EngineError> {
        self.store().read_flow(frame)
    }

    fn ragged<T: Element>(&self, path: &str) -> Result<Vec<T>, EngineError> {
        self.store().ragged(path)
    }

    /// Strands of a frame after `grow`, `prune` or `smooth` (before trimming), numbered like the roots.
    pub fn read_strands(&self, stage: &str, frame: usize) -> Result<Strands, EngineError> {
        self.read_strand_range(stage, frame, 0..self.strand_count()?)
    }

    /// Some strands of a frame after `grow`, `prune` or `smooth` (before trimming).
    pub fn read_strand_range(&self, stage: &str, frame: usize, range: Range<usize>) -> Result<Strands, EngineError> {
        let folder = if stage == "smooth" { "smooth/frames" } else { stage };
        let width = self.store().shape(&format!("{folder}/provenance"))?[2];
        let samples = [frame..frame + 1, range, 0..width];
        let mut positions = samples.to_vec();
        positions.push(0..3);
        let points: Vec<f32> = self.store().read(&format!("{folder}/points"), &positions)?;
        let provenance: Vec<u8> = self.store().read(&format!("{folder}/provenance"), &samples)?;
        let confidence: Vec<u8> = self.store().read(&format!("{folder}/confidence"), &samples)?;
        let mut strands = Strands::new();
        for strand in 0..samples[1].len() {
            let at = strand * width..(strand + 1) * width;
            let present = |i: &usize| points[3 * i].is_finite();
            let count = at.clone().rev().find(present).map_or(0, |last| last + 1 - at.start);
            let at = at.start..at.start + count;
            let positions: Vec<Vec3> = at.clone().map(|i| Vec3::from_slice(&points[3 * i..])).collect();
            let origin: Vec<Provenance> = provenance[at.clone()].iter().map(|&p| Provenance::from_number(p)).collect();
            let trust: Vec<f32> = confidence[at].iter().map(|&c| f32::from(c) / 255.0).collect();
            strands.push(&positions, &origin, &trust);
        }
        Ok(strands)
    }

    /// Strands of a frame after `prune`, with the reasons of rejection.
    pub fn read_pruned(&self, frame: usize) -> Result<Pruned, EngineError> {
        let flags = self.store().read("prune/flags", &[frame..frame + 1, 0..self.strand_count()?])?;
        Ok(Pruned { strands: self.read_strands("prune", frame)?, flags })
    }

    /// All strands over the frames of the last run, after `smooth` (trimmed), `fit` or `blend`. Large: for hundreds of
    /// frames read block by block or frame by frame with [`Take::read_sequence_part`].
    pub fn read_sequence(&self, stage: &str) -> Result<StrandSequence, EngineError> {
        self.read_sequence_part(stage, self.last_plan()?.frames, 0..self.strand_count()?)
    }

    /// Some strands over some frames after `smooth` (trimmed), `fit` or `blend`.
    pub fn read_sequence_part(
        &self,
        stage: &str,
        frames: FrameRange,
        strands: Range<usize>,
    ) -> Result<StrandSequence, EngineError> {
        self.store().read_sequence_part(stage, frames, strands)
    }

    /// Particles of each strand; after `blend` the largest over the frames.
    pub(crate) fn read_counts(
        &self,
        stage: &str,
        frames: FrameRange,
        strands: Range<usize>,
    ) -> Result<Vec<u16>, EngineError> {
        self.store().read_counts(stage, frames, strands)
    }
}

fn some_finite<T: Copy>(value: T, finite: impl Fn(T) -> bool) -> Option<T> {
    finite(value).then_some(value)
}

pub(crate) fn transform_from_slice(rows: &[f64]) -> RigidTransform {
    let mut matrix = [[0.0; 4]; 4];
    for (i, value) in rows.iter().take(16).enumerate() {
        matrix[i / 4][i % 4] = *value;
    }
    RigidTransform::from_rows(&matrix)
}
