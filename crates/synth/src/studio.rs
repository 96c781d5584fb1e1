//! Strands and head in the studio: the light that reaches them, and what they return towards a camera.

use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;
use strandflow_core::{Camera, RigidTransform, TriMesh};
use strandflow_geometry::project::project;

use crate::body::Body;
use crate::head::{has_hair, normal};
use crate::light::{Density, Light, density_grid, fibre, lights};
use crate::motion::hand;
use crate::random::{mix, smooth_noise};
use crate::raster::Vertex;
use crate::scene::Scene;
use crate::spec::Style;

/// Strands and head with the light that reaches them, before a camera looks.
pub(crate) struct Lit {
    /// The strands.
    pub fibres: Vec<Fibre>,
    /// Per vertex of the head: position and colour.
    pub skin: Vec<(DVec3, Vec3)>,
    /// The head's pose.
    pub world_from_head: RigidTransform,
    /// Middle of the hand, world \[mm\].
    pub hand: DVec3,
    /// The lights, world.
    pub lights: [Light; 4],
}

/// A strand as it is drawn.
pub(crate) struct Fibre {
    points: Vec<DVec3>,
    light: Vec<[f32; 4]>,
    colour: Vec3,
    pieces: usize,
    seed: u64,
}

/// A camera and the sub-samples of its pixels.
pub(crate) struct Lens<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Sub-samples along each side of a pixel.
    pub ss: usize,
}

impl Lens<'_> {
    /// A point as the camera sees it.
    pub(crate) fn vertex(&self, p: DVec3, colour: Vec3) -> Vertex {
        let depth = self.camera.camera_from_world.point(p).z as f32;
        let at = project(self.camera, p).unwrap_or(DVec2::splat(-1e6)) * self.ss as f64;
        Vertex { at: at.as_vec2(), depth, colour }
    }

    /// A bound of the width of all ribbons in samples.
    pub(crate) fn width(&self, width_mm: f64, fibres: &[Fibre]) -> f32 {
        let nearest = fibres
            .iter()
            .filter_map(|f| f.points.first())
            .map(|&p| self.camera.camera_from_world.point(p).z)
            .fold(f64::INFINITY, f64::min);
        (width_mm * self.camera.focal[0] * self.ss as f64 / (nearest - 400.0).max(50.0)) as f32
    }
}

impl Scene {
    /// Strands and head with the light that reaches them.
    pub(crate) fn lit(&self, frame: f64) -> Lit {
        let (strands, world_from_head) = self.moment(frame);
        let density = Density::new(&self.spec, &strands, &self.head_opacity, density_grid(&self.spec));
        let to_head = world_from_head.inverse();
        let lights = lights();
        let local: Vec<Vec3> = lights.iter().map(|l| to_head.vector(l.towards.as_dvec3()).as_vec3()).collect();
        let reaching = |p: DVec3| -> [f32; 4] {
            std::array::from_fn(|l| lights[l].strength * density.transmittance(p.as_vec3(), local[l]))
        };
        let pieces = if self.spec.groom.style == Style::Straight { 1 } else { 2 };
        let fibres = strands
            .par_iter()
            .enumerate()
            .map(|(i, strand)| {
                let fine = rounded(strand, pieces);
                // Light changes slowly along a strand: every second point is enough.
                let light: Vec<[f32; 4]> = strand.iter().step_by(2).map(|&p| reaching(p)).collect();
                Fibre {
                    points: fine.iter().map(|&p| world_from_head.point(p)).collect(),
                    light: (0..fine.len()).map(|k| between(&light, k, 2 * pieces)).collect(),
                    colour: Vec3::from_array(self.spec.groom.colour.map(|c| c as f32))
                        * self.groom.brightness[i] as f32,
                    pieces,
                    seed: mix(self.spec.seed ^ (0xf1b3e + i as u64)),
                }
            })
            .collect();
        let normals: Vec<DVec3> = self.head.vertices.par_iter().map(|&v| normal(v)).collect();
        let skin = (0..self.head.vertices.len())
            .into_par_iter()
            .map(|v| {
                let p = self.head.vertices[v];
                let n = normals[v].as_vec3();
                let light = reaching(p + normals[v] * 1.5);
                let direct: f32 = (0..4).map(|l| light[l] * (0.85 * n.dot(local[l]) + 0.15).max(0.0)).sum();
                let base = if has_hair(p) { Vec3::new(0.25, 0.16, 0.11) } else { Vec3::new(0.95, 0.66, 0.50) };
                (world_from_head.point(p), base * (0.62 * direct + 0.16))
            })
            .collect();
        Lit { fibres, skin, world_from_head, hand: hand(&self.spec, frame), lights }
    }
}

