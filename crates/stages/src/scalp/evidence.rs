//! What the slow start says about the head under the hair: the tight hull in head space, its surface, and rays of skin.

use glam::{DMat3, DVec3};
use strandflow_core::{Grid, Mask, Occupancy};
use strandflow_geometry::project::{Ray, project, ray};
use strandflow_geometry::signed_distance::SignedDistance;

use super::ScalpInput;
use crate::hull::bodies;

/// Edge of the voxels of the tight hull in head space \[mm\].
const VOXEL_MM: f64 = 3.0;
/// Room kept free of evidence around a marker \[mm\]: balls are up to 10 mm wide.
const MARKER_ROOM_MM: f64 = 13.0;

/// The evidence, in head space.
pub struct Evidence {
    /// Distance to the surface of what all frames of the slow start leave, negative inside \[mm\].
    pub hull_distance: SignedDistance,
    /// Points on that surface away from the markers \[mm\].
    pub surface: Vec<DVec3>,
    /// Rays that touch skin at the subject's outline in the first frame.
    pub skin: Vec<Ray>,
    /// Upright axes: y to the face, z up.
    pub upright: DMat3,
    /// Height of the hull's top along up, without markers and stray hair \[mm\].
    pub top: f64,
    /// Middle of the hull at the height of the greatest breadth of a head \[mm\].
    pub middle: DVec3,
}

/// Gathers the evidence; `None` where the hulls of the slow start share no volume.
pub fn gather(input: &ScalpInput) -> Option<Evidence> {
    let hull = body_with_markers(tight_hull(input)?, input.markers);
    let up = (-input.gravity).try_normalize().unwrap_or(DVec3::Z);
    let top = top_of(&hull, up)?;
    let middle = middle_below(&hull, up, top)?;
    let surface = surface_points(&hull, up, top, input.markers);
    let hull_distance = SignedDistance::from_occupancy(&hull);
    let skin = skin_rays(input);
    let upright = upright_axes(input, middle, up);
    Some(Evidence { hull_distance, surface, skin, upright, top, middle })
}

/// Voxels of head space that lie in the hull of every frame of the slow start.
fn tight_hull(input: &ScalpInput) -> Option<Occupancy> {
    let source = input.frames.first()?.hull.grid;
    let dims = source.dims.map(|n| ((n as f64 * source.voxel_mm / VOXEL_MM).ceil() as usize).max(1));
    let mut hull = Occupancy::empty(Grid { origin: source.origin, voxel_mm: VOXEL_MM, dims });
    for index in 0..hull.grid.len() {
        let point = hull.grid.centre_of_index(index);
        if input.frames.iter().all(|frame| frame.hull.contains(frame.world_from_head.point(point))) {
            hull.set(index, true);
        }
    }
    (hull.count() > 0).then_some(hull)
}

/// The hull without other people: of several bodies the one that lies nearest to the markers.
fn body_with_markers(hull: Occupancy, markers: &[DVec3]) -> Occupancy {
    let bodies = bodies(&hull);
    if bodies.len() < 2 || markers.is_empty() {
        return hull;
    }
    let middle = markers.iter().sum::<DVec3>() / markers.len() as f64;
    let distance = |body: &Vec<usize>| {
        let squares = body.iter().map(|&voxel| hull.grid.centre_of_index(voxel).distance_squared(middle));
        squares.fold(f64::INFINITY, f64::min)
    };
    let nearest = bodies.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
    let mut kept = Occupancy::empty(hull.grid);
    nearest.into_iter().flatten().for_each(|&voxel| kept.set(voxel, true));
    kept
}

/// Height of the uppermost level at which the hull covers the area of a palm's width, above which only markers rise.
fn top_of(hull: &Occupancy, up: DVec3) -> Option<f64> {
    const AREA_MM2: f64 = 2500.0;
    let mut heights: Vec<i64> = hull.indices().map(|i| (hull.grid.centre_of_index(i).dot(up)) as i64).collect();
    heights.sort_unstable();
    // Voxels are counted in levels of one voxel's height.
    let level = |h: i64| (h as f64 / VOXEL_MM).floor() as i64;
    let enough = (AREA_MM2 / (VOXEL_MM * VOXEL_MM)) as usize;
    let mut end = heights.len();
    while end > 0 {
        let this = level(heights[end - 1]);
        let start = heights[..end].partition_point(|&h| level(h) < this);
        if end - start >= enough {
            return Some((this as f64 + 1.0) * VOXEL_MM);
        }
        end = start;
    }
    None
}

