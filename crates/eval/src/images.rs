//! Scores in the images: masks, and 2D orientations.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use strandflow_core::{Mask, Plane};

use crate::raster::{NO_STRAND, StrandView};
use crate::statistics::{Summary, share};

/// A pixel is inside a mask from this value on.
const INSIDE: u8 = 128;

/// Intersection over union of the pixels inside; 1 where both are empty.
pub fn mask_iou(found: &Mask, truth: &Mask) -> f64 {
    let pairs = found.data.iter().zip(&truth.data).map(|(a, b)| (*a >= INSIDE, *b >= INSIDE));
    let (both, either) = pairs.fold((0, 0), |(i, u), (a, b)| (i + usize::from(a && b), u + usize::from(a || b)));
    if either == 0 { 1.0 } else { share(both, either) }
}

/// Agreement of a mask of coverages with itself smoothed by one pixel (binomial of five): what a perfect estimate of the
/// coverage reaches where single pixels of the truth are a matter of chance, as with few samples a pixel or single hairs.
pub fn iou_with_itself_smoothed(truth: &Mask) -> f64 {
    let (width, height) = (truth.width as isize, truth.height as isize);
    let at =
        |plane: &[f32], x: isize, y: isize| plane[(y.clamp(0, height - 1) * width + x.clamp(0, width - 1)) as usize];
    let pass = |plane: &[f32], (dx, dy): (isize, isize)| -> Vec<f32> {
        let weighed = |k: isize| [6.0, 4.0, 1.0][k.unsigned_abs()] / 16.0;
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        pixels.map(|(x, y)| (-2..=2).map(|k| weighed(k) * at(plane, x + k * dx, y + k * dy)).sum()).collect()
    };
    let coverage: Vec<f32> = truth.data.iter().map(|&m| f32::from(m)).collect();
    let smooth = pass(&pass(&coverage, (1, 0)), (0, 1));
    mask_iou(&Plane { data: smooth.into_iter().map(|m| m.round() as u8).collect(), ..*truth }, truth)
}

/// Intersection over union of one kind of mask over views and frames.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MaskScores {
    /// Per frame and view; the frames as given.
    pub iou: Vec<Vec<f64>>,
    /// Smallest.
    pub min: f64,
    /// Mean.
    pub mean: f64,
    /// What the truth reaches against itself ([`iou_with_itself_smoothed`]): smallest and mean.
    pub truth_smoothed: Option<(f64, f64)>,
}

/// Scores masks of shape (frames, views) against true ones of the same shape.
pub fn evaluate_masks(found: &[Vec<&Mask>], truth: &[Vec<&Mask>]) -> MaskScores {
    let iou: Vec<Vec<f64>> = found
        .par_iter()
        .zip(truth)
        .map(|(found, truth)| found.iter().zip(truth).map(|(a, b)| mask_iou(a, b)).collect())
        .collect();
    mask_scores(iou)
}

/// The summary of ratios computed by [`mask_iou`] one by one, shape (frames, views).
pub fn mask_scores(iou: Vec<Vec<f64>>) -> MaskScores {
    let summary = Summary::of(iou.iter().flatten().copied());
    MaskScores { min: summary.min, mean: summary.mean, iou, truth_smoothed: None }
}

/// 2D orientation errors \[degrees\], undirected.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OrientationScores {
    /// Over all pixels with a confidence above zero on which a true strand is nearest.
    pub all: Summary,
    /// Over the more confident half of them.
    pub confident_half: Summary,
    /// Over the more confident three fifths of them.
    pub confident_three_fifths: Summary,
    /// Reliability: the pixels in ten equal parts by rising confidence, (mean confidence, mean error) of each.
    pub tenths: Vec<(f64, f64)>,
    /// Means per view: all, more confident half.
    pub per_view: Vec<(f64, f64)>,
    /// Mean over the pixels weighted by confidence.
    pub weighted_mean: f64,
}

