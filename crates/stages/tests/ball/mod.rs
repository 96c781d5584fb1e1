//! A ball at the origin covered with hair that runs down its meridians, and what cameras around it see of it.

use glam::{DVec2, DVec3};
use strandflow_core::{Camera, Grid, Mask, Occupancy, Plane, Report, Rig, RigidTransform, SparseVoxels, Strands};
use strandflow_geometry::{
    project::{project_direction, ray},
    signed_distance::SignedDistance,
};
use strandflow_stages::{
    Mode,
    field::{FieldInput, FieldSettings, FieldVoxel, field},
    grow::{Before, GrowInput, GrowSettings, grow},
    lift::{LiftInput, LiftSettings, Line, lift},
    orient::OrientationMap,
};

/// The direction of the hair at a point: down along the meridian.
pub fn meridian(point: DVec3) -> DVec3 {
    let out = point.normalize();
    (DVec3::NEG_Z + out * out.z).normalize_or(DVec3::X)
}

/// Where the ray of a pixel meets a ball of that radius.
pub fn hit(camera: &Camera, radius: f64, x: usize, y: usize) -> Option<DVec3> {
    let ray = ray(camera, DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
    let b = ray.origin.dot(ray.direction);
    let inner = b * b - ray.origin.length_squared() + radius * radius;
    (inner > 0.0).then(|| ray.origin + ray.direction * (-b - inner.sqrt()))
}

/// One frame, up to its orientation maps.
pub struct Scene {
    pub rig: Rig,
    pub hull: Occupancy,
    pub maps: Vec<OrientationMap>,
    pub hairs: Vec<Mask>,
}

impl Scene {
    /// A ball of hair of that radius \[mm\]; `error` is that of an orientation, of a view at a pixel (x, y) \[rad\].
    pub fn new(rig: Rig, grid: Grid, radius: f64, error: impl Fn(usize, usize, usize) -> f64) -> Self {
        let mut hull = Occupancy::empty(grid);
        for index in 0..grid.len() {
            hull.set(index, grid.centre_of_index(index).length() <= radius + 1.0);
        }
        let (mut maps, mut hairs) = (Vec::new(), Vec::new());
        for (v, camera) in rig.cameras.iter().enumerate() {
            let angle = Plane::from_fn(camera.width, camera.height, |x, y| {
                let Some(point) = hit(camera, radius, x, y) else { return 0.0 };
                let d = project_direction(camera, point, meridian(point)).unwrap_or(DVec2::X);
                (d.to_angle() + error(v, x, y)).rem_euclid(std::f64::consts::PI) as f32
            });
            let seen = |x: usize, y: usize| hit(camera, radius, x, y).is_some();
            let confidence = Plane::from_fn(camera.width, camera.height, |x, y| if seen(x, y) { 0.8 } else { 0.0 });
            hairs.push(Plane::from_fn(camera.width, camera.height, |x, y| if seen(x, y) { 255 } else { 0 }));
            maps.push(OrientationMap { angle, confidence });
        }
        Self { rig, hull, maps, hairs }
    }

    pub fn lines(&self, mode: Mode) -> SparseVoxels<Line> {
        let (maps, hairs) = (self.maps.iter().collect::<Vec<_>>(), self.hairs.iter().collect::<Vec<_>>());
        let input = LiftInput { rig: &self.rig, frame: 0, hull: &self.hull, maps: &maps, hairs: &hairs };
        lift(&input, mode, &LiftSettings::default(), &mut Report::default()).unwrap()
    }

    pub fn field(&self, lines: &SparseVoxels<Line>, head: &SignedDistance, mode: Mode) -> SparseVoxels<FieldVoxel> {
        let hairs = self.hairs.iter().collect::<Vec<_>>();
        let input = FieldInput {
            rig: &self.rig,
            frame: 0,
            hull: &self.hull,
            lines,
            hairs: &hairs,
            head,
            world_from_head: RigidTransform::IDENTITY,
        };
        field(&input, mode, &FieldSettings::default(), &mut Report::default()).unwrap()
    }
}

/// Strands from a head of that radius \[mm\], one along each of its normals.
pub fn grown(
    field: &SparseVoxels<FieldVoxel>,
    head: f64,
    normals: &[DVec3],
    before: Option<Before>,
) -> (Strands, Vec<DVec3>) {
    let roots: Vec<DVec3> = normals.iter().map(|n| *n * head).collect();
    let input = GrowInput {
        frame: 0,
        field,
        roots: &roots,
        normals,
        world_from_head: RigidTransform::IDENTITY,
        gravity: DVec3::new(0.0, 0.0, -9810.0),
        before,
    };
    (grow(&input, Mode::Robust, &GrowSettings::default(), &mut Report::default()).unwrap(), roots)
}
