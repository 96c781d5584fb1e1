//! The scene: head, groom, cameras, markers and the simulated motion; the truth of any frame.

use glam::{DVec2, DVec3, Vec3};
use strandflow_core::{Plane, Provenance, Rig, RigidTransform, Strands, TriMesh};
use strandflow_geometry::project::project;

use crate::body::{Body, Skin};
use crate::check::SpecViolation;
use crate::follow::Follow;
use crate::groom::{Groom, groom};
use crate::head::{self, CRANIUM, distance};
use crate::light::{density_grid, head_opacity};
use crate::motion::pose;
use crate::physics::{GuideMotion, simulate};
use crate::picture::background;
use crate::random::{normal, signed, stream};
use crate::rig::{miscalibrated, rig};
use crate::spec::SynthSpec;
use crate::studio::cloth;

/// Radius of a marker ball \[mm\].
pub const MARKER_RADIUS_MM: f64 = 4.8;

/// Linear colours of the ten marker balls.
pub const MARKER_COLOURS: [[f32; 3]; 10] = [
    [1.0, 0.02, 0.02],
    [0.5, 0.03, 0.75],
    [1.0, 0.42, 0.0],
    [0.95, 0.04, 0.75],
    [0.03, 0.12, 0.9],
    [0.02, 0.75, 0.9],
    [1.0, 0.75, 0.0],
    [0.95, 0.95, 0.95],
    [0.02, 0.7, 0.08],
    [0.65, 0.95, 0.05],
];

/// Everything that a capture is made from. Pictures are rendered from it one frame at a time, so memory stays bounded.
pub struct Scene {
    /// The spec.
    pub spec: SynthSpec,
    /// The true cameras.
    pub rig: Rig,
    /// The cameras as the capture's calibration gives them.
    pub given_rig: Rig,
    /// Closed head surface, head frame \[mm\].
    pub head: TriMesh,
    /// Closed surface of the body, world \[mm\], where there is one.
    pub body: Option<TriMesh>,
    /// The hair at rest.
    pub groom: Groom,
    /// Marker centres, head frame \[mm\].
    pub markers: Vec<DVec3>,
    /// How late each view is, in frames.
    pub delays: Vec<f64>,
    pub(crate) plates: Vec<Plane<Vec3>>,
    pub(crate) head_opacity: Vec<f32>,
    /// Colours of the body's vertices.
    pub(crate) cloth: Vec<Vec3>,
    follow: Follow,
    guides: GuideMotion,
}

/// The truth of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameTruth {
    /// All strands, world \[mm\]; the same strands with the same points in every frame.
    pub strands: Strands,
    /// The head's pose.
    pub world_from_head: RigidTransform,
    /// Marker centres, world \[mm\].
    pub markers: Vec<DVec3>,
}

/// Makes the scene of a spec: grows the groom and simulates the whole motion. Errors are all violations of the spec.
pub fn generate(spec: &SynthSpec) -> Result<Scene, Vec<SpecViolation>> {
    let violations = spec.check();
    if !violations.is_empty() {
        return Err(violations);
    }
    let head = head::mesh(5);
    let groom = groom(spec, &head);
    let follow = Follow::new(spec, &groom);
    let guides = simulate(spec, &groom);
    let body = Body::of(spec);
    let skin = Skin { body, world_from_head: pose(spec, 0.0) };
    let settled = follow.strands(&groom, &guides.at(0.0), &skin);
    let mesh = body.map(|body| body.mesh(5));
    let rig = rig(spec);
    let delays = (0..spec.rig.views)
        .map(|v| signed(&mut stream(spec.seed, &[40, v as u64])) * spec.noise.sync_ms * 1e-3 * spec.rig.fps)
        .collect();
    Ok(Scene {
        given_rig: miscalibrated(spec, &rig),
        plates: (0..spec.rig.views).map(|v| background(spec, v)).collect(),
        head_opacity: head_opacity(&density_grid(spec)),
        markers: markers(spec, &settled),
        spec: spec.clone(),
        rig,
        head,
        cloth: body.iter().zip(&mesh).flat_map(|(body, mesh)| cloth(spec.seed, body, mesh)).collect(),
        body: mesh,
        groom,
        delays,
        follow,
        guides,
    })
}

