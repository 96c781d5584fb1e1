//! Strands and the head drawn into a view with a depth buffer: what the view sees, and in which direction it runs.

use glam::{DVec2, DVec3, Vec3};
use strandflow_core::{Camera, Plane, TriMesh};
use strandflow_geometry::project::{depth, project};

/// No strand at a pixel.
pub const NO_STRAND: u32 = u32::MAX;

/// What one view sees of a set of strands.
#[derive(Clone, Debug, PartialEq)]
pub struct StrandView {
    /// Depth of the nearest strand or head surface \[mm\]; infinite where there is none.
    pub depth: Plane<f32>,
    /// Angle in [0, π) from +x towards +y of the nearest strand \[rad\].
    pub angle: Plane<f32>,
    /// Number of the nearest strand; [`NO_STRAND`] where there is none or the head hides it.
    pub strand: Plane<u32>,
}

impl StrandView {
    /// Draws strands `(number, points)` two pixels wide, hidden by one another and by the head surface.
    pub fn draw<'a>(camera: &Camera, strands: impl Iterator<Item = (u32, &'a [Vec3])>, head: &TriMesh) -> Self {
        let (w, h) = (camera.width, camera.height);
        let mut view = Self {
            depth: Plane::filled(w, h, f32::INFINITY),
            angle: Plane::filled(w, h, 0.0),
            strand: Plane::filled(w, h, NO_STRAND),
        };
        view.draw_head(camera, head);
        for (number, points) in strands {
            let projected: Vec<Option<(DVec2, f64)>> = points
                .iter()
                .map(|p| {
                    let p = p.as_dvec3();
                    if p.is_finite() { project(camera, p).map(|pixel| (pixel, depth(camera, p))) } else { None }
                })
                .collect();
            for pair in projected.windows(2) {
                if let [Some(a), Some(b)] = pair {
                    view.draw_piece(number, *a, *b);
                }
            }
        }
        view
    }

    /// Whether a world point is not hidden: its depth exceeds the buffer's by at most `tolerance_mm`.
    pub fn sees(&self, camera: &Camera, point: Vec3, tolerance_mm: f64) -> bool {
        let point = point.as_dvec3();
        let Some(pixel) = project(camera, point) else { return false };
        self.depth.at_point(pixel.x, pixel.y).is_some_and(|z| depth(camera, point) <= f64::from(*z) + tolerance_mm)
    }

    /// Number of pixels on which a strand is the nearest thing.
    pub fn strand_pixels(&self) -> usize {
        self.strand.data.iter().filter(|n| **n != NO_STRAND).count()
    }

    fn draw_piece(&mut self, number: u32, (a, za): (DVec2, f64), (b, zb): (DVec2, f64)) {
        let along = b - a;
        let steps = (along.length() / 0.5).ceil().clamp(1.0, 4000.0) as usize;
        let angle = along.y.atan2(along.x).rem_euclid(std::f64::consts::PI) as f32;
        // Two pixels wide: the point itself and half a pixel to either side.
        let across = along.perp().normalize_or_zero() * 0.5;
        for i in 0..=steps {
            let t = i as f64 / steps as f64;
            let (pixel, z) = (a + along * t, (za + (zb - za) * t) as f32);
            for side in [pixel, pixel + across, pixel - across] {
                self.put(side, z, angle, number);
            }
        }
    }

    fn put(&mut self, pixel: DVec2, z: f32, angle: f32, number: u32) {
        let (w, h) = (self.depth.width as f64, self.depth.height as f64);
        if pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < w && pixel.y < h {
            let at = (pixel.x as usize, pixel.y as usize);
            if z < self.depth[at] {
                (self.depth[at], self.angle[at], self.strand[at]) = (z, angle, number);
            }
        }
    }

    /// The head's faces by barycentric filling at pixel centres.
    fn draw_head(&mut self, camera: &Camera, head: &TriMesh) {
        let corner = |v: &DVec3| project(camera, *v).map(|pixel| (pixel, 1.0 / depth(camera, *v)));
        let corners: Vec<Option<(DVec2, f64)>> = head.vertices.iter().map(corner).collect();
        for face in &head.faces {
            let [Some((a, ia)), Some((b, ib)), Some((c, ic))] = face.map(|v| corners[v as usize]) else { continue };
            let area = (b - a).perp_dot(c - a);
            if area.abs() < 1e-9 {
                continue;
            }
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            let clamp = |x: f64, most: usize| x.clamp(0.0, most as f64) as usize;
            for y in clamp(low.y, self.depth.height)..clamp(high.y + 1.0, self.depth.height) {
                for x in clamp(low.x, self.depth.width)..clamp(high.x + 1.0, self.depth.width) {
                    let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                    let (u, v) = ((p - a).perp_dot(c - a) / area, (b - a).perp_dot(p - a) / area);
                    if u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
                        let z = (1.0 / (ia * (1.0 - u - v) + ib * u + ic * v)) as f32;
                        let here = &mut self.depth[(x, y)];
                        *here = here.min(z);
                    }
                }
            }
        }
    }
}
