//! Texture coordinates of roots: the scalp unwrapped as a sphere.
//!
//! The centre is that of the sphere that fits the roots best. Seen from it with Z up, u runs once around the head
//! (u = 0.5 + atan2(y, x) / 2π, the seam on the side of −x) and v from the lowest point (0) to the crown (1),
//! v = 1 − polar angle / π. Roots are taken from the first frame, so the coordinates stay with the strands.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec3, Vec2, Vec3};

/// Texture coordinates in \[0, 1\]² of roots \[any unit, Z up\], one a root.
pub fn root_uvs(roots: &[Vec3]) -> Vec<Vec2> {
    let centre = sphere_centre(roots);
    let uv = |root: &Vec3| {
        let seen = (root.as_dvec3() - centre).normalize_or(DVec3::Z);
        let u = 0.5 + seen.y.atan2(seen.x) / TAU;
        let v = 1.0 - seen.z.clamp(-1.0, 1.0).acos() / PI;
        Vec2::new(u as f32, v as f32)
    };
    roots.iter().map(uv).collect()
}

/// The centre of the sphere that fits points best in the algebraic sense (|p − c|² constant); the points' mean where they
/// lie too nearly in a plane to tell, zero without points.
pub fn sphere_centre(points: &[Vec3]) -> DVec3 {
    if points.is_empty() {
        return DVec3::ZERO;
    }
    let per_point = 1.0 / points.len() as f64;
    let mean = points.iter().map(|p| p.as_dvec3()).sum::<DVec3>() * per_point;
    // With points q about their mean, least squares of |q|² = 2 q·c + k gives 2 (Σ q qᵀ) c = Σ q |q|².
    let (mut spread, mut pull) = (DMat3::ZERO, DVec3::ZERO);
    for q in points.iter().map(|p| p.as_dvec3() - mean) {
        spread += DMat3::from_cols(q * q.x, q * q.y, q * q.z) * per_point;
        pull += q * q.length_squared() * per_point;
    }
    let size = spread.col(0).x + spread.col(1).y + spread.col(2).z;
    // A scalp of half a sphere has 0.02 here; below a thousandth of that the points are a plane and the centre is noise.
    if spread.determinant() <= 2e-5 * size.powi(3) {
        return mean;
    }
    mean + spread.inverse() * pull * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points on the upper half of a sphere, away from its rim's regularity.
    fn scalp(centre: DVec3, radius: f64) -> Vec<Vec3> {
        let at = |i: usize| {
            let (z, around) = ((i as f64 + 0.5) / 200.0, i as f64 * 2.4);
            let ring = (1.0 - z * z).sqrt();
            (centre + radius * DVec3::new(ring * around.cos(), ring * around.sin(), z)).as_vec3()
        };
        (0..200).map(at).collect()
    }

    #[test]
    fn the_centre_of_a_half_sphere_is_found() {
        let centre = DVec3::new(10.0, -20.0, 1500.0);
        assert!(sphere_centre(&scalp(centre, 95.0)).distance(centre) < 1e-2);
    }

    #[test]
    fn uvs_run_around_and_up() {
        let uvs = root_uvs(&scalp(DVec3::new(1.0, 2.0, 3.0), 95.0));
        assert!(uvs.iter().all(|uv| (0.0..=1.0).contains(&uv.x) && (0.499..=1.0).contains(&uv.y)));
        assert!(uvs.windows(2).all(|w| w[1].y > w[0].y), "v rises with height");
        assert!(uvs.iter().any(|uv| uv.x < 0.05) && uvs.iter().any(|uv| uv.x > 0.95));
    }

    #[test]
    fn roots_in_a_line_or_none_still_have_finite_coordinates() {
        let line: Vec<Vec3> = (0..5).map(|i| Vec3::X * i as f32).collect();
        assert!(root_uvs(&line).iter().all(|uv| uv.is_finite()));
        assert!(root_uvs(&[]).is_empty());
    }
}
