//! Hairs as a camera sees them: where, how wide, and with what light.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::{DVec3, Vec2, Vec3};
use strandflow_core::Camera;
use strandflow_geometry::project::project;

use crate::{
    chance::Chance,
    dome::Dome,
    fibre::Inclination,
    groom::{Grown, Point, touched},
    light::LightRig,
    scattering::{Crowd, SHADES, Scattering, decayed},
    shadow::Shadow,
    subject::Hair,
};

/// Share of scattered light that finds a way on and back (Zinke 2008, d_f and d_b: 0.6 to 0.8 for human hair).
const SPREAD: f32 = 0.7;

/// Spread of the shade among strands and among the children of one \[levels\]. Without it hair looks like plastic, with
/// twice as much like straw.
const SHADE_OF_STRAND: f32 = 1.1;
const SHADE_OF_CHILD: f32 = 1.1;

/// Share of a hair over which its tip thins out, and what is left there.
const TIP: f32 = 0.3;
const TIP_WIDTH: f32 = 0.25;

/// A point of a hair in the picture.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Vertex {
    /// Image point \[px\]; NaN behind the camera.
    pub at: Vec2,
    /// Distance along the optical axis \[mm\].
    pub depth: f32,
    /// Thickness \[px\].
    pub width: f32,
    /// What it moves while the shutter is open \[px\].
    pub motion: Vec2,
}

/// What lights hairs.
pub(crate) struct Lighting<'a> {
    /// The lights.
    pub rig: &'a LightRig,
    /// One a light.
    pub shadows: &'a [Shadow],
    /// Light from around.
    pub dome: &'a Dome,
    /// How fibres scatter.
    pub scattering: &'a Scattering,
}

/// The eye.
pub(crate) struct Eye<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Where it is, world \[mm\].
    pub centre: Vec3,
    /// Share of a frame for which the shutter is open.
    pub shutter: f32,
    /// Thickness of a hair \[mm\].
    pub width_mm: f32,
    /// Chance of shades.
    pub seed: u64,
}

/// The light of all hairs. What a point returns is worked out when it is first seen: most of the hair is under other hair, and
/// never is.
pub(crate) struct Threads<'a> {
    hair: &'a Hair,
    grown: &'a Grown,
    lighting: &'a Lighting<'a>,
    eye: &'a Eye<'a>,
    /// Of each hair, those of a strand after one another.
    shades: Vec<u8>,
    density: usize,
    /// Light of each point, or [`UNKNOWN`]. Whoever works it out gets the same, so that no one needs to wait.
    lights: Vec<AtomicU64>,
}

/// Light that was not worked out yet.
const UNKNOWN: u64 = u64::MAX;

impl<'a> Threads<'a> {
    /// Nothing worked out yet.
    pub(crate) fn new(hair: &'a Hair, grown: &'a Grown, lighting: &'a Lighting, eye: &'a Eye) -> Self {
        let density = grown.density;
        let shades = (0..grown.counts.len() * density).map(|i| shade(eye.seed, hair.names[i / density], i % density));
        let lights = touched(grown.points.len(), || AtomicU64::new(UNKNOWN));
        Self { shades: shades.collect(), density, hair, grown, lighting, eye, lights }
    }

    /// Radiance of a point towards the eye, linear RGB; black before it was lit.
    pub(crate) fn light_of(&self, point: u32) -> Vec3 {
        unpacked(self.lights[point as usize].load(Ordering::Relaxed))
    }

    /// Lights points in the order in which they lie along hairs, so that what one reads is at hand for the next. Returns how
    /// many were not yet lit.
    pub(crate) fn light_up(&self, ascending: &[u32]) -> usize {
        /// Points that are fetched together: they lie all over the memory, and are waited for together.
        const AT_HAND: usize = 64;
        let (mut strand, mut count) = (0, 0);
        let mut unlit: Vec<Place> = Vec::with_capacity(AT_HAND);
        for points in ascending.chunks(AT_HAND) {
            unlit.clear();
            let is_unlit = |point: &&u32| self.lights[**point as usize].load(Ordering::Relaxed) == UNKNOWN;
            unlit.extend(points.iter().filter(is_unlit).map(|&point| self.place(&mut strand, point as usize)));
            for place in &unlit {
                self.lights[place.point].store(packed(self.light(place)), Ordering::Relaxed);
            }
            count += unlit.len();
        }
        count
    }

    /// Where a point is; its strand is sought from `strand` on.
    fn place(&self, strand: &mut usize, point: usize) -> Place {
        let starts = &self.grown.starts;
        if starts[*strand + 1] <= point {
            *strand += starts[*strand + 1..].partition_point(|start| *start <= point);
        }
        let count = self.grown.counts[*strand];
        let within = point - starts[*strand];
        let k = within % count;
        let points = &self.grown.points;
        let along =
            points[if k + 1 < count { point + 1 } else { point }] - points[if k > 0 { point - 1 } else { point }];
        Place { point, strand: *strand, child: within / count, k, at: points[point], along }
    }

