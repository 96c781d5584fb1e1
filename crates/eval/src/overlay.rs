//! Strands drawn over footage, the picture by which people judge a take.

use glam::{DVec2, Vec3};
use strandflow_core::{Camera, Plane, RgbImage, StrandSequence};
use strandflow_geometry::project::project;

/// How strands are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OverlayColour {
    /// One hue a strand, brightness by confidence.
    Strand,
    /// Green observed, blue diffused, orange simulated, magenta completed.
    Provenance,
}

/// Draws every `every`-th strand of the `t`-th frame of a sequence over an image, the nearest last, with
/// anti-aliased lines one pixel wide. Points that are missing or behind the camera break a line.
pub fn overlay(
    image: &RgbImage,
    camera: &Camera,
    sequence: &StrandSequence,
    t: usize,
    every: usize,
    colour: OverlayColour,
) -> RgbImage {
    let mut canvas = image.map(|p| p.map(f32::from));
    let mut order: Vec<(f64, usize)> = (0..sequence.strand_count)
        .step_by(every.max(1))
        .map(|n| (mean_depth(camera, sequence.strand(t, n)), n))
        .filter(|(depth, _)| depth.is_finite())
        .collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    for (_, n) in order {
        let range = sequence.range(t, n);
        for i in range.start..range.end.saturating_sub(1) {
            let ends = [i, i + 1].map(|k| project(camera, sequence.points[k].as_dvec3()).filter(|p| p.is_finite()));
            if let [Some(a), Some(b)] = ends {
                draw_line(&mut canvas, a, b, colour_of(sequence, i, n, colour));
            }
        }
    }
    canvas.map(|p| p.map(|v| v.round().clamp(0.0, 255.0) as u8))
}

fn mean_depth(camera: &Camera, points: &[Vec3]) -> f64 {
    let finite = points.iter().filter(|p| p.is_finite());
    let (sum, count) = finite.fold((0.0, 0.0), |(sum, count), p| {
        (sum + strandflow_geometry::project::depth(camera, p.as_dvec3()), count + 1.0)
    });
    sum / count
}

fn colour_of(sequence: &StrandSequence, index: usize, strand: usize, colour: OverlayColour) -> [f32; 3] {
    match colour {
        OverlayColour::Strand => {
            // Golden-ratio hues keep neighbours in number apart.
            let hue = (strand as f32 * 0.618_034).fract();
            let bright = 0.45 + 0.55 * sequence.confidence[index].clamp(0.0, 1.0);
            [0.0, 1.0 / 3.0, 2.0 / 3.0].map(|shift| {
                let x = ((hue + shift).fract() * 6.0 - 3.0).abs() - 1.0;
                255.0 * bright * (0.25 + 0.75 * x.clamp(0.0, 1.0))
            })
        }
        OverlayColour::Provenance => match sequence.provenance[index] as u8 {
            1 => [60.0, 230.0, 90.0],
            2 => [80.0, 140.0, 255.0],
            3 => [255.0, 160.0, 40.0],
            4 => [255.0, 70.0, 220.0],
            _ => [160.0; 3],
        },
    }
}

/// Blends a line of one pixel's width: coverage falls off linearly with the distance to the segment.
fn draw_line(canvas: &mut Plane<[f32; 3]>, a: DVec2, b: DVec2, colour: [f32; 3]) {
    let (low, high) = (a.min(b) - 1.0, a.max(b) + 1.0);
    let columns = clip(low.x, high.x, canvas.width);
    for y in clip(low.y, high.y, canvas.height) {
        for x in columns.clone() {
            let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            let along = ((p - a).dot(b - a) / (b - a).length_squared().max(1e-12)).clamp(0.0, 1.0);
            let cover = (1.0 - p.distance(a + (b - a) * along)).max(0.0) as f32 * 0.8;
            let pixel = &mut canvas[(x, y)];
            for (value, &target) in pixel.iter_mut().zip(&colour) {
                *value += cover * (target - *value);
            }
        }
    }
}

fn clip(low: f64, high: f64, size: usize) -> std::ops::Range<usize> {
    (low.floor().max(0.0) as usize).min(size)..(high.ceil().max(0.0) as usize).min(size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use strandflow_core::{Distortion, Provenance, RigidTransform};

    #[test]
    fn a_strand_lands_where_it_projects() {
        let camera = Camera {
            name: "c".into(),
            width: 64,
            height: 48,
            focal: [100.0; 2],
            principal: [32.0, 24.0],
            distortion: Distortion::None,
            camera_from_world: RigidTransform::IDENTITY,
        };
        let mut sequence = StrandSequence::missing(vec![0], vec![2], 2);
        sequence.points = vec![Vec3::new(-10.0, 0.5, 100.0), Vec3::new(10.0, 0.5, 100.0)];
        sequence.provenance = vec![Provenance::Observed; 2];
        let image = RgbImage::filled(64, 48, [0; 3]);
        let drawn = overlay(&image, &camera, &sequence, 0, 1, OverlayColour::Provenance);
        assert!(drawn[(32, 24)][1] > 150 && drawn[(32, 30)] == [0; 3] && drawn[(10, 24)] == [0; 3]);
    }
}