/// Middle of the hull in a slab about 55–75 mm below its top, where hair hides neither brow nor occiput's extent much.
fn middle_below(hull: &Occupancy, up: DVec3, top: f64) -> Option<DVec3> {
    let slab: Vec<DVec3> = hull
        .indices()
        .map(|i| hull.grid.centre_of_index(i))
        .filter(|p| (55.0..75.0).contains(&(top - p.dot(up))))
        .collect();
    (!slab.is_empty()).then(|| slab.iter().sum::<DVec3>() / slab.len() as f64)
}

/// Every surface voxel of the hull's upper 220 mm, thinned to about a thousand, away from the markers.
fn surface_points(hull: &Occupancy, up: DVec3, top: f64, markers: &[DVec3]) -> Vec<DVec3> {
    let grid = &hull.grid;
    let on_surface = |index: usize| {
        let v = grid.coordinates(index);
        (0..3).any(|k| {
            [v[k].wrapping_sub(1), v[k] + 1].into_iter().any(|n| {
                let mut neighbour = v;
                neighbour[k] = n;
                n >= grid.dims[k] || !hull.get(grid.index(neighbour))
            })
        })
    };
    let all: Vec<DVec3> = hull
        .indices()
        .filter(|&i| on_surface(i))
        .map(|i| grid.centre_of_index(i))
        .filter(|p| top - p.dot(up) < 220.0 && markers.iter().all(|m| m.distance(*p) > MARKER_ROOM_MM))
        .collect();
    let stride = (all.len() / 1000).max(1);
    all.into_iter().step_by(stride).collect()
}

/// Rays through pixels of skin that border on the background, in the first frame.
fn skin_rays(input: &ScalpInput) -> Vec<Ray> {
    let Some(first) = input.frames.first() else { return Vec::new() };
    let mut rays = Vec::new();
    for ((camera, subject), hair) in input.rig.cameras.iter().zip(&first.subjects).zip(&first.hairs) {
        let markers: Vec<_> = input
            .markers
            .iter()
            .filter_map(|m| {
                let depth = camera.camera_from_world.point(*m).z.max(1.0);
                Some((project(camera, *m)?, MARKER_ROOM_MM * camera.focal[0] / depth))
            })
            .collect();
        for y in 3..subject.height.saturating_sub(3) {
            for x in 3..subject.width.saturating_sub(3) {
                if !is_skin_border(subject, hair, x, y) {
                    continue;
                }
                let pixel = glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                if markers.iter().all(|(m, room)| m.distance(pixel) > *room) {
                    rays.push(ray(camera, pixel));
                }
            }
        }
    }
    let stride = (rays.len() / 200).max(1);
    rays.into_iter().step_by(stride).collect()
}

/// Whether a pixel is subject, borders on the background, and no hair is within two pixels of it.
fn is_skin_border(subject: &Mask, hair: &Mask, x: usize, y: usize) -> bool {
    if subject[(x, y)] < 128 || hair[(x, y)] >= 64 {
        return false;
    }
    let background = [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)].into_iter().any(|at| subject[at] < 64);
    background && (y - 2..=y + 2).all(|v| (x - 2..=x + 2).all(|u| hair[(u, v)] < 64))
}

/// Axes with z up and y to the face: away from the views where hair covers most of the head.
fn upright_axes(input: &ScalpInput, middle: DVec3, up: DVec3) -> DMat3 {
    let level = |d: DVec3| d.reject_from_normalized(up).normalize_or_zero();
    let mut face = DVec3::ZERO;
    if let Some(first) = input.frames.first() {
        for ((camera, subject), hair) in input.rig.cameras.iter().zip(&first.subjects).zip(&first.hairs) {
            // Views are placed for the hair, so the side without views is the face; a view that sees skin pulls it over.
            let skin = bare_share(subject, hair);
            face += level(camera.centre_in_world() - middle) * (2.0 * skin - 1.0);
        }
    }
    let face = level(face);
    let face = if face == DVec3::ZERO { level(up.any_orthonormal_vector()) } else { face };
    DMat3::from_cols(face.cross(up), face, up)
}

/// Share of the subject that is not hair.
fn bare_share(subject: &Mask, hair: &Mask) -> f64 {
    let inside = subject.data.iter().filter(|&&s| s >= 128).count();
    let bare = subject.data.iter().zip(&hair.data).filter(|&(&s, &h)| s >= 128 && h < 128).count();
    bare as f64 / inside.max(1) as f64
}
