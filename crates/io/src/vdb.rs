//! OpenVDB files of vectors: one sparse grid `velocity` of `Vec3s` a file, file version 224, tree 5-4-3.
//!
//! Grid coordinates are voxel numbers, (i, j, k) being the voxel's centre; the grid's transform (an `AffineMap`) takes them to
//! the file's space. Values are in units of that space a second (mm/s unless told otherwise, also in the metadata `unit`),
//! turned with it; active voxels are those of the field, the background is zero.
//!
//! The file states neither unit nor axes; they are those of the options' [`Space`].
//!
//! Reference: Museth 2013 (the tree); the layout of the file is that of OpenVDB 10, which the tests read it with.

use std::path::Path;

use glam::{DMat4, DVec3, Vec3};
use strandflow_core::{Grid, SparseVoxels};

use crate::{IoError, Space, error::At, whole_file::write_bytes};

mod read;
mod tree;
mod write;

/// A sparse grid of vectors.
#[derive(Clone, Debug, PartialEq)]
pub struct VectorGrid {
    /// Its name.
    pub name: String,
    /// From voxel numbers (centres) to the file's space.
    pub space_from_index: DMat4,
    /// Active voxels and their values; in no order that means anything.
    pub voxels: Vec<([i32; 3], Vec3)>,
}

/// How a field is written.
#[derive(Clone, Copy, Debug, Default)]
pub struct VdbOptions {
    /// Gravity in the world, any unit; `None` where Z is up already.
    pub gravity: Option<DVec3>,
    /// Unit and axes of the file.
    pub space: Space,
    /// Whether values are zipped. The velocities of a test take shrink by 7 % for half as much time again, so not by
    /// default.
    pub zip: bool,
}

impl VectorGrid {
    /// A velocity field \[mm/s, world\] as a grid in the file's space. Values that are not finite are left out.
    pub fn velocity(field: &SparseVoxels<Vec3>, options: &VdbOptions) -> Self {
        let linear = options.space.linear_from_world(options.gravity);
        let grid = &field.grid;
        let axes = linear * grid.voxel_mm;
        let first = linear * (grid.origin + 0.5 * grid.voxel_mm);
        let [nx, ny, _] = grid.dims;
        let voxel = |(&index, &velocity): (&u32, &Vec3)| {
            let index = index as usize;
            let at = [index % nx, index / nx % ny, index / (nx * ny)].map(|x| x as i32);
            (at, (linear * velocity.as_dvec3()).as_vec3())
        };
        let voxels = field.indices.iter().zip(&field.values).filter(|(_, v)| v.is_finite()).map(voxel).collect();
        let columns = [axes.x_axis, axes.y_axis, axes.z_axis];
        let [x, y, z] = columns.map(|axis| axis.extend(0.0));
        Self { name: "velocity".into(), space_from_index: DMat4::from_cols(x, y, z, first.extend(1.0)), voxels }
    }
}

impl VectorGrid {
    /// The grid as a velocity field \[mm/s, world\]: what [`VectorGrid::velocity`] undoes with the same options.
    ///
    /// # Errors
    /// In words: no voxel, a transform that turns, shears or stretches the voxels against the world, an extent beyond 2³² voxels.
    pub fn to_velocity(&self, options: &VdbOptions) -> Result<SparseVoxels<Vec3>, String> {
        let world_from_file = options.space.linear_from_world(options.gravity).inverse();
        let columns = self.space_from_index.to_cols_array_2d();
        let column = |k: usize| world_from_file * DVec3::new(columns[k][0], columns[k][1], columns[k][2]);
        let (axes, zero) = ([column(0), column(1), column(2)], column(3));
        let voxel_mm = axes[0].x;
        let along = |(axis, expected): (&DVec3, DVec3)| axis.distance(expected) < 1e-4 * voxel_mm.abs();
        let expected = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| axis * voxel_mm);
        if voxel_mm.is_nan() || voxel_mm <= 0.0 || !axes.iter().zip(expected).all(along) {
            return Err("its voxels are not cubes along the take's axes".into());
        }
        let (mut low, mut high) = ([i32::MAX; 3], [i32::MIN; 3]);
        for (at, _) in &self.voxels {
            (low, high) = ([0, 1, 2].map(|k| low[k].min(at[k])), [0, 1, 2].map(|k| high[k].max(at[k])));
        }
        if self.voxels.is_empty() {
            return Err("has no voxel with a velocity".into());
        }
        let dims = [0, 1, 2].map(|k| (i64::from(high[k]) - i64::from(low[k]) + 1) as u64);
        let all = dims.iter().try_fold(1u64, |all, n| all.checked_mul(*n)).filter(|all| *all <= u64::from(u32::MAX));
        all.ok_or_else(|| format!("reaches over {dims:?} voxels"))?;
        let dims = dims.map(|n| n as usize);
        let first = DVec3::new(f64::from(low[0]), f64::from(low[1]), f64::from(low[2])) - 0.5;
        let grid = Grid { origin: zero + first * voxel_mm, voxel_mm, dims };
        let place = |(at, value): &([i32; 3], Vec3)| {
            let index = grid.index([0, 1, 2].map(|k| (at[k] - low[k]) as usize)) as u32;
            (index, (world_from_file * value.as_dvec3()).as_vec3())
        };
        let mut voxels: Vec<(u32, Vec3)> = self.voxels.iter().filter(|(_, v)| v.is_finite()).map(place).collect();
        voxels.sort_unstable_by_key(|(index, _)| *index);
        let (indices, values) = voxels.into_iter().unzip();
        Ok(SparseVoxels { grid, indices, values })
    }
}

/// Writes a velocity field \[mm/s, world\] as OpenVDB. Memory: twice the field.
///
/// # Errors
/// The file cannot be written; it is then as it was before.
pub fn write_velocity_vdb(path: &Path, field: &SparseVoxels<Vec3>, options: &VdbOptions) -> Result<(), IoError> {
    let unit = match options.space.unit_mm {
        1.0 => "mm/s".into(),
        10.0 => "cm/s".into(),
        1000.0 => "m/s".into(),
        other => format!("{other} mm/s"),
    };
    let grid = VectorGrid::velocity(field, options);
    write_bytes(path, &write::file(&grid, &unit, options.zip))
}

/// Reads the grids of vectors in a file: `Vec3s` in trees 5-4-3, raw or zipped, as [`write_velocity_vdb`] writes them; grids of
/// other types are passed over.
///
/// # Errors
/// The file cannot be read, is no OpenVDB file of version 224, is cut or damaged, has no grid of vectors, or one that is
/// compressed with Blosc or has active tiles.
pub fn read_vdb(path: &Path) -> Result<Vec<VectorGrid>, IoError> {
    let data = std::fs::read(path).map_err(IoError::reading(path))?;
    read::file(&data).map_err(|fact| {
        let hint = "write it again, with ZIP compression or none, no half floats, and voxels instead of tiles";
        IoError::content(path, At::FILE, fact, hint)
    })
}

#[cfg(test)]
#[path = "vdb/tests.rs"]
mod tests;
