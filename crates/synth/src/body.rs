//! The body below the neck: shoulders and chest that stand still, as a signed distance and as a closed mesh, in the world.

use glam::DVec3;
use strandflow_core::{RigidTransform, TriMesh};
use strandflow_geometry::primitives::icosphere;

use crate::head;
use crate::motion::STAND;
use crate::spec::SynthSpec;

/// Radius of the shoulders \[mm\].
const ROUND: f64 = 52.0;

/// A middle from which all of the surface is seen, below the head's middle \[mm\].
const INSIDE: DVec3 = DVec3::new(0.0, 22.0, -330.0);

/// Shoulders and chest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Half the breadth over the shoulders \[mm\].
    half: f64,
}

impl Body {
    /// That of a spec; `None` where it asks for none.
    pub fn of(spec: &SynthSpec) -> Option<Self> {
        (spec.body.breadth_mm > 0.0).then_some(Self { half: 0.5 * spec.body.breadth_mm })
    }

    /// Signed distance to the surface from a point of the world \[mm\]: negative inside. Exact to first order near the surface.
    pub fn distance(&self, p: DVec3) -> f64 {
        let p = p - STAND;
        let chest = head::ellipsoid(p - DVec3::new(0.0, 25.0, -430.0), DVec3::new(0.78 * self.half, 108.0, 262.0));
        let reach = self.half - ROUND;
        let along = DVec3::new((p.x).clamp(-reach, reach), 20.0, -232.0);
        let shoulders = p.distance(along) - ROUND;
        let collar = head::ellipsoid(p - DVec3::new(0.0, 22.0, -190.0), DVec3::new(92.0, 60.0, 42.0));
        head::smooth_min(head::smooth_min(chest, shoulders, 60.0), collar, 40.0)
    }

    /// Outward unit normal of the level of [`Self::distance`] through a point.
    pub fn normal(&self, p: DVec3) -> DVec3 {
        head::gradient(|p| self.distance(p), p, self.distance(p)).normalize_or(DVec3::Z)
    }

    /// The closed surface with outward faces, world \[mm\]: an icosphere of `levels` subdivisions, each vertex moved along its
    /// ray from inside.
    pub fn mesh(&self, levels: usize) -> TriMesh {
        let centre = STAND + INSIDE;
        let mut sphere = icosphere(DVec3::ZERO, 1.0, levels);
        for vertex in &mut sphere.vertices {
            *vertex = head::onto(|p| self.distance(p), centre, *vertex, 2.5 * self.half + 400.0);
        }
        sphere
    }
}

/// What hair lies on, seen from the head: the head, and the body where it is then.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Skin {
    /// The body.
    pub body: Option<Body>,
    /// The head's pose.
    pub world_from_head: RigidTransform,
}

impl Skin {
    /// Signed distance from a point of the head frame to the nearer surface \[mm\].
    pub fn distance(&self, p: DVec3) -> f64 {
        head::distance(p).min(self.over_body(p))
    }

    /// Height of a point of the head frame over the body, negative inside \[mm\].
    fn over_body(&self, p: DVec3) -> f64 {
        self.body.map_or(f64::INFINITY, |body| body.distance(self.world_from_head.point(p)))
    }

    /// A point of the head frame moved out of head and body to a distance of at least `clearance` \[mm\].
    pub fn push_out(&self, p: DVec3, clearance: f64) -> DVec3 {
        let p = head::push_out(p, clearance);
        if self.over_body(p) >= clearance { p } else { head::out_of(|p| self.over_body(p), p, clearance) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mesh_lies_on_the_surface_and_carries_the_neck() {
        let body = Body { half: 200.0 };
        let mesh = body.mesh(4);
        assert!(mesh.vertices.iter().all(|&v| body.distance(v).abs() < 0.05));
        assert!(body.distance(STAND + DVec3::Z * head::NECK_END) < 0.0, "the neck ends inside");
        assert!(body.distance(STAND + DVec3::Z * -60.0) > 50.0, "the chin is free");
        for v in body.mesh(2).vertices {
            let d = body.distance(v + body.normal(v) * 5.0);
            assert!((d - 5.0).abs() < 1.0, "{d} at {v}");
        }
    }
}