/// Scores orientation maps, one a view: (angle \[rad\], confidence), against what each view truly sees.
///
/// The half is taken over the pixels of all views together for the totals and within each view for the views.
pub fn evaluate_orientation(maps: &[(&Plane<f32>, &Plane<f32>)], truth: &[StrandView]) -> OrientationScores {
    let views: Vec<Vec<(f32, f64)>> = maps
        .par_iter()
        .zip(truth)
        .map(|((angle, confidence), view)| by_falling_confidence(errors(angle, confidence, view)))
        .collect();
    let pooled = by_falling_confidence(views.iter().flatten().copied().collect());
    let weight: f64 = pooled.iter().map(|p| f64::from(p.0)).sum();
    let weighted: f64 = pooled.iter().map(|p| f64::from(p.0) * p.1).sum();
    OrientationScores {
        all: most_confident(&pooled, 1.0),
        confident_half: most_confident(&pooled, 0.5),
        confident_three_fifths: most_confident(&pooled, 0.6),
        tenths: tenths(&pooled),
        per_view: views.iter().map(|v| (most_confident(v, 1.0).mean, most_confident(v, 0.5).mean)).collect(),
        weighted_mean: if weight > 0.0 { weighted / weight } else { 0.0 },
    }
}

fn by_falling_confidence(mut pixels: Vec<(f32, f64)>) -> Vec<(f32, f64)> {
    pixels.sort_by(|a, b| b.0.total_cmp(&a.0));
    pixels
}

/// Errors of this share of the pixels, which are sorted by falling confidence.
fn most_confident(sorted: &[(f32, f64)], share: f64) -> Summary {
    let count = (sorted.len() as f64 * share).ceil() as usize;
    Summary::of(sorted[..count.min(sorted.len())].iter().map(|p| p.1))
}

/// Ten equal parts by rising confidence: mean confidence and mean error.
fn tenths(sorted: &[(f32, f64)]) -> Vec<(f64, f64)> {
    let mean = |part: &[(f32, f64)], of: fn(&(f32, f64)) -> f64| part.iter().map(of).sum::<f64>() / part.len() as f64;
    let bounds = |k: usize| k * sorted.len() / 10;
    let parts = (0..10).rev().map(|k| &sorted[bounds(k)..bounds(k + 1)]).filter(|part| !part.is_empty());
    parts.map(|part| (mean(part, |p| f64::from(p.0)), mean(part, |p| p.1))).collect()
}

/// Agreement of strands with the orientation map of a view that had no part in their making, where there is no truth.
///
/// `drawn` is what that view would see of the strands; pixels count that both have.
pub fn held_out_agreement(drawn: &StrandView, angle: &Plane<f32>, confidence: &Plane<f32>) -> OrientationScores {
    evaluate_orientation(&[(angle, confidence)], std::slice::from_ref(drawn))
}

/// How far the strands that a view would see cover the hair that it does see.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CoverageScores {
    /// Pixels of both over pixels of either.
    pub iou: f64,
    /// Share of the hair's pixels on which a strand is drawn.
    pub hair_covered: f64,
    /// Share of the strands' pixels that lie on hair.
    pub strands_on_hair: f64,
}

/// Scores drawn strands against a hair mask of the same view and frame.
///
/// Strands are drawn two pixels wide: where they stand farther apart than that the hair between them counts as not covered.
pub fn coverage(drawn: &StrandView, hair: &Mask) -> CoverageScores {
    let pixels = drawn.strand.data.iter().zip(&hair.data).map(|(n, h)| (*n != NO_STRAND, *h >= INSIDE));
    let (mut both, mut strand, mut on_hair) = (0, 0, 0);
    for (drawn, hair) in pixels {
        both += usize::from(drawn && hair);
        strand += usize::from(drawn);
        on_hair += usize::from(hair);
    }
    CoverageScores {
        iou: share(both, strand + on_hair - both),
        hair_covered: share(both, on_hair),
        strands_on_hair: share(both, strand),
    }
}

