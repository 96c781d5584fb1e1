//! Scores in space: the hull, and the lines lifted into it.

use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use strandflow_core::{Camera, Grid, Mask, Occupancy, Rig, SparseVoxels};
use strandflow_geometry::project::{project, ray};

use crate::index::{SampleIndex, sample_polyline, undirected_cosine};
use crate::raster::{NO_STRAND, StrandView};
use crate::statistics::{Summary, root_mean_square, share};
use crate::truth::Truth;

/// How a hull holds what it should.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HullScores {
    /// Share of the true hair points (every 2 mm) inside the hull, by voxel.
    pub containment: f64,
    /// The same with one voxel of tolerance.
    pub containment_one_voxel: f64,
    /// Intersection over union with the hull of the true masks at voxel centres.
    pub iou: f64,
}

/// Scores the hull of the `t`-th true frame. `true_subjects`: true subject masks, one a view (empty: no IoU).
pub fn evaluate_hull(hull: &Occupancy, truth: &Truth, t: usize, rig: &Rig, true_subjects: &[&Mask]) -> HullScores {
    let mut samples = Vec::new();
    (0..truth.strand_count()).for_each(|n| sample_polyline(truth.strand(t, n), n as u32, 2.0, &mut samples));
    let inside = |p: Vec3| hull.contains(p.as_dvec3());
    let near = |p: Vec3| {
        let step = hull.grid.voxel_mm as f32;
        [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z].iter().any(|d| inside(p + *d * step) || inside(p - *d * step))
    };
    let rate =
        |f: &(dyn Fn(Vec3) -> bool + Sync)| share(samples.par_iter().filter(|s| f(s.position)).count(), samples.len());
    let iou = if true_subjects.len() == rig.view_count() && rig.view_count() > 0 {
        let expected = hull_of_masks(&hull.grid, rig, true_subjects);
        let words = hull.words.iter().zip(&expected.words);
        let (both, either) =
            words.fold((0, 0), |(i, u), (a, b)| (i + (a & b).count_ones() as usize, u + (a | b).count_ones() as usize));
        share(both, either)
    } else {
        0.0
    };
    HullScores { containment: rate(&inside), containment_one_voxel: rate(&near), iou }
}

/// Voxels whose centres fall inside the masks of all views that see them, at least one.
pub fn hull_of_masks(grid: &Grid, rig: &Rig, masks: &[&Mask]) -> Occupancy {
    let keep = |index: usize| {
        let centre = grid.centre_of_index(index);
        let mut seen = 0;
        for (camera, mask) in rig.cameras.iter().zip(masks) {
            if let Some(value) = project(camera, centre).and_then(|p| mask.at_point(p.x, p.y)) {
                if *value < 128 {
                    return false;
                }
                seen += 1;
            }
        }
        seen > 0
    };
    let mut out = Occupancy::empty(*grid);
    out.words.par_iter_mut().enumerate().for_each(|(w, word)| {
        for bit in 0..64.min(grid.len() - w * 64) {
            *word |= u64::from(keep(w * 64 + bit)) << bit;
        }
    });
    out
}

/// How lifted lines cover the hair and agree with it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LineScores {
    /// Voxels that true strands pass through.
    pub hair_voxels: usize,
    /// Voxels with a line.
    pub lines: usize,
    /// Share of the hair voxels that have a line.
    pub coverage: f64,
    /// Lines over hair voxels, wherever they lie.
    pub ratio: f64,
    /// Share of the lines within 4 mm of a true strand.
    pub on_hair: f64,
    /// Undirected angle to the nearest true strand within 4 mm \[degrees\].
    pub degrees: Summary,
}

