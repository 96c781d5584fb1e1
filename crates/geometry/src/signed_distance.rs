//! A signed distance field sampled on a regular grid: constant-time distance and gradient for collisions and volumes.

use glam::DVec3;
use rayon::prelude::*;
use strandflow_core::{Grid, Occupancy, TriMesh};

use crate::mesh_distance::MeshDistance;

/// Signed distance to a closed mesh \[mm\], negative inside, trilinear between samples at voxel centres.
#[derive(Clone, Debug, PartialEq)]
pub struct SignedDistance {
    grid: Grid,
    values: Vec<f32>,
}

impl SignedDistance {
    /// Samples the distance to a closed mesh with outward faces in its bounding box plus `margin_mm`. Between samples the
    /// error is of the order of `voxel_mm²` times the curvature. An empty mesh is infinitely far from everything.
    pub fn from_mesh(mesh: &TriMesh, voxel_mm: f64, margin_mm: f64) -> Self {
        let corners = || mesh.vertices.iter().copied().filter(|v| v.is_finite());
        let low = corners().fold(DVec3::INFINITY, DVec3::min) - margin_mm;
        let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max) + margin_mm;
        if mesh.faces.is_empty() || !low.is_finite() || !high.is_finite() {
            let grid = Grid { origin: DVec3::ZERO, voxel_mm, dims: [2; 3] };
            return Self { grid, values: vec![f32::INFINITY; 8] };
        }
        let dims = ((high - low) / voxel_mm).ceil().to_array().map(|n| (n as usize).max(2));
        let grid = Grid { origin: low, voxel_mm, dims };
        let tree = MeshDistance::new(mesh);
        let sample = |i: usize| {
            tree.nearest(grid.centre_of_index(i)).map_or(f32::INFINITY, |nearest| nearest.signed_distance as f32)
        };
        Self { grid, values: (0..grid.len()).into_par_iter().map(sample).collect() }
    }

    /// Distance to the border between occupied and free voxels (halfway between their centres) \[mm\], negative inside;
    /// beyond the grid everything is free. Exact at voxel centres up to half a voxel.
    ///
    /// Reference: Felzenszwalb & Huttenlocher 2012 (distance transform by lower envelopes).
    pub fn from_occupancy(occupancy: &Occupancy) -> Self {
        // One free voxel on every side, so that the border of the grid is a border of the occupied set.
        let inner = occupancy.grid;
        let grid =
            Grid { origin: inner.origin - inner.voxel_mm, voxel_mm: inner.voxel_mm, dims: inner.dims.map(|n| n + 2) };
        let mut occupied = vec![false; grid.len()];
        for index in occupancy.indices() {
            occupied[grid.index(inner.coordinates(index).map(|k| k + 1))] = true;
        }
        let outside = squared_distance_to(&occupied, &grid, true);
        let inside = squared_distance_to(&occupied, &grid, false);
        let signed =
            |(o, i): (&f32, &f32)| (o.sqrt() - i.sqrt() - if *o > 0.0 { 0.5 } else { -0.5 }) * grid.voxel_mm as f32;
        let values = outside.iter().zip(&inside).map(signed).collect();
        Self { grid, values }
    }

    /// Signed distance of a point \[mm\], negative inside. Outside the sampled box: the distance at the nearest point of
    /// the box plus the way there (exact in sign, never smaller than the truth by more than the box's own error).
    pub fn distance(&self, point: DVec3) -> f64 {
        let held = self.held(point);
        self.interpolate(held).0 + held.distance(point)
    }

    /// Gradient of the distance at a point: the outward direction, about unit length near the surface.
    pub fn gradient(&self, point: DVec3) -> DVec3 {
        self.interpolate(self.held(point)).1
    }

    /// Distance \[mm\] and gradient in one look-up.
    pub fn distance_and_gradient(&self, point: DVec3) -> (f64, DVec3) {
        let held = self.held(point);
        let (value, gradient) = self.interpolate(held);
        (value + held.distance(point), gradient)
    }

    /// The nearest point of the box spanned by the samples.
    fn held(&self, point: DVec3) -> DVec3 {
        let half = self.grid.voxel_mm * 0.5;
        let [nx, ny, nz] = self.grid.dims.map(|n| n as f64 * self.grid.voxel_mm - half);
        point.clamp(self.grid.origin + half, self.grid.origin + DVec3::new(nx, ny, nz))
    }

    fn interpolate(&self, point: DVec3) -> (f64, DVec3) {
        let c = self.grid.continuous(point) - 0.5;
        let base = [0, 1, 2].map(|k| (c[k].max(0.0) as usize).min(self.grid.dims[k] - 2));
        let t = DVec3::new(c.x - base[0] as f64, c.y - base[1] as f64, c.z - base[2] as f64);
        let at = |dx, dy, dz| f64::from(self.values[self.grid.index([base[0] + dx, base[1] + dy, base[2] + dz])]);
        let mix = |a: f64, b: f64, s: f64| a + (b - a) * s;
        let v = [0, 1].map(|z| [0, 1].map(|y| [0, 1].map(|x| at(x, y, z))));
        let along_x = v.map(|plane| plane.map(|row| mix(row[0], row[1], t.x)));
        let along_xy = along_x.map(|plane| mix(plane[0], plane[1], t.y));
        let slope_x = v.map(|plane| mix(plane[0][1] - plane[0][0], plane[1][1] - plane[1][0], t.y));
        let slope_y = along_x.map(|plane| plane[1] - plane[0]);
        let gradient =
            DVec3::new(mix(slope_x[0], slope_x[1], t.z), mix(slope_y[0], slope_y[1], t.z), along_xy[1] - along_xy[0]);
        (mix(along_xy[0], along_xy[1], t.z), gradient / self.grid.voxel_mm)
    }
}

