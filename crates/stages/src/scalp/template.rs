//! A generic head: cranium, face, nape and neck in proportions of anthropometry, placed and scaled by ten numbers.
//!
//! Template axes: x to a side, y to the face, z up; the origin lies in the plane of greatest breadth, in the middle of the
//! head's length. Above it the head is a superellipsoid, flatter at the forehead; below, horizontal sections follow tables
//! of breadth, back (occiput to nape and neck) and front (face, chin, throat). Ears and nose are left out.
//!
//! Reference: Barr 1981 (superquadrics); Taubin 1991 (first-order distance); proportions after Farkas 1994.

use glam::{DMat3, DVec3};
use strandflow_core::RigidTransform;

/// Mean half breadth, half length and height of the vertex above the plane of greatest breadth \[mm\], women and men.
const HALF_BREADTH_MM: f64 = 75.5;
const HALF_LENGTH_MM: f64 = 96.0;
const HEIGHT_MM: f64 = 95.0;
/// Exponent of horizontal sections: 2 is an ellipse.
const SECTION: f64 = 2.2;
/// Exponents of vertical sections towards the forehead and towards the back.
const FOREHEAD: f64 = 2.2;
const CROWN: f64 = 2.5;
/// Heights below the plane of greatest breadth, in units of the vertex height, of the tables below.
const LEVELS: [f64; 9] = [0.0, -0.22, -0.43, -0.64, -0.85, -1.07, -1.28, -1.5, -2.1];
/// Half breadth at the levels, in units of the greatest: temples, mastoids, jaw, neck.
const BREADTH: [f64; 9] = [1.0, 0.99, 0.96, 0.91, 0.85, 0.77, 0.69, 0.66, 0.67];
/// Reach to the back at the levels: occiput, nape, neck.
const BACK: [f64; 9] = [1.02, 1.02, 0.96, 0.88, 0.80, 0.75, 0.73, 0.73, 0.76];
/// Reach to the front at the levels: brow, face, chin, throat.
const FRONT: [f64; 9] = [0.97, 0.97, 0.97, 0.98, 0.98, 0.95, 0.85, 0.35, 0.15];
/// Where the neck is cut off.
const LOWEST: f64 = -2.0;
/// Hairline heights by azimuth from the face, every 15°, in units of the vertex height: forehead, temple, over the ear,
/// behind the ear, nape.
const HAIRLINE: [f64; 13] = [0.61, 0.60, 0.56, 0.46, 0.32, 0.14, 0.0, -0.22, -0.50, -0.70, -0.79, -0.84, -0.86];

/// A placed and scaled head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadShape {
    /// World to template axes, in millimetres.
    template_from_world: RigidTransform,
    /// Half breadth, half length, height \[mm\].
    size: DVec3,
}

/// Position, attitude and size of a head, to be fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadPlacement {
    /// Upright frame to start from: its y axis looks to the face, z up.
    pub upright: DMat3,
    /// Centre \[mm\].
    pub centre: DVec3,
    /// Rotations about x (nod), y (tilt) and z (turn) of the upright frame \[rad\].
    pub turn: DVec3,
    /// Logarithms of the scales of breadth, length and height.
    pub log_scale: DVec3,
}

impl HeadPlacement {
    /// The head placed so.
    pub fn shape(&self) -> HeadShape {
        let turned = DMat3::from_euler(glam::EulerRot::ZXY, self.turn.z, self.turn.x, self.turn.y);
        let world_from_template = RigidTransform { rotation: self.upright * turned, translation: self.centre };
        let scale = DVec3::from_array(self.log_scale.to_array().map(f64::exp));
        HeadShape {
            template_from_world: world_from_template.inverse(),
            size: DVec3::new(HALF_BREADTH_MM, HALF_LENGTH_MM, HEIGHT_MM) * scale,
        }
    }
}

impl HeadShape {
    /// Height of the vertex above the plane of greatest breadth \[mm\].
    pub const MEAN_HEIGHT_MM: f64 = HEIGHT_MM;

    /// Distance to the surface to first order \[mm\], negative inside.
    pub fn distance(&self, point: DVec3) -> f64 {
        const H: f64 = 0.5;
        let q = self.template_from_world.point(point);
        let f = |p: DVec3| self.implicit(p);
        let central = |axis: DVec3| (f(q + axis * H) - f(q - axis * H)) / (2.0 * H);
        let slope = DVec3::new(central(DVec3::X), central(DVec3::Y), central(DVec3::Z)).length();
        f(q) / slope.max(1e-4)
    }