/// Scores undirected lines, one a voxel (rising linear `indices` of `grid`), against the `t`-th true frame.
pub fn evaluate_lines(grid: &Grid, indices: &[u32], directions: &[Vec3], truth: &Truth, t: usize) -> LineScores {
    let mut samples = Vec::new();
    (0..truth.strand_count()).for_each(|n| sample_polyline(truth.strand(t, n), n as u32, 1.0, &mut samples));
    let mut hair = Occupancy::empty(*grid);
    for sample in &samples {
        if let Some(voxel) = grid.voxel_at(sample.position.as_dvec3()) {
            hair.set(grid.index(voxel), true);
        }
    }
    let hair_voxels = hair.count();
    let covered = indices.iter().filter(|i| (**i as usize) < grid.len() && hair.get(**i as usize)).count();
    let index = SampleIndex::new(&samples, 4.0);
    let angles: Vec<f64> = indices
        .par_iter()
        .zip(directions)
        .filter_map(|(i, direction)| {
            let centre: DVec3 = grid.centre_of_index(*i as usize);
            let (sample, _) = index.nearest(centre.as_vec3(), 4.0, |_| true)?;
            let cosine = undirected_cosine(sample.tangent, direction.normalize_or_zero());
            Some(f64::from(cosine.min(1.0).acos().to_degrees()))
        })
        .collect();
    LineScores {
        hair_voxels,
        lines: indices.len(),
        coverage: share(covered, hair_voxels),
        ratio: share(indices.len(), hair_voxels),
        on_hair: share(angles.len(), indices.len()),
        degrees: Summary::of(angles),
    }
}

/// How deep a volume lies behind what views truly see first of the hair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SurfaceScores {
    /// Distance along the viewing ray between the volume's first voxel and the nearest true strand \[mm\], over all views.
    pub error_mm: Summary,
    /// Median of volume − truth \[mm\]; negative: the volume is too large.
    pub behind_mm: f64,
}

/// Rays are followed this far to either side of the truth \[mm\]; a volume that is missed there is that far off.
const SURFACE_REACH_MM: f64 = 40.0;

/// Scores the surface of a volume, given by its voxels, against the nearest true strand at every second pixel and row.
pub fn evaluate_surface(volume: &Occupancy, rig: &Rig, truth: &[StrandView]) -> SurfaceScores {
    let off = |camera: &Camera, view: &StrandView, (x, y): (usize, usize)| -> Option<f64> {
        let truth = f64::from(view.depth[(x, y)]);
        (view.strand[(x, y)] != NO_STRAND).then_some(())?;
        let ray = ray(camera, DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
        // Depths count along the optical axis.
        let per_depth = 1.0 / camera.camera_from_world.rotation.row(2).dot(ray.direction);
        let steps = (-2.0 * SURFACE_REACH_MM) as i32..=(2.0 * SURFACE_REACH_MM) as i32;
        let mut places = steps.map(|k| 0.5 * f64::from(k));
        let inside = |place: &f64| volume.contains(ray.origin + ray.direction * (truth + place) * per_depth);
        Some(places.find(inside).unwrap_or(SURFACE_REACH_MM))
    };
    let views = rig.cameras.par_iter().zip(truth).map(|(camera, view)| -> Vec<f64> {
        let pixels = (0..camera.height).step_by(2).flat_map(|y| (0..camera.width).step_by(2).map(move |x| (x, y)));
        pixels.filter_map(|pixel| off(camera, view, pixel)).collect()
    });
    let off: Vec<f64> = views.flatten_iter().collect();
    let behind_mm = Summary::of(off.iter().copied()).median;
    SurfaceScores { error_mm: Summary::of(off.into_iter().map(f64::abs)), behind_mm }
}

/// How well the measured motion between two frames is that of the hair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MotionScores {
    /// Displacement error at true hair points that have a voxel \[mm\].
    pub error_mm: Summary,
    /// Root mean square true displacement there \[mm\].
    pub moved_mm: f64,
    /// Root mean square true displacement beside the head's \[mm\].
    pub beside_head_mm: f64,
    /// Root mean square error over that: 1 is as good as knowing the head's motion alone.
    pub unexplained: f64,
}

