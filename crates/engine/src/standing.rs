//! What of a take stands still below the head, from its results.

use strandflow_core::TriMesh;
use strandflow_geometry::signed_distance::SignedDistance;
use strandflow_stages::animate::Standing;

use crate::{EngineError, Item, Performance};

/// Frames that are looked at, spread over the take.
const FRAMES: usize = 9;

/// Voxels of the head's distance here \[mm\], and how far around the head it is sampled.
const HEAD_VOXEL_MM: f64 = 6.0;
const HEAD_MARGIN_MM: f64 = 30.0;

impl Performance {
    /// Shoulders and chest, where the hulls hold any below the head: their surface in the world \[mm\] and their size
    /// \[litres\]. `None` also where hulls or hair volumes are no longer there.
    ///
    /// # Errors
    /// `Store`.
    pub fn standing(&self) -> Result<Option<(TriMesh, f64)>, EngineError> {
        let frames = self.frames();
        let count = FRAMES.min(frames.len());
        let spread = (0..count).map(|k| frames.start + k * (frames.len() - 1) / (count - 1).max(1));
        let is_there = |frame: &usize| {
            ["hull/hull", "field/field"]
                .iter()
                .all(|phase| self.store().record(&Item::Frame(*frame).key(phase)).is_some())
        };
        let scalp = self.scalp()?;
        let head = SignedDistance::from_mesh(&scalp.mesh, HEAD_VOXEL_MM, HEAD_MARGIN_MM);
        let down = self.gravity().normalize_or_zero();
        let (mut standing, mut lowest) = (None, f64::NEG_INFINITY);
        for frame in spread.filter(is_there) {
            let (hull, pose) = (self.hull(frame)?, self.pose(frame)?);
            let hair: Vec<u32> = self.store().read_all(&format!("field/{frame:06}/voxel"))?;
            let head_from_world = pose.inverse();
            let standing = standing.get_or_insert_with(|| Standing::new(&hull));
            standing.see(&hull, &hair, |point| head.distance(head_from_world.point(point)));
            lowest = scalp.mesh.vertices.iter().map(|v| pose.point(*v).dot(down)).fold(lowest, f64::max);
        }
        Ok(standing.and_then(|standing| standing.surface(|point| point.dot(down) > lowest)))
    }
}
