//! The head: a smooth union of ellipsoids and a neck, as a signed distance and as a closed mesh.
//!
//! Head frame \[mm\]: origin in the middle of the head, z up, the face towards −y, the left ear towards +x.

use glam::{DVec2, DVec3};
use strandflow_core::TriMesh;
use strandflow_geometry::primitives::icosphere;

/// Middle of the cranium in the head frame \[mm\].
pub const CRANIUM: DVec3 = DVec3::new(0.0, 8.0, 18.0);

/// Lower end of the neck in the head frame \[mm\].
pub const NECK_END: f64 = -195.0;

/// Signed distance to the head's surface \[mm\]: negative inside. Exact to first order near the surface.
pub fn distance(p: DVec3) -> f64 {
    let cranium = ellipsoid(p - CRANIUM, DVec3::new(75.0, 94.0, 86.0));
    let face = ellipsoid(p - DVec3::new(0.0, -30.0, -38.0), DVec3::new(60.0, 62.0, 78.0));
    let mut d = smooth_min(cranium, face, 25.0);
    d = smooth_min(d, neck(p), 22.0);
    let nose = ellipsoid(p - DVec3::new(0.0, -92.0, -32.0), DVec3::new(11.0, 15.0, 21.0));
    d = smooth_min(d, nose, 8.0);
    let ear = ellipsoid(DVec3::new(p.x.abs(), p.y, p.z) - DVec3::new(73.0, 0.0, -12.0), DVec3::new(8.0, 17.0, 28.0));
    smooth_min(d, ear, 5.0)
}

/// Outward unit normal of the level of [`distance`] through a point.
pub fn normal(p: DVec3) -> DVec3 {
    gradient(distance, p, distance(p)).normalize_or(DVec3::Z)
}

/// A point moved out along the gradient to a distance of at least `clearance` \[mm\].
pub fn push_out(p: DVec3, clearance: f64) -> DVec3 {
    out_of(distance, p, clearance)
}

/// A point moved out along the gradient of a signed distance.
pub(crate) fn out_of(distance: impl Fn(DVec3) -> f64, mut p: DVec3, clearance: f64) -> DVec3 {
    for _ in 0..3 {
        let d = distance(p);
        if d >= clearance {
            break;
        }
        let g = gradient(&distance, p, d);
        p += g * ((clearance - d) / g.length_squared().max(1e-3));
    }
    p
}

/// Whether hair grows at a point of the surface: above a line from the nape over the ears to the forehead.
pub fn has_hair(p: DVec3) -> bool {
    let u = (p - CRANIUM).normalize_or(DVec3::Z);
    let elevation = u.z.asin().to_degrees();
    let from_back = u.x.abs().atan2(u.y).to_degrees();
    let line = |a: f64| match a {
        a if a < 70.0 => -40.0 + smooth_step(a / 70.0) * 18.0,
        a if a < 115.0 => -22.0 + smooth_step((a - 70.0) / 45.0) * 36.0,
        a => 14.0 + smooth_step((a - 115.0) / 65.0) * 26.0,
    };
    elevation > line(from_back)
}

/// 3t² − 2t³ on 0..1, clamped.
pub(crate) fn smooth_step(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The closed head surface with outward faces: an icosphere of `levels` subdivisions, each vertex moved along its ray
/// from inside the head to the outermost surface (5: 10,242 vertices).
pub fn mesh(levels: usize) -> TriMesh {
    let centre = DVec3::new(0.0, 5.0, -25.0);
    let mut sphere = icosphere(DVec3::ZERO, 1.0, levels);
    for vertex in &mut sphere.vertices {
        *vertex = onto(distance, centre, *vertex, 320.0);
    }
    sphere
}

/// The outermost point within `reach` \[mm\] of a middle in a direction where a signed distance is zero.
pub(crate) fn onto(distance: impl Fn(DVec3) -> f64, centre: DVec3, direction: DVec3, reach: f64) -> DVec3 {
    let mut r = reach;
    for _ in 0..200 {
        let d = distance(centre + direction * r);
        r -= d * 0.5;
        if d.abs() < 1e-4 {
            break;
        }
    }
    centre + direction * r
}

/// Forward differences from the distance `d` at `p`; their error is below 1e-3 on a head.
pub(crate) fn gradient(distance: impl Fn(DVec3) -> f64, p: DVec3, d: f64) -> DVec3 {
    const H: f64 = 0.02;
    let slope = |e: DVec3| (distance(p + e * H) - d) / H;
    DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z))
}

pub(crate) fn ellipsoid(p: DVec3, radii: DVec3) -> f64 {
    let k0 = (p / radii).length();
    let k1 = (p / (radii * radii)).length();
    if k1 < 1e-12 { -radii.min_element() } else { k0 * (k0 - 1.0) / k1 }
}

fn neck(p: DVec3) -> f64 {
    const ROUND: f64 = 16.0;
    let radius = 50.0 + 0.10 * (-60.0 - p.z).max(0.0) - ROUND;
    let side = DVec2::new(p.x * 0.96, p.y - 14.0).length() - radius;
    let ends = (p.z + 40.0).max(NECK_END - p.z) + ROUND;
    side.max(ends).min(0.0) + DVec2::new(side.max(0.0), ends.max(0.0)).length() - ROUND
}

/// The smooth minimum with a cubic blend over `k` mm (Quilez 2013).
pub(crate) fn smooth_min(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - h * h * h * k / 6.0
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[test]
    fn the_mesh_is_closed_faces_outward_and_lies_on_the_surface() {
        let mesh = mesh(4);
        let mut edges = BTreeMap::new();
        for face in &mesh.faces {
            for k in 0..3 {
                let (a, b) = (face[k], face[(k + 1) % 3]);
                *edges.entry((a.min(b), a.max(b))).or_insert(0i32) += if a < b { 1 } else { -1 };
            }
        }
        assert!(edges.values().all(|&balance| balance == 0), "every edge is walked once each way");
        let volume: f64 = (0..mesh.faces.len())
            .map(|f| {
                let [a, b, c] = mesh.corners(f);
                a.dot(b.cross(c)) / 6.0
            })
            .sum();
        assert!(volume > 2.5e6 && volume < 6.5e6, "{volume} mm³ is no head");
        assert!(mesh.vertices.iter().all(|&v| distance(v).abs() < 0.01));
    }

    #[test]
    fn distance_is_first_order_exact_at_the_surface() {
        for v in mesh(2).vertices {
            let n = normal(v);
            for step in [-0.5, 0.5] {
                let d = distance(v + n * step);
                assert!((d - step).abs() < 0.2, "{d} for {step} at {v}");
            }
            assert!(distance(push_out(v - n * 3.0, 1.0)) > 0.9);
        }
    }
}
