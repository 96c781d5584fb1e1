//! What is rendered: strands and a head, with their motion.

use glam::{DVec3, Vec3};
use strandflow_core::{RigidTransform, TriMesh};

use crate::RenderError;

/// Strands of one moment, ragged, root first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hair {
    /// Points of all strands, world \[mm\].
    pub points: Vec<Vec3>,
    /// What each point moves from one frame to the next \[mm\]; as long as `points`.
    pub motion: Vec<Vec3>,
    /// Colour of each point, linear RGB, by which the light of the fibre is multiplied; empty where all is of one colour.
    pub tint: Vec<Vec3>,
    /// Where each strand begins in `points`; one more than strands.
    pub offsets: Vec<usize>,
    /// A name of each strand that it keeps over the frames: its children and its shade follow from it.
    pub names: Vec<u32>,
}

impl Hair {
    /// Adds a strand: points \[mm\], and their motion from one frame to the next \[mm\], empty where it stands still.
    pub fn push(&mut self, name: u32, points: &[Vec3], motion: &[Vec3]) {
        if self.offsets.is_empty() {
            self.offsets.push(0);
        }
        self.points.extend_from_slice(points);
        self.motion.extend((0..points.len()).map(|k| motion.get(k).copied().unwrap_or(Vec3::ZERO)));
        self.offsets.push(self.points.len());
        self.names.push(name);
    }

    /// Number of strands.
    pub fn strand_count(&self) -> usize {
        self.names.len()
    }

    /// The points of a strand.
    pub fn strand(&self, strand: usize) -> &[Vec3] {
        &self.points[self.offsets[strand]..self.offsets[strand + 1]]
    }

    /// # Errors
    /// There is no strand of two points, or one has a position that is not finite.
    pub(crate) fn check(&self) -> Result<(), RenderError> {
        for strand in 0..self.strand_count() {
            let range = self.offsets[strand]..self.offsets[strand + 1];
            if let Some(point) = range.clone().find(|&i| !(self.points[i].is_finite() && self.motion[i].is_finite())) {
                return Err(RenderError::NotFinite { strand, point: point - range.start });
            }
        }
        let drawn = (0..self.strand_count()).any(|n| self.strand(n).len() > 1);
        if drawn { Ok(()) } else { Err(RenderError::NoHair) }
    }
}

/// The head under the hair.
pub struct Head<'a> {
    /// Its surface, head space \[mm\].
    pub mesh: &'a TriMesh,
    /// Where the head is.
    pub world_from_head: RigidTransform,
    /// Where it is one frame later; the same where it stands still.
    pub next_world_from_head: RigidTransform,
}

/// Strands with a head, or without.
pub struct Subject<'a> {
    /// The strands.
    pub hair: &'a Hair,
    /// The head; it hides what is behind it and throws shadow.
    pub head: Option<Head<'a>>,
}

impl Subject<'_> {
    /// A point inside the head that moves with it \[mm\]: from it roots grow outwards.
    pub(crate) fn middle(&self) -> DVec3 {
        let mean = |points: &mut dyn ExactSizeIterator<Item = DVec3>| {
            let count = points.len().max(1) as f64;
            points.sum::<DVec3>() / count
        };
        let roots: Vec<DVec3> =
            (0..self.hair.strand_count()).filter_map(|n| self.hair.strand(n).first().map(|p| p.as_dvec3())).collect();
        match &self.head {
            Some(head) if !head.mesh.vertices.is_empty() => {
                head.world_from_head.point(mean(&mut head.mesh.vertices.iter().copied()))
            }
            _ => mean(&mut roots.iter().copied()),
        }
    }

    /// The turn of the head against head space.
    pub(crate) fn world_from_head(&self) -> RigidTransform {
        self.head.as_ref().map_or(RigidTransform::IDENTITY, |head| head.world_from_head)
    }
}