impl Scene {
    /// The truth of a frame (of the take's clock; late views see a little later).
    pub fn frame(&self, frame: usize) -> FrameTruth {
        let (strands, world_from_head) = self.moment(frame as f64);
        let mut out = Strands::new();
        for strand in &strands {
            let points: Vec<Vec3> = strand.iter().map(|&p| world_from_head.point(p).as_vec3()).collect();
            out.push(&points, &vec![Provenance::Observed; points.len()], &vec![1.0; points.len()]);
        }
        let markers = self.markers.iter().map(|&m| world_from_head.point(m)).collect();
        FrameTruth { strands: out, world_from_head, markers }
    }

    /// Per strand, whether its path stays smooth over the capture: no particle's step against the head changes by more
    /// than `jump_mm` from one frame to the next (8 mm is 0.8 km/s² at 100 fps, far above what swinging hair does).
    pub fn stable(&self, jump_mm: f64) -> Vec<bool> {
        let mut stable = vec![true; self.groom.strands.len()];
        let mut before: Vec<Vec<Vec<DVec3>>> = Vec::new();
        for frame in 0..self.spec.rig.frames {
            let now = self.moment(frame as f64).0;
            if let [first, second] = &before[..] {
                for (i, ok) in stable.iter_mut().enumerate() {
                    let changes = (0..now[i].len()).map(|k| now[i][k] - second[i][k] * 2.0 + first[i][k]);
                    *ok &= changes.into_iter().all(|change| change.length() <= jump_mm);
                }
                before.remove(0);
            }
            before.push(now);
        }
        stable
    }

    /// Projections of the markers into a view at a frame, as that view sees them \[px\].
    pub fn marker_points(&self, view: usize, frame: usize) -> Vec<Option<DVec2>> {
        let world_from_head = pose(&self.spec, frame as f64 + self.delays[view]);
        self.markers.iter().map(|&m| project(&self.rig.cameras[view], world_from_head.point(m))).collect()
    }

    /// A person's click on a projected marker \[px\].
    pub(crate) fn clicked(&self, view: usize, marker: usize, at: DVec2) -> DVec2 {
        let mut rng = stream(self.spec.seed, &[41, view as u64, marker as u64]);
        at + DVec2::new(normal(&mut rng), normal(&mut rng)) * self.spec.noise.label_px
    }

    /// All strands in the head frame, and the head's pose, at a time in frames.
    pub(crate) fn moment(&self, frame: f64) -> (Vec<Vec<DVec3>>, RigidTransform) {
        let world_from_head = pose(&self.spec, frame);
        let skin = Skin { body: Body::of(&self.spec), world_from_head };
        (self.follow.strands(&self.groom, &self.guides.at(frame), &skin), world_from_head)
    }
}

/// Ten places on the upper head that the views see, on top of the hair there; head frame.
fn markers(spec: &SynthSpec, strands: &[Vec<DVec3>]) -> Vec<DVec3> {
    (0..MARKER_COLOURS.len())
        .map(|m| {
            let mut rng = stream(spec.seed, &[42, m as u64]);
            let share = m as f64 / (MARKER_COLOURS.len() - 1) as f64;
            let up = (82.0 - 54.0 * share.powf(0.8) + 3.0 * signed(&mut rng)).to_radians();
            let around = ((m as f64 * 0.618_034).fract() * 2.0 - 1.0) * 128.0 + 5.0 * signed(&mut rng);
            let around = around.to_radians();
            let u = DVec3::new(around.sin() * up.cos(), around.cos() * up.cos(), up.sin());
            let mut p = CRANIUM + u * 120.0;
            for _ in 0..30 {
                p -= u * distance(p);
            }
            let n = head::normal(p);
            let height = strands
                .iter()
                .flatten()
                .filter_map(|&q| {
                    let h = (q - p).dot(n);
                    ((q - p - n * h).length() < 4.0 && h < 40.0).then_some(h)
                })
                .fold(0.0, f64::max);
            p + n * (height + 0.8 * MARKER_RADIUS_MM)
        })
        .collect()
}