    /// A world point in template axes, in units of half breadth, half length and height.
    pub fn proportions(&self, point: DVec3) -> DVec3 {
        self.template_from_world.point(point) / self.size
    }

    /// World direction of a template direction.
    pub fn direction(&self, template: DVec3) -> DVec3 {
        self.template_from_world.inverse().vector(template)
    }

    /// Distance from `origin` along `direction` (unit) to where the head ends \[mm\]; `origin` lies inside.
    pub fn reach(&self, origin: DVec3, direction: DVec3) -> f64 {
        let outside = |t: f64| self.implicit(self.template_from_world.point(origin + direction * t)) > 0.0;
        let step = 4.0;
        let mut far = step;
        while !outside(far) && far < 400.0 {
            far += step;
        }
        let mut near = far - step;
        for _ in 0..20 {
            let middle = 0.5 * (near + far);
            if outside(middle) { far = middle } else { near = middle }
        }
        0.5 * (near + far)
    }

    /// How far a surface point lies above the usual hairline \[mm\], negative below it (face, around the ears, neck).
    pub fn above_hairline(&self, point: DVec3) -> f64 {
        let p = self.proportions(point);
        let azimuth = p.x.abs().atan2(p.y).to_degrees() / 15.0;
        let i = (azimuth as usize).min(HAIRLINE.len() - 2);
        let t = azimuth - i as f64;
        let line = HAIRLINE[i] * (1.0 - t) + HAIRLINE[i + 1] * t;
        (p.z - line) * self.size.z
    }

    /// Zero on the surface, negative inside, about 1 at twice the size.
    fn implicit(&self, template: DVec3) -> f64 {
        let p = template / self.size;
        let (front, back, breadth) = (at_level(&FRONT, p.z), at_level(&BACK, p.z), at_level(&BREADTH, p.z));
        let lengthwise = if p.y > 0.0 { p.y / front } else { -p.y / back };
        let section = ((p.x.abs() / breadth).powf(SECTION) + lengthwise.powf(SECTION)).powf(1.0 / SECTION);
        if p.z <= 0.0 {
            return (section - 1.0).max((LOWEST - p.z) * 1.5);
        }
        // From the sides backwards the crown's exponent, towards the forehead the flatter one.
        let towards_front = (p.y / p.x.hypot(p.y).max(1e-9)).max(0.0);
        let n = CROWN + (FOREHEAD - CROWN) * towards_front * towards_front;
        (section.powf(n) + p.z.powf(n)).powf(1.0 / n) - 1.0
    }
}

/// A table at a height, linear between its levels.
fn at_level(table: &[f64; 9], z: f64) -> f64 {
    if z >= 0.0 {
        return table[0];
    }
    let i = (1..LEVELS.len() - 1).find(|&i| z >= LEVELS[i]).unwrap_or(LEVELS.len() - 1);
    let t = ((z - LEVELS[i]) / (LEVELS[i - 1] - LEVELS[i])).max(0.0);
    table[i] + (table[i - 1] - table[i]) * t
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_and_reach_agree_on_the_surface() {
        let placement = HeadPlacement {
            upright: DMat3::from_rotation_z(0.7),
            centre: DVec3::new(30.0, -40.0, 1250.0),
            turn: DVec3::new(0.1, -0.05, 0.2),
            log_scale: DVec3::new(0.03, -0.02, 0.04),
        };
        let head = placement.shape();
        for i in 0..200 {
            let t = f64::from(i);
            let direction = DVec3::new((t * 1.7).sin(), (t * 2.3).cos(), (t * 0.9).sin().abs() + 0.05).normalize();
            let reach = head.reach(placement.centre, direction);
            assert!((60.0..120.0).contains(&reach), "{reach}");
            let on = placement.centre + direction * reach;
            assert!(head.distance(on).abs() < 1e-2);
            assert!((head.distance(on + direction * 3.0) - 2.7).abs() < 1.0);
        }
        let place = |proportions: DVec3| head.template_from_world.inverse().point(proportions * head.size);
        assert!(head.above_hairline(place(DVec3::Z)) > 30.0);
        assert!(head.above_hairline(place(DVec3::new(0.0, 0.95, 0.1))) < -20.0);
    }
}
