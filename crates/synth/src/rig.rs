//! The cameras: around the back and the sides of the head, alternately higher and lower.

use glam::{DMat3, DVec3};
use rand::Rng;
use strandflow_core::{Camera, Distortion, Rig, RigidTransform};

use crate::motion::STAND;
use crate::random::{normal, signed, stream};
use crate::spec::SynthSpec;

/// The true cameras, named cam00, cam01, … from the right side over the back to the left side.
pub fn rig(spec: &SynthSpec) -> Rig {
    let r = &spec.rig;
    let scale = r.width as f64 / 640.0;
    let drop = spec.groom.cut_below_mm.clamp(100.0, 260.0) - 100.0;
    let aim = STAND + DVec3::new(0.0, 10.0, -25.0 - 0.5 * drop);
    let cameras = (0..r.views)
        .map(|v| {
            let mut rng = stream(spec.seed, &[20, v as u64]);
            let share = if r.views > 1 { v as f64 / (r.views - 1) as f64 - 0.5 } else { 0.0 };
            let around = (share * r.arc_deg + 4.0 * signed(&mut rng)).to_radians();
            let up = (if v % 2 == 0 { 10.0 } else { 34.0 } + 4.0 * signed(&mut rng)).to_radians();
            let distance = r.distance_mm * (1.0 + 0.05 * rng.random::<f64>()) * (1.0 + drop / 900.0);
            let from = DVec3::new(around.sin() * up.cos(), around.cos() * up.cos(), up.sin()) * distance;
            let roll = DMat3::from_rotation_z((1.5 * signed(&mut rng)).to_radians());
            let rotation = roll * look_along(-from);
            let focal = r.focal_px * scale * (1.0 + 0.03 * signed(&mut rng));
            let principal = [
                r.width as f64 * 0.5 + 6.0 * scale * signed(&mut rng),
                r.height as f64 * 0.5 + 4.0 * scale * signed(&mut rng),
            ];
            Camera {
                name: format!("cam{v:02}"),
                width: r.width,
                height: r.height,
                focal: [focal; 2],
                principal,
                distortion: Distortion::None,
                camera_from_world: RigidTransform { rotation, translation: -(rotation * (aim + from)) },
            }
        })
        .collect();
    Rig { cameras }
}

/// The cameras as a calibration with errors would give them: each turned by small angles that move the image by
/// `calibration_px` (standard deviation along each axis).
pub fn miscalibrated(spec: &SynthSpec, rig: &Rig) -> Rig {
    let mut out = rig.clone();
    let sigma = spec.noise.calibration_px;
    for (v, camera) in out.cameras.iter_mut().enumerate().filter(|_| sigma > 0.0) {
        let mut rng = stream(spec.seed, &[21, v as u64]);
        let mut angle = |reach_px: f64| sigma * normal(&mut rng) / reach_px;
        let turn = DMat3::from_rotation_x(angle(camera.focal[1]))
            * DMat3::from_rotation_y(angle(camera.focal[0]))
            * DMat3::from_rotation_z(angle(camera.width as f64 * 0.5));
        let about = RigidTransform { rotation: turn, translation: DVec3::ZERO };
        camera.camera_from_world = about.after(&camera.camera_from_world);
    }
    out
}

/// Rows x (right), y (down), z (forward) of a level camera that looks along a direction.
fn look_along(direction: DVec3) -> DMat3 {
    let z = direction.normalize_or(DVec3::Y);
    let x = z.cross(DVec3::Z).try_normalize().unwrap_or(DVec3::X);
    let y = z.cross(x);
    DMat3::from_cols(x, y, z).transpose()
}