/// Scores displacements since the frame before, on voxels of `grid`, at true hair points every 4 mm of the stable strands.
pub fn evaluate_motion(motion: &SparseVoxels<Vec3>, truth: &Truth, before: usize, t: usize) -> MotionScores {
    let pose = |t: usize| truth.world_from_head.get(truth.frames[t] as usize).copied().unwrap_or_default();
    let rigid = pose(t).after(&pose(before).inverse());
    let (mut errors, mut moved, mut beside) = (Vec::new(), Vec::new(), Vec::new());
    for n in (0..truth.strand_count()).filter(|n| truth.stable[*n]) {
        let pairs = truth.strand(before, n).windows(2).zip(truth.strand(t, n).windows(2));
        for (from, to) in pairs {
            let pieces = (to[0].distance(to[1]) / 4.0).ceil().max(1.0) as usize;
            for k in 0..pieces {
                let s = (k as f32 + 0.5) / pieces as f32;
                let (from, to) = (from[0].lerp(from[1], s), to[0].lerp(to[1], s));
                let Some(voxel) = motion.grid.voxel_at(to.as_dvec3()) else { continue };
                let Some(found) = motion.get(motion.grid.index(voxel)) else { continue };
                errors.push(f64::from((*found - (to - from)).length()));
                moved.push(f64::from((to - from).length()));
                beside.push(f64::from(to.distance(rigid.point(from.as_dvec3()).as_vec3())));
            }
        }
    }
    let rms = root_mean_square(errors.iter().copied());
    let beside_head_mm = root_mean_square(beside.iter().copied());
    let unexplained = if beside_head_mm > 0.0 { rms / beside_head_mm } else { 0.0 };
    MotionScores {
        error_mm: Summary::of(errors),
        moved_mm: root_mean_square(moved.iter().copied()),
        beside_head_mm,
        unexplained,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curtain() -> Truth {
        let strand = |n: usize| (0..11).map(move |p| Vec3::new(4.0 * n as f32 + 21.0, 21.0, 21.0 + 2.0 * p as f32));
        Truth {
            frames: vec![0],
            points: vec![(0..5).flat_map(strand).collect()],
            offsets: (0..=5).map(|n| n * 11).collect(),
            stable: vec![true; 5],
            ..Truth::default()
        }
    }

    #[test]
    fn coverage_and_angle_are_those_put_in() {
        let truth = curtain();
        let grid = Grid { origin: DVec3::ZERO, voxel_mm: 2.0, dims: [40, 40, 40] };
        // Lines on one strand in five, tilted by 12 degrees.
        let indices: Vec<u32> = (10..21).map(|z| grid.index([10, 10, z]) as u32).collect();
        let tilt = 12f32.to_radians();
        let scores = evaluate_lines(&grid, &indices, &[Vec3::new(0.0, tilt.sin(), -tilt.cos()); 11], &truth, 0);
        assert_eq!(scores.hair_voxels, 55);
        assert!((scores.coverage - 0.2).abs() < 1e-9 && (scores.degrees.mean - 12.0).abs() < 1e-3);
        assert_eq!(scores.on_hair, 1.0);
    }

    #[test]
    fn a_slab_before_the_hair_has_its_distance_along_the_rays() {
        // A view along +z from far; hair at a depth of 1000 mm, the slab's face 6 mm before it.
        let camera = Camera {
            name: "c".into(),
            width: 40,
            height: 40,
            focal: [1000.0; 2],
            principal: [20.0; 2],
            distortion: strandflow_core::Distortion::None,
            camera_from_world: strandflow_core::RigidTransform::IDENTITY,
        };
        let view = StrandView {
            depth: strandflow_core::Plane::filled(40, 40, 1000.0),
            angle: strandflow_core::Plane::filled(40, 40, 0.0),
            strand: strandflow_core::Plane::filled(40, 40, 1),
        };
        let grid = Grid { origin: DVec3::new(-40.0, -40.0, 994.0), voxel_mm: 2.0, dims: [40, 40, 20] };
        let mut slab = Occupancy::empty(grid);
        (0..grid.len()).for_each(|i| slab.set(i, true));
        let rig = Rig { cameras: vec![camera] };
        let scores = evaluate_surface(&slab, &rig, std::slice::from_ref(&view));
        assert_eq!(scores.error_mm.count, 400);
        assert!((scores.error_mm.mean - 6.0).abs() < 0.6 && (scores.behind_mm + 6.0).abs() < 0.6, "{scores:?}");
        let missed = evaluate_surface(&Occupancy::empty(grid), &rig, &[view]);
        assert_eq!((missed.error_mm.min, missed.behind_mm), (SURFACE_REACH_MM, SURFACE_REACH_MM));
    }

    #[test]
    fn a_hull_that_misses_a_strand_holds_four_fifths() {
        let grid = Grid { origin: DVec3::ZERO, voxel_mm: 2.0, dims: [40, 40, 40] };
        let mut hull = Occupancy::empty(grid);
        (0..grid.len()).filter(|i| grid.coordinates(*i)[0] < 18).for_each(|i| hull.set(i, true));
        let scores = evaluate_hull(&hull, &curtain(), 0, &Rig::default(), &[]);
        assert!((scores.containment - 0.8).abs() < 1e-9, "{}", scores.containment);
    }
}