/// Confidence and error \[degrees\] of each pixel that has both.
fn errors(angle: &Plane<f32>, confidence: &Plane<f32>, view: &StrandView) -> Vec<(f32, f64)> {
    let pixels = angle.data.iter().zip(&confidence.data).zip(view.angle.data.iter().zip(&view.strand.data));
    pixels
        .filter(|((_, c), (_, n))| **c > 0.0 && **n != NO_STRAND)
        .map(|((a, c), (b, _))| (*c, undirected_degrees(*a, *b)))
        .collect()
}

/// Angle between two undirected image directions \[degrees, 0 to 90\].
pub fn undirected_degrees(a: f32, b: f32) -> f64 {
    let off = f64::from(a - b).to_degrees().rem_euclid(180.0);
    off.min(180.0 - off)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shifted_square_has_the_known_ratio() {
        let square =
            |at: usize| Plane::from_fn(100, 100, |x, y| if (at..at + 40).contains(&x) && y < 40 { 255 } else { 0 });
        let (a, b) = (square(10), square(20));
        assert_eq!(mask_iou(&a, &a), 1.0);
        assert!((mask_iou(&a, &b) - 30.0 / 50.0).abs() < 1e-12);
        let scores = evaluate_masks(&[vec![&a, &a]], &[vec![&a, &b]]);
        assert_eq!((scores.min, scores.mean), (0.6, 0.8));
    }

    #[test]
    fn a_solid_mask_agrees_with_itself_smoothed_and_a_chequered_one_does_not() {
        let solid = Plane::from_fn(60, 60, |x, y| if (10..50).contains(&x) && (10..50).contains(&y) { 255 } else { 0 });
        assert!(iou_with_itself_smoothed(&solid) > 0.99);
        let chequered = Plane::from_fn(60, 60, |x, y| if (x + y) % 2 == 0 { 160 } else { 120 });
        assert!((iou_with_itself_smoothed(&chequered) - 0.5).abs() < 0.02);
    }

    #[test]
    fn strands_over_half_of_the_hair() {
        let drawn = StrandView {
            depth: Plane::filled(10, 10, 1.0),
            angle: Plane::filled(10, 10, 0.0),
            strand: Plane::from_fn(10, 10, |x, _| if x < 4 { 7 } else { NO_STRAND }),
        };
        let hair = Plane::from_fn(10, 10, |x, _| if (1..7).contains(&x) { 200 } else { 0 });
        let scores = coverage(&drawn, &hair);
        let wanted = CoverageScores { iou: 3.0 / 7.0, hair_covered: 0.5, strands_on_hair: 0.75 };
        assert_eq!(scores, wanted);
    }

    #[test]
    fn angles_wrap_and_confidence_chooses_the_half() {
        assert!((undirected_degrees(0.02, 3.12) - 2.383).abs() < 0.01);
        let view = StrandView {
            depth: Plane::filled(10, 10, 1.0),
            angle: Plane::filled(10, 10, 0.5),
            strand: Plane::from_fn(10, 10, |x, _| if x < 8 { 1 } else { NO_STRAND }),
        };
        // Ten degrees off on the left half with high confidence, twenty on the right; beyond that no strand.
        let angle = Plane::from_fn(10, 10, |x, _| 0.5 + if x < 4 { 10f32 } else { 20.0 }.to_radians());
        let confidence = Plane::from_fn(10, 10, |x, _| if x < 4 { 0.9 } else { 0.2 });
        let scores = evaluate_orientation(&[(&angle, &confidence)], &[view]);
        assert!((scores.all.mean - 15.0).abs() < 1e-3 && (scores.confident_half.mean - 10.0).abs() < 1e-3);
        assert_eq!(scores.all.count, 80);
        assert!((scores.confident_three_fifths.mean - (40.0 * 10.0 + 8.0 * 20.0) / 48.0).abs() < 1e-3);
        assert_eq!(scores.tenths.len(), 10);
        assert!((scores.tenths[0].1 - 20.0).abs() < 1e-3 && (scores.tenths[9].1 - 10.0).abs() < 1e-3);
        assert!((scores.weighted_mean - (9.0 + 4.0) / 1.1).abs() < 1e-3);
    }
}
