//! Hairs as a camera sees them: where, how wide, and with what light.

use std::sync::OnceLock;

use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use strandflow_core::Camera;
use strandflow_geometry::project::project;

use crate::{
    chance::Chance,
    dome::Dome,
    fibre::Inclination,
    groom::{Grown, Point, slices, touched},
    light::LightRig,
    scattering::{Crowd, SHADES, Scattering},
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

/// All hairs as an eye sees them. What light a point returns is worked out when it is first asked for: most of the hair is
/// under other hair, and is never seen.
pub(crate) struct Threads<'a> {
    hair: &'a Hair,
    grown: &'a Grown,
    lighting: &'a Lighting<'a>,
    eye: &'a Eye<'a>,
    /// Of each hair, those of a strand after one another.
    shades: Vec<u8>,
    density: usize,
    /// Points in the picture, in the order of `grown`.
    pub vertices: Vec<Vertex>,
    colours: Vec<OnceLock<Vec3>>,
}

impl<'a> Threads<'a> {
    /// Places hairs in the picture.
    pub(crate) fn new(hair: &'a Hair, grown: &'a Grown, lighting: &'a Lighting, eye: &'a Eye) -> Self {
        let mut vertices: Vec<Vertex> = touched(grown.points.len(), Vertex::default);
        slices(&mut vertices, &grown.starts).into_par_iter().enumerate().for_each(|(n, out)| {
            let points = &grown.points[grown.starts[n]..grown.starts[n + 1]];
            let last = grown.counts[n].saturating_sub(1);
            for (k, (p, out)) in points.iter().zip(out).enumerate() {
                let from_tip = (1.0 - (k % (last + 1)) as f32 / last as f32) / TIP;
                *out = eye.seen(p, eye.width_mm * (TIP_WIDTH + (1.0 - TIP_WIDTH) * from_tip.min(1.0)));
            }
        });
        let density = grown.density;
        let shades = (0..grown.counts.len() * density).map(|i| shade(eye.seed, hair.names[i / density], i % density));
        let colours = touched(vertices.len(), OnceLock::new);
        Self { shades: shades.collect(), density, hair, grown, lighting, eye, vertices, colours }
    }

    /// Radiance of a point towards the eye, linear RGB.
    pub(crate) fn colour(&self, point: usize) -> Vec3 {
        *self.colours[point].get_or_init(|| self.light(point))
    }

    fn light(&self, point: usize) -> Vec3 {
        let strand = self.grown.starts.partition_point(|start| *start <= point) - 1;
        let (count, within) = (self.grown.counts[strand], point - self.grown.starts[strand]);
        let (child, k) = (within / count, within % count);
        let hair = &self.grown.points[point - k..point - k + count];
        let tangent = (hair[(k + 1).min(count - 1)].at - hair[k.saturating_sub(1)].at).normalize_or(Vec3::Z);
        let to_eye = (self.eye.centre - hair[k].at).normalize_or(Vec3::Z);
        let shade = usize::from(self.shades[strand * self.density + child]);
        let light = self.lighting.returned(hair[k].at, tangent, to_eye, shade);
        let own = self.hair.offsets[strand]..self.hair.offsets[strand + 1];
        match self.hair.tint.get(own) {
            Some(tint) if !tint.is_empty() => light * tint[k * (tint.len() - 1) / (count - 1)],
            _ => light,
        }
    }
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
        let direct = (-depth).exp();
        let passed = ((self.forward - 1.0) * depth).exp();
        let scattered = (passed - direct).max(Vec3::ZERO);
        single * direct + even * SPREAD * (self.albedo * scattered + self.backward * passed)
    }
}

impl Eye<'_> {
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