/// Colours of the vertices of the body's cloth: no shadows fall on it, but its own sides are dark.
pub(crate) fn cloth(seed: u64, body: &Body, mesh: &TriMesh) -> Vec<Vec3> {
    let colour = |&p: &DVec3| {
        let n = body.normal(p).as_vec3();
        let direct: f32 =
            lights().iter().map(|light| light.strength * (0.8 * n.dot(light.towards) + 0.2).max(0.0)).sum();
        let woven = 1.0 + 0.15 * smooth_noise(seed ^ 0xc107, p / 9.0) as f32;
        Vec3::new(0.16, 0.07, 0.09) * woven * (0.6 * direct + 0.15)
    };
    mesh.vertices.iter().map(colour).collect()
}

impl Fibre {
    /// The vertices in an image with the light they return towards it.
    pub(crate) fn seen(&self, lens: &Lens, lights: &[Light; 4]) -> Vec<Vertex> {
        let eye = lens.camera.centre_in_world();
        let last = self.points.len() - 1;
        // Colours at the strand's own points; those between are blended.
        let own: Vec<Vec3> = (0..=last).step_by(self.pieces).map(|k| self.colour_towards(eye, k, lights)).collect();
        (0..=last)
            .map(|k| {
                let (i, share) = (k / self.pieces, (k % self.pieces) as f32 / self.pieces as f32);
                lens.vertex(self.points[k], own[i].lerp(own[(i + 1).min(own.len() - 1)], share))
            })
            .collect()
    }

    /// Light returned towards an eye at a point of the strand.
    fn colour_towards(&self, eye: DVec3, k: usize, lights: &[Light; 4]) -> Vec3 {
        /// Light too weak to move a pixel by one level.
        const DARK: f32 = 2e-3;
        let last = self.points.len() - 1;
        let p = self.points[k];
        let tangent = (self.points[(k + 1).min(last)] - self.points[k.saturating_sub(1)]).normalize_or(DVec3::Z);
        let (t, v) = (tangent.as_vec3(), (eye - p).normalize().as_vec3());
        let along = smooth_noise(self.seed, DVec3::new(k as f64 / last.max(1) as f64 * 7.0, 0.5, 0.5));
        let base = self.colour * (1.0 + 0.15 * along as f32);
        let reaching: f32 = self.light[k].iter().sum();
        let mut colour = base * (0.03 + 0.10 * reaching);
        for (light, &strength) in lights.iter().zip(&self.light[k]).filter(|(_, s)| **s > DARK) {
            let (neutral, coloured) = fibre(t, light.towards, v);
            colour += (Vec3::splat(neutral) + base * coloured) * strength;
        }
        colour
    }
}

/// A smooth curve through the points with `pieces` pieces an edge (Catmull and Rom 1974).
fn rounded(points: &[DVec3], pieces: usize) -> Vec<DVec3> {
    if pieces < 2 {
        return points.to_vec();
    }
    let last = points.len() - 1;
    let mut out = vec![points[0]];
    for k in 0..last {
        let (a, b, c, d) = (points[k.saturating_sub(1)], points[k], points[k + 1], points[(k + 2).min(last)]);
        for s in 1..=pieces {
            let t = s as f64 / pieces as f64;
            let curve = b * 2.0
                + (c - a) * t
                + (a * 2.0 - b * 5.0 + c * 4.0 - d) * (t * t)
                + (b * 3.0 - a - c * 3.0 + d) * (t * t * t);
            out.push(curve * 0.5);
        }
    }
    out
}

/// The value at fine point `k` between the values at the coarse points.
fn between(values: &[[f32; 4]], k: usize, pieces: usize) -> [f32; 4] {
    let (i, share) = ((k / pieces).min(values.len() - 1), (k % pieces) as f32 / pieces as f32);
    let next = values[(i + 1).min(values.len() - 1)];
    std::array::from_fn(|l| values[i][l] + (next[l] - values[i][l]) * share)
}
