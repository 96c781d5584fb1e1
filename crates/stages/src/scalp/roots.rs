//! Roots: blue noise, by area, on the part of the surface that is above the usual hairline and looks like hair.

use glam::{DVec2, DVec3};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use strandflow_core::{Camera, Mask, TriMesh};
use strandflow_geometry::{blue_noise::thin_out, project::project};

use super::ScalpInput;
use super::template::HeadShape;

/// Candidates for each root kept.
const CANDIDATES: usize = 5;
/// Cosine between normal and viewing ray from which on a view has a say.
const FACING: f64 = 0.35;
/// Half the edge of the window in which hair is counted \[px\]: wide enough to look past partings, narrow beside a face.
const WINDOW_PX: i64 = 6;
/// Share of hair in the windows from which on a place bears hair.
const HAIR_SHARE: f64 = 0.3;

/// Roots and their outward unit normals.
pub fn sample_roots(mesh: &TriMesh, shape: &HeadShape, input: &ScalpInput, count: usize) -> (Vec<DVec3>, Vec<DVec3>) {
    let normals = vertex_normals(mesh);
    let bears_hair = |face: usize| {
        let [a, b, c] = mesh.corners(face);
        let middle = (a + b + c) / 3.0;
        shape.above_hairline(middle) > 0.0 && looks_like_hair(input, middle, mesh.face_normal(face))
    };
    let faces: Vec<usize> = (0..mesh.faces.len()).filter(|&face| bears_hair(face)).collect();
    let mut sums = Vec::with_capacity(faces.len());
    let mut area = 0.0;
    for &face in &faces {
        area += mesh.face_area(face);
        sums.push(area);
    }
    if area <= 0.0 {
        return Default::default();
    }
    let mut random = Pcg64Mcg::seed_from_u64(input.seed);
    let (mut points, mut outward) = (Vec::new(), Vec::new());
    for _ in 0..count * CANDIDATES {
        let pick = random.random::<f64>() * area;
        let face = faces[sums.partition_point(|&s| s < pick).min(faces.len() - 1)];
        let (mut u, mut v) = (random.random::<f64>(), random.random::<f64>());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        let mix = |[a, b, c]: [DVec3; 3]| a * (1.0 - u - v) + b * u + c * v;
        points.push(mix(mesh.corners(face)));
        outward.push(mix(mesh.faces[face].map(|i| normals[i as usize])).normalize_or(DVec3::Z));
    }
    let kept = thin_out(&points, count, area);
    (kept.iter().map(|&i| points[i]).collect(), kept.iter().map(|&i| outward[i]).collect())
}

/// Whether the views that face a place of the first frames see hair there; true where none does.
fn looks_like_hair(input: &ScalpInput, point: DVec3, normal: DVec3) -> bool {
    let (mut hair, mut seen) = (0.0, 0.0);
    for frame in input.frames {
        let (p, n) = (frame.world_from_head.point(point), frame.world_from_head.vector(normal));
        for (camera, mask) in input.rig.cameras.iter().zip(&frame.hairs) {
            let facing = (camera.centre_in_world() - p).normalize_or_zero().dot(n);
            if facing < FACING {
                continue;
            }
            if let Some(share) = share_around(camera, mask, p) {
                hair += facing * share;
                seen += facing;
            }
        }
    }
    seen <= 0.0 || hair >= HAIR_SHARE * seen
}

/// Share of hair in the window around a projection; `None` outside the image.
fn share_around(camera: &Camera, mask: &Mask, point: DVec3) -> Option<f64> {
    let pixel: DVec2 = project(camera, point)?;
    mask.at_point(pixel.x, pixel.y)?;
    let (x, y) = (pixel.x as i64, pixel.y as i64);
    let (mut sum, mut count) = (0u32, 0u32);
    for v in ((y - WINDOW_PX).max(0)..=(y + WINDOW_PX).min(mask.height as i64 - 1)).step_by(2) {
        for u in ((x - WINDOW_PX).max(0)..=(x + WINDOW_PX).min(mask.width as i64 - 1)).step_by(2) {
            sum += u32::from(mask[(u as usize, v as usize)] >= 128);
            count += 1;
        }
    }
    Some(f64::from(sum) / f64::from(count.max(1)))
}

fn vertex_normals(mesh: &TriMesh) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; mesh.vertices.len()];
    for (f, face) in mesh.faces.iter().enumerate() {
        let weighted = mesh.face_normal(f) * mesh.face_area(f);
        face.iter().for_each(|&v| normals[v as usize] += weighted);
    }
    normals.into_iter().map(DVec3::normalize_or_zero).collect()
}