    fn light(&self, place: &Place) -> Vec3 {
        let tangent = place.along.normalize_or(Vec3::Z);
        let to_eye = (self.eye.centre - place.at).normalize_or(Vec3::Z);
        let shade = usize::from(self.shades[place.strand * self.density + place.child]);
        let light = self.lighting.returned(place.at, tangent, to_eye, shade);
        let own = self.hair.offsets[place.strand]..self.hair.offsets[place.strand + 1];
        match self.hair.tint.get(own) {
            Some(tint) if !tint.is_empty() => {
                light * tint[place.k * (tint.len() - 1) / (self.grown.counts[place.strand] - 1)]
            }
            _ => light,
        }
    }
}

/// A point of a hair to be lit.
struct Place {
    point: usize,
    strand: usize,
    child: usize,
    /// Its number along the hair.
    k: usize,
    at: Vec3,
    /// From the point before it to the one after it.
    along: Vec3,
}

/// Three numbers that are not negative in one word, 21 bits each: exact to a part in 16,384.
fn packed(light: Vec3) -> u64 {
    let bits = |v: f32| u64::from((v.max(0.0).to_bits() + (1 << 9)) >> 10);
    bits(light.x) | bits(light.y) << 21 | bits(light.z) << 42
}

/// Back from [`packed`].
fn unpacked(word: u64) -> Vec3 {
    let of = |from: u32| f32::from_bits((word >> from & 0x1f_ffff) as u32 * (1 << 10));
    if word == UNKNOWN { Vec3::ZERO } else { Vec3::new(of(0), of(21), of(42)) }
}

/// The shade of a child.
fn shade(seed: u64, name: u32, child: usize) -> u8 {
    let own = seed ^ u64::from(name) << 20 ^ 0x5ade;
    let of_strand = Chance::of(own, 0).normal() * SHADE_OF_STRAND;
    let level = of_strand + Chance::of(own, child as u64 + 1).normal() * SHADE_OF_CHILD;
    (level + 0.5 * SHADES as f32).clamp(0.0, SHADES as f32 - 1.0) as u8
}

impl Lighting<'_> {
    /// Radiance that a hair returns towards an eye: each light through the hair before it, once by the fibre itself and
    /// spread by the crowd around it; and the dome.
    fn returned(&self, p: Vec3, tangent: Vec3, to_eye: Vec3, shade: usize) -> Vec3 {
        let crowd = &self.scattering.crowds[shade];
        let eye = Inclination::of_sine(tangent.dot(to_eye));
        let mut sum = Vec3::ZERO;
        for (light, shadow) in self.rig.lights.iter().zip(self.shadows) {
            let incline = Inclination::of_sine(tangent.dot(light.towards));
            let across = (incline.cos * eye.cos).max(1e-4);
            let cos_phi = (light.towards.dot(to_eye) - incline.sin * eye.sin) / across;
            let (single, even) = self.scattering.towards(shade, incline, eye, cos_phi.clamp(-1.0, 1.0));
            sum += light.irradiance * crowd.spread(shadow.depth(p), single, even);
        }
        sum + self.rig.dome * self.dome.seen(p) * (crowd.albedo + crowd.backward * SPREAD)
    }
}

impl Crowd {
    /// Light sent to the eye through hair of an optical depth: hairs before a point are Poisson distributed, so that of n
    /// expected ones none is met with probability exp(−n), and light that each passes on with share f arrives with
    /// exp(−n (1 − f)), all but exp(−n) of it scattered (dual scattering, Zinke 2008, in closed form).
    fn spread(&self, depth: f32, single: Vec3, even: f32) -> Vec3 {
        let share = decayed((self.forward - 1.0).extend(-1.0) * depth);
        let (passed, direct) = (share.truncate(), share.w);
        let scattered = (passed - direct).max(Vec3::ZERO);
        single * direct + even * SPREAD * (self.albedo * scattered + self.backward * passed)
    }
}

impl Eye<'_> {
    /// Places a hair in the picture; its tip thins out.
    pub(crate) fn place(&self, hair: &[Point], vertices: &mut [Vertex]) {
        let last = hair.len().saturating_sub(1).max(1) as f32;
        for (k, (p, vertex)) in hair.iter().zip(vertices).enumerate() {
            let from_tip = (1.0 - k as f32 / last) / TIP;
            *vertex = self.seen(p, self.width_mm * (TIP_WIDTH + (1.0 - TIP_WIDTH) * from_tip.min(1.0)));
        }
    }

    fn seen(&self, p: &Point, width_mm: f32) -> Vertex {
        let at = p.at.as_dvec3();
        let image = |at: DVec3| project(self.camera, at).map_or(Vec2::NAN, |p| p.as_vec2());
        let depth = strandflow_geometry::project::depth(self.camera, at) as f32;
        let here = image(at);
        let motion = p.motion * self.shutter;
        let motion = if motion == Vec3::ZERO { Vec2::ZERO } else { image(at + motion.as_dvec3()) - here };
        let width = width_mm * self.camera.focal[0] as f32 / depth;
        Vertex { at: here, depth, width, motion }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_light_is_as_good_as_it_was() {
        for light in
            [Vec3::ZERO, Vec3::new(1e-9, 0.3, 1.0), Vec3::new(3.2, 250.0, 0.000_7), Vec3::splat(f32::MAX / 2.0)]
        {
            let back = unpacked(packed(light));
            assert!((back - light).abs().cmple(light / 16_000.0).all(), "{back} for {light}");
        }
        assert_ne!(packed(Vec3::splat(f32::INFINITY)), UNKNOWN);
    }
}
