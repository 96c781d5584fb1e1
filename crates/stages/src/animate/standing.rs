//! What stands still below the head and hair lies on: the shoulders, as far as hulls and hair volumes tell.

use glam::DVec3;
use rayon::prelude::*;
use strandflow_core::{Occupancy, TriMesh};
use strandflow_geometry::surface_nets::surface;
use strandflow_volume::{carve::largest_component, velocity::dilated, visibility::without_layers};

/// Distance from the head below which a voxel is the head's \[mm\].
const HEAD_MM: f64 = 12.0;

/// Hulls are larger than what is in them: so much is taken off \[mm\].
const SHELL_MM: f64 = 4.0;

/// Pieces thinner than twice this are no shoulders: hulls of hair have such where no hair is \[mm\].
const THIN_MM: f64 = 10.0;

/// Less than this below the head is none \[litres\]: the hollow within long hair, which no view sees, has 0.8.
const LEAST_LITRES: f64 = 2.0;

/// Side of the samples of the surface \[mm\].
const SAMPLE_MM: f64 = 6.0;

/// Gathers, over some frames, what lies in every hull and mostly in neither hair nor head.
pub struct Standing {
    always: Occupancy,
    free: Vec<u16>,
    frames: u16,
}

impl Standing {
    /// Begins with the hull of a frame.
    pub fn new(hull: &Occupancy) -> Self {
        Self { always: hull.clone(), free: vec![0; hull.grid.len()], frames: 0 }
    }

    /// Takes in a frame: its hull, the voxels of its hair volume, and the signed distance to the head there, world \[mm\].
    pub fn see(&mut self, hull: &Occupancy, hair: &[u32], head: impl Fn(DVec3) -> f64 + Sync) {
        let grid = hull.grid;
        self.always.words.iter_mut().zip(&hull.words).for_each(|(all, one)| *all &= one);
        let mut is_hair = Occupancy::empty(grid);
        hair.iter().for_each(|&voxel| is_hair.set(voxel as usize, true));
        let always = &self.always;
        let is_free = |i: usize| always.get(i) && !is_hair.get(i) && head(grid.centre_of_index(i)) > HEAD_MM;
        self.free.par_iter_mut().enumerate().for_each(|(i, count)| *count += u16::from(is_free(i)));
        self.frames += 1;
    }

    /// Its surface in the world \[mm\] and its size \[litres\]; `None` where nothing of that size lies `below` the head.
    pub fn surface(self, below: impl Fn(DVec3) -> bool) -> Option<(TriMesh, f64)> {
        let grid = self.always.grid;
        let layers = |mm: f64| (mm / grid.voxel_mm).ceil() as usize;
        let mut body = without_layers(&self.always, layers(SHELL_MM));
        for (i, &count) in self.free.iter().enumerate() {
            if 2 * count <= self.frames {
                body.set(i, false);
            }
        }
        let thick = layers(THIN_MM);
        body = largest_component(&without_layers(&body, thick));
        for _ in 0..thick {
            body = dilated(&body);
        }
        let litre = 1e6 / grid.voxel_mm.powi(3);
        let lower = body.indices().filter(|&i| below(grid.centre_of_index(i))).count() as f64 / litre;
        let litres = body.indices().count() as f64 / litre;
        (lower >= LEAST_LITRES).then(|| (surface(&body, (SAMPLE_MM / grid.voxel_mm).round().max(1.0) as usize), litres))
    }
}

#[cfg(test)]
mod tests {
    use strandflow_core::Grid;

    use super::*;

    /// A head on a chest, and hair that hangs before the chest on one side in half of the frames.
    #[test]
    fn a_chest_is_found_without_head_and_hair_and_a_lone_head_has_none() {
        let grid = Grid { origin: DVec3::new(-160.0, -80.0, -320.0), voxel_mm: 5.0, dims: [64, 32, 80] };
        let chest = |p: DVec3| p.z < -90.0 && p.z > -300.0 && p.x.abs() < 150.0 && p.y.abs() < 70.0;
        let head = |p: DVec3| p.length() - 50.0;
        let hull_of = |chest: &dyn Fn(DVec3) -> bool| {
            let mut hull = Occupancy::empty(grid);
            let inside = |i: &usize| chest(grid.centre_of_index(*i)) || head(grid.centre_of_index(*i)) < 12.0;
            (0..grid.len()).filter(inside).for_each(|i| hull.set(i, true));
            hull
        };
        let found = |hull: &Occupancy| {
            let mut standing = Standing::new(hull);
            for frame in 0..4 {
                let hangs = |i: &u32| frame % 2 == 0 && grid.centre_of_index(*i as usize).x > 0.0;
                standing.see(hull, &(0..grid.len() as u32).filter(hangs).collect::<Vec<_>>(), head);
            }
            standing.surface(|p| p.z < -70.0)
        };
        let (mesh, litres) = found(&hull_of(&chest)).unwrap();
        assert!(mesh.vertices.iter().all(|v| v.z < -80.0 && v.x < 10.0), "the side where hair hangs is left out");
        assert!((litres - 3.7).abs() < 0.3, "{litres} litres");
        assert!(found(&hull_of(&|_| false)).is_none());
    }
}
