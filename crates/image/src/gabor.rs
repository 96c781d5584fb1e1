//! A bank of oriented quadrature pairs (even and odd Gabor filters), read out as doubled-angle vectors.
//!
//! A Gabor filter with an isotropic envelope is separable for every orientation: g(x)g(y)·exp(iω(x cos φ + y sin φ)) is
//! a product of two one-dimensional complex filters. The orientations φ and π − φ share their four real products, so a
//! bank of N orientations costs N/2 + 1 row pairs and 2N + 4 column passes.
//!
//! Reference: Daugman 1985 (quadrature pairs); Granlund & Knutsson 1995 (doubled angle).

use strandflow_core::Plane;

use crate::filter::{even_and_odd_along_rows, even_and_odd_column_row, gaussian_half};

/// Doubled-angle sum and total of the energies of a bank.
#[derive(Clone, Debug, PartialEq)]
pub struct OrientationEnergy {
    /// Σ E(θ) cos 2θ, θ the direction of lines from +x towards +y.
    pub cos2: Plane<f32>,
    /// Σ E(θ) sin 2θ.
    pub sin2: Plane<f32>,
    /// Σ E(θ).
    pub total: Plane<f32>,
}

impl OrientationEnergy {
    /// No energy anywhere.
    pub fn zero(width: usize, height: usize) -> Self {
        let plane = Plane::filled(width, height, 0.0);
        Self { cos2: plane.clone(), sin2: plane.clone(), total: plane }
    }

    /// The same done to all three planes.
    pub fn each(&self, f: impl Fn(&Plane<f32>) -> Plane<f32>) -> Self {
        Self { cos2: f(&self.cos2), sin2: f(&self.sin2), total: f(&self.total) }
    }
}

/// Adds `gain` times the energies (squared magnitude of even and odd response) of `orientations` filter pairs of one
/// wavelength \[px\] and envelope sigma \[px\] to `into`. `orientations` is even.
pub fn add_energy(
    plane: &Plane<f32>,
    (wavelength, sigma): (f32, f32),
    orientations: usize,
    gain: f32,
    into: &mut OrientationEnergy,
) {
    let envelope = gaussian_half(sigma);
    let omega = std::f32::consts::TAU / wavelength;
    let modulated = |frequency: f32| -> (Vec<f32>, Vec<f32>) {
        envelope
            .iter()
            .enumerate()
            .map(|(i, g)| (g * (frequency * i as f32).cos(), g * (frequency * i as f32).sin()))
            .unzip()
    };
    let width = plane.width;
    let mut rows = [(); 4].map(|_| vec![0.0f32; width]);
    for k in 0..=orientations / 2 {
        let phi = std::f32::consts::PI * k as f32 / orientations as f32;
        let ((cos_x, sin_x), (cos_y, sin_y)) = (modulated(omega * phi.cos()), modulated(omega * phi.sin()));
        let [c, s] = even_and_odd_along_rows(plane, &cos_x, &sin_x);
        // Lines run across the wave vector: doubled angle turned by π. φ and π − φ coincide at both ends.
        let (c2, s2) = (-(2.0 * phi).cos() * gain, -(2.0 * phi).sin() * gain);
        let mirrored = k != 0 && 2 * k != orientations;
        for y in 0..plane.height {
            let [cc, cs, sc, ss] = &mut rows;
            even_and_odd_column_row(&c, &cos_y, &sin_y, y, [cc, cs]);
            even_and_odd_column_row(&s, &cos_y, &sin_y, y, [sc, ss]);
            let span = y * width..(y + 1) * width;
            let (vc, vs) = (&mut into.cos2.data[span.clone()], &mut into.sin2.data[span.clone()]);
            let vt = &mut into.total.data[span];
            for x in 0..width {
                let (cc, cs, sc, ss) = (cc[x], cs[x], sc[x], ss[x]);
                let e = (cc - ss).powi(2) + (cs + sc).powi(2);
                let m = if mirrored { (cc + ss).powi(2) + (cs - sc).powi(2) } else { 0.0 };
                vc[x] += c2 * (e + m);
                vs[x] += s2 * (e - m);
                vt[x] += gain * (e + m);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gratings_are_read_at_their_angle() {
        for degrees in [0.0f32, 17.0, 45.0, 90.0, 133.0] {
            let theta = degrees.to_radians();
            let plane = Plane::from_fn(48, 48, |x, y| {
                let across = -(x as f32) * theta.sin() + y as f32 * theta.cos();
                (std::f32::consts::TAU * across / 7.0).sin()
            });
            let mut energy = OrientationEnergy::zero(48, 48);
            add_energy(&plane, (6.0, 3.0), 32, 1.0, &mut energy);
            let found = 0.5 * energy.sin2[(24, 24)].atan2(energy.cos2[(24, 24)]);
            let error = (found - theta).sin().abs().asin().to_degrees();
            assert!(error < 0.3, "{degrees}: {error}");
            assert!(energy.cos2[(24, 24)].hypot(energy.sin2[(24, 24)]) > 0.8 * energy.total[(24, 24)]);
        }
    }

    #[test]
    fn twelve_orientations_read_what_thirty_two_do() {
        let plane = Plane::from_fn(48, 48, |x, y| {
            let across = |theta: f32| -(x as f32) * theta.sin() + y as f32 * theta.cos();
            (1.1 * across(0.4)).sin() + 0.6 * (0.8 * across(1.3)).sin()
        });
        let read = |orientations: usize| {
            let mut energy = OrientationEnergy::zero(48, 48);
            add_energy(&plane, (6.0, 3.0), orientations, 1.0 / orientations as f32, &mut energy);
            energy
        };
        let (few, many) = (read(12), read(32));
        for i in (0..48 * 48).filter(|i| many.cos2.data[*i].hypot(many.sin2.data[*i]) > 0.3 * many.total.data[*i]) {
            let angle = |energy: &OrientationEnergy| 0.5 * energy.sin2.data[i].atan2(energy.cos2.data[i]);
            let error = (angle(&few) - angle(&many)).sin().abs().asin().to_degrees();
            assert!(error < 0.01, "{error}° at {i}");
        }
    }
}
