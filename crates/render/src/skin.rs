//! The head's surface: its light, and its place in the picture.

use std::collections::HashMap;

use glam::{DVec3, IVec3, Vec2, Vec3};
use rayon::prelude::*;
use strandflow_geometry::project::project;

use crate::{
    scattering::SHADES,
    shadow::Surface,
    subject::{Hair, Head},
    thread::{Eye, Lighting},
};

/// Albedo of skin, linear RGB.
const SKIN: Vec3 = Vec3::new(0.27, 0.165, 0.12);

/// What the scalp returns under hair, as a share of the hair's own albedo: between roots one sees roots. At 1 bald places
/// are brighter than the hair around them.
const SCALP: f32 = 0.16;

/// How far light comes around an edge of skin: it is translucent. At 0 faces look like plaster.
const WRAP: f32 = 0.25;

/// A vertex of the surface in the picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SkinVertex {
    /// Image point \[px\].
    pub at: Vec2,
    /// Distance along the optical axis \[mm\].
    pub depth: f32,
    /// What it moves while the shutter is open \[px\].
    pub motion: Vec2,
    /// Radiance, linear RGB.
    pub colour: Vec3,
}

/// The surface in the world.
pub(crate) fn in_world(head: &Head) -> Vec<Vec3> {
    head.mesh.vertices.iter().map(|&v| head.world_from_head.point(v).as_vec3()).collect()
}

/// The lit surface as an eye sees it.
pub(crate) fn skin(head: &Head, surface: &Surface, hair: &Hair, lighting: &Lighting, eye: &Eye) -> Vec<SkinVertex> {
    let normals = normals(surface);
    let roots = Roots::of(hair);
    let scalp = lighting.scattering.crowds[SHADES / 2].albedo * SCALP;
    (0..surface.vertices.len())
        .into_par_iter()
        .map(|v| {
            let (p, normal) = (surface.vertices[v], normals[v]);
            let albedo = SKIN.lerp(scalp, roots.cover(p));
            let mut light = lighting.rig.dome * (lighting.dome.seen(p + normal * 6.0) * std::f32::consts::PI);
            for (source, shadow) in lighting.rig.lights.iter().zip(lighting.shadows) {
                let facing = (normal.dot(source.towards) + WRAP).max(0.0) / (1.0 + WRAP);
                light += source.irradiance * facing * (-shadow.depth(p + normal * 2.0)).exp();
            }
            let at = p.as_dvec3();
            let next = head.next_world_from_head.point(head.mesh.vertices[v]);
            let image = |at: DVec3| project(eye.camera, at).map_or(Vec2::NAN, |p| p.as_vec2());
            SkinVertex {
                at: image(at),
                depth: strandflow_geometry::project::depth(eye.camera, at) as f32,
                motion: (image(next) - image(at)) * eye.shutter,
                colour: albedo * light / std::f32::consts::PI,
            }
        })
        .collect()
}

/// Unit normals of the vertices, by the area of the faces around them.
fn normals(surface: &Surface) -> Vec<Vec3> {
    let mut sums = vec![Vec3::ZERO; surface.vertices.len()];
    for face in surface.faces {
        let [a, b, c] = face.map(|v| surface.vertices[v as usize]);
        let area = (b - a).cross(c - a);
        face.iter().for_each(|&v| sums[v as usize] += area);
    }
    sums.into_iter().map(|n| n.normalize_or(Vec3::Z)).collect()
}

/// Where hair grows: roots by cells.
struct Roots(HashMap<IVec3, u32>);

impl Roots {
    const CELL_MM: f32 = 6.0;

    /// Roots in the 27 cells around a place under full hair; a hairline has a third of it.
    const FULL: f32 = 12.0;

    fn of(hair: &Hair) -> Self {
        let mut cells = HashMap::new();
        for root in (0..hair.strand_count()).filter_map(|n| hair.strand(n).first()) {
            *cells.entry((*root / Self::CELL_MM).floor().as_ivec3()).or_insert(0) += 1;
        }
        Self(cells)
    }

    /// How much of the surface at a place is scalp, 0 to 1.
    fn cover(&self, p: Vec3) -> f32 {
        let cell = (p / Self::CELL_MM).floor().as_ivec3();
        let around = (0..27).map(|i| cell + IVec3::new(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1));
        let count: u32 = around.filter_map(|cell| self.0.get(&cell)).sum();
        (count as f32 / Self::FULL).min(1.0)
    }
}
