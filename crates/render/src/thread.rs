//! Hairs as a camera sees them: where, how wide, and with what light.

use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use strandflow_core::Camera;
use strandflow_geometry::project::project;

use crate::{
    chance::Chance,
    dome::Dome,
    fibre::Inclination,
    groom::{Grown, Point, slices},
    light::LightRig,
    scattering::{Crowd, SHADES, Scattering},
    shadow::Shadow,
    subject::Hair,
};

/// Share of scattered light that finds a way on and back (Zinke 2008, d_f and d_b: 0.6 to 0.8 for human hair).
const SPREAD: f32 = 0.7;

/// Spread of the shade among strands and among the children of one \[levels\]. Without it hair looks like plastic, with
/// twice as much like straw.
const SHADE_OF_STRAND: f32 = 0.75;
const SHADE_OF_CHILD: f32 = 0.9;

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
    /// Radiance, linear RGB.
    pub colour: Vec3,
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
    /// Share of a frame for which the shutter is open.
    pub shutter: f32,
    /// Thickness of a hair \[mm\].
    pub width_mm: f32,
    /// Chance of shades.
    pub seed: u64,
}

/// All hairs' points as `eye` sees them, in the order of `grown`.
pub(crate) fn threads(hair: &Hair, grown: &Grown, lighting: &Lighting, eye: &Eye) -> Vec<Vertex> {
    let mut out = vec![Vertex::default(); grown.points.len()];
    slices(&mut out, &grown.starts).into_par_iter().enumerate().for_each(|(n, out)| {
        let count = grown.counts[n];
        if count == 0 {
            return;
        }
        let points = &grown.points[grown.starts[n]..grown.starts[n + 1]];
        let own = eye.seed ^ u64::from(hair.names[n]) << 20 ^ 0x5ade;
        let of_strand = Chance::of(own, 0).normal() * SHADE_OF_STRAND;
        for (child, (points, out)) in points.chunks(count).zip(out.chunks_mut(count)).enumerate() {
            let level = of_strand + Chance::of(own, child as u64 + 1).normal() * SHADE_OF_CHILD;
            let shade = (level + 0.5 * SHADES as f32).clamp(0.0, SHADES as f32 - 1.0) as usize;
            lighting.light(points, shade, eye, out);
            if !hair.tint.is_empty() {
                tint(&hair.tint[hair.offsets[n]..hair.offsets[n + 1]], out);
            }
        }
    });
    out
}

fn tint(colours: &[Vec3], out: &mut [Vertex]) {
    let pieces = (out.len() - 1) / (colours.len() - 1).max(1);
    out.iter_mut().enumerate().for_each(|(k, v)| v.colour *= colours[(k / pieces.max(1)).min(colours.len() - 1)]);
}

impl Lighting<'_> {
    /// Light and image of one hair.
    fn light(&self, points: &[Point], shade: usize, eye: &Eye, out: &mut [Vertex]) {
        let last = points.len() - 1;
        let centre = eye.camera.centre_in_world().as_vec3();
        for (k, (p, out)) in points.iter().zip(out).enumerate() {
            let tangent = (points[(k + 1).min(last)].at - points[k.saturating_sub(1)].at).normalize_or(Vec3::Z);
            let from_tip = (1.0 - k as f32 / last as f32) / TIP;
            let width_mm = eye.width_mm * (TIP_WIDTH + (1.0 - TIP_WIDTH) * from_tip.min(1.0));
            *out = eye.seen(p, width_mm);
            out.colour = self.returned(p.at, tangent, (centre - p.at).normalize_or(Vec3::Z), shade);
        }
    }

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
        Vertex { at: here, depth, width, motion, colour: Vec3::ZERO }
    }
}