/// Squared distance, in voxels, of every voxel to the nearest one whose value is `wanted`.
fn squared_distance_to(values: &[bool], grid: &Grid, wanted: bool) -> Vec<f32> {
    // Large, and still exact in sums of squares of f32.
    const FAR: f32 = 1e12;
    let mut squared: Vec<f32> = values.iter().map(|&v| if v == wanted { 0.0 } else { FAR }).collect();
    let strides = [1, grid.dims[0], grid.dims[0] * grid.dims[1]];
    for (n, stride) in grid.dims.into_iter().zip(strides) {
        let mut line = vec![0.0; n];
        for start in 0..grid.len() {
            if start / stride % n != 0 {
                continue;
            }
            for (k, value) in line.iter_mut().enumerate() {
                *value = squared[start + k * stride];
            }
            for (k, value) in lower_envelope(&line).into_iter().enumerate() {
                squared[start + k * stride] = value;
            }
        }
    }
    squared
}

/// min over j of (i − j)² + f(j), for every i.
fn lower_envelope(f: &[f32]) -> Vec<f32> {
    let n = f.len();
    let crossing = |q: usize, p: usize| {
        let (a, b) = (f64::from(f[q]) + (q * q) as f64, f64::from(f[p]) + (p * p) as f64);
        (a - b) / (2.0 * (q as f64 - p as f64))
    };
    let mut parabolas: Vec<(usize, f64)> = vec![(0, f64::NEG_INFINITY)];
    for q in 1..n {
        let mut from = f64::NEG_INFINITY;
        while let Some(&(p, start)) = parabolas.last() {
            from = crossing(q, p);
            if from > start || parabolas.len() == 1 {
                break;
            }
            parabolas.pop();
        }
        parabolas.push((q, from));
    }
    let mut k = 0;
    (0..n)
        .map(|i| {
            while k + 1 < parabolas.len() && parabolas[k + 1].1 <= i as f64 {
                k += 1;
            }
            let p = parabolas[k].0;
            let d = i as f32 - p as f32;
            d * d + f[p]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitives::icosphere;

    #[test]
    fn a_sphere_has_its_distance_inside_and_outside() {
        let centre = DVec3::new(4.0, 70.0, -8.0);
        let field = SignedDistance::from_mesh(&icosphere(centre, 60.0, 4), 3.0, 12.0);
        for i in 0..400 {
            let t = i as f64;
            let direction = DVec3::new((t * 1.7).sin(), (t * 2.3).cos(), (t * 0.9).sin()).normalize();
            for radius in [35.0, 58.0, 60.0, 66.0] {
                let point = centre + direction * radius;
                let (distance, gradient) = field.distance_and_gradient(point);
                assert!((distance - (radius - 60.0)).abs() < 0.3, "{distance} at {radius}");
                // Deep inside, the nearest facet of the polyhedron is rarely the one straight ahead.
                assert!(radius < 50.0 || gradient.normalize().dot(direction) > 0.99, "{gradient} at {radius}");
            }
            let far = field.distance(centre + direction * 400.0);
            assert!((330.0..=420.0).contains(&far), "{far}");
        }
    }

    #[test]
    fn the_distance_of_an_occupied_ball_is_that_of_the_ball() {
        let grid = Grid { origin: DVec3::new(-50.0, -40.0, -45.0), voxel_mm: 2.0, dims: [50, 44, 46] };
        let mut ball = Occupancy::empty(grid);
        for i in 0..grid.len() {
            ball.set(i, grid.centre_of_index(i).length() < 30.0);
        }
        let field = SignedDistance::from_occupancy(&ball);
        for i in 0..300 {
            let t = i as f64;
            let direction = DVec3::new((t * 1.7).sin(), (t * 2.3).cos(), (t * 0.9).sin()).normalize();
            for radius in [5.0, 20.0, 29.0, 36.0] {
                let distance = field.distance(direction * radius);
                assert!((distance - (radius - 30.0)).abs() < 1.6, "{distance} at {radius}");
            }
        }
    }

    #[test]
    fn the_gradient_is_the_derivative_of_the_distance() {
        let field = SignedDistance::from_mesh(&icosphere(DVec3::ZERO, 20.0, 3), 2.0, 6.0);
        let point = DVec3::new(9.3, 12.1, 13.4);
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            let numeric = (field.distance(point + axis * 1e-4) - field.distance(point - axis * 1e-4)) / 2e-4;
            assert!((numeric - field.gradient(point).dot(axis)).abs() < 1e-6);
        }
    }
}
