//! Points sampled along strands, in cells, for neighbour queries of a few millimetres.
//!
//! A grid of cells beats a tree here: the radius is fixed and small, there are up to two million points a frame, and
//! building is two passes over them.

use glam::Vec3;

/// A point on a strand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrandSample {
    /// Position \[mm\].
    pub position: Vec3,
    /// Unit tangent towards the tip.
    pub tangent: Vec3,
    /// The strand's number as given.
    pub strand: u32,
    /// Position along the strand, in units of its vertices.
    pub parameter: f32,
}

/// Points every `step_mm` or closer along a polyline, both ends included; pieces with a point that is not finite are left out.
pub fn sample_polyline(points: &[Vec3], strand: u32, step_mm: f32, out: &mut Vec<StrandSample>) {
    for (i, pair) in points.windows(2).enumerate() {
        let edge = pair[1] - pair[0];
        let Some(tangent) = edge.try_normalize().filter(|t| t.is_finite()) else { continue };
        let pieces = (edge.length() / step_mm).ceil().max(1.0) as usize;
        let first = if i == 0 { 0 } else { 1 };
        for k in first..=pieces {
            let u = k as f32 / pieces as f32;
            out.push(StrandSample { position: pair[0] + edge * u, tangent, strand, parameter: i as f32 + u });
        }
    }
}

/// Cosine of the undirected angle between two unit vectors.
pub fn undirected_cosine(a: Vec3, b: Vec3) -> f32 {
    a.dot(b).abs()
}

/// Samples sorted into cubic cells.
pub struct SampleIndex {
    cell_mm: f32,
    low: Vec3,
    dims: [i32; 3],
    starts: Vec<u32>,
    samples: Vec<StrandSample>,
}

impl SampleIndex {
    /// Sorts samples into cells of `cell_mm`; samples that are not finite are left out.
    pub fn new(samples: &[StrandSample], cell_mm: f32) -> Self {
        let finite: Vec<&StrandSample> = samples.iter().filter(|s| s.position.is_finite()).collect();
        let low = finite.iter().fold(Vec3::INFINITY, |m, s| m.min(s.position));
        let high = finite.iter().fold(Vec3::NEG_INFINITY, |m, s| m.max(s.position));
        let span = if finite.is_empty() { Vec3::ZERO } else { (high - low) / cell_mm };
        let dims = [span.x as i32 + 1, span.y as i32 + 1, span.z as i32 + 1];
        let mut index = Self { cell_mm, low, dims, starts: Vec::new(), samples: Vec::new() };
        let cells: Vec<usize> = finite.iter().map(|s| index.linear(index.cell(s.position))).collect();
        let mut starts = vec![0u32; dims.iter().map(|d| *d as usize).product::<usize>() + 1];
        cells.iter().for_each(|cell| starts[cell + 1] += 1);
        (1..starts.len()).for_each(|i| starts[i] += starts[i - 1]);
        let mut next = starts.clone();
        let mut order = vec![0u32; finite.len()];
        for (i, cell) in cells.iter().enumerate() {
            order[next[*cell] as usize] = i as u32;
            next[*cell] += 1;
        }
        index.samples = order.iter().map(|&i| *finite[i as usize]).collect();
        index.starts = starts;
        index
    }

    /// All samples, in the order of their cells.
    pub fn samples(&self) -> &[StrandSample] {
        &self.samples
    }

    /// Calls `f(sample, squared distance)` for every sample within `radius_mm`; stops when it returns `false`.
    pub fn within(&self, point: Vec3, radius_mm: f32, mut f: impl FnMut(&StrandSample, f32) -> bool) {
        if self.samples.is_empty() || !point.is_finite() {
            return;
        }
        let (low, high) = (self.cell(point - radius_mm), self.cell(point + radius_mm));
        let range = |axis: usize| low[axis].max(0)..=high[axis].min(self.dims[axis] - 1);
        for z in range(2) {
            for y in range(1) {
                let xs = range(0);
                if xs.is_empty() {
                    return;
                }
                // The cells of a row lie one after the other.
                let first = self.starts[self.linear([*xs.start(), y, z])] as usize;
                let last = self.starts[self.linear([*xs.end(), y, z]) + 1] as usize;
                for sample in &self.samples[first..last] {
                    let squared = sample.position.distance_squared(point);
                    if squared <= radius_mm * radius_mm && !f(sample, squared) {
                        return;
                    }
                }
            }
        }
    }

    /// The nearest sample within `radius_mm` that `accept` takes, and its distance \[mm\].
    pub fn nearest(
        &self,
        point: Vec3,
        radius_mm: f32,
        accept: impl Fn(&StrandSample) -> bool,
    ) -> Option<(StrandSample, f32)> {
        let mut radius = self.cell_mm.min(radius_mm);
        loop {
            let mut best: Option<(StrandSample, f32)> = None;
            self.within(point, radius, |sample, squared| {
                if accept(sample) && best.is_none_or(|(_, least)| squared < least) {
                    best = Some((*sample, squared));
                }
                true
            });
            if best.is_some() || radius >= radius_mm {
                return best.map(|(sample, squared)| (sample, squared.sqrt()));
            }
            radius = (radius * 2.0).min(radius_mm);
        }
    }

    fn cell(&self, point: Vec3) -> [i32; 3] {
        ((point - self.low) / self.cell_mm).floor().as_ivec3().to_array()
    }

    fn linear(&self, [x, y, z]: [i32; 3]) -> usize {
        ((z as usize * self.dims[1] as usize) + y as usize) * self.dims[0] as usize + x as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(count: usize) -> Vec<StrandSample> {
        let mut state = 7u64;
        let mut uniform = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 40) as f32 / (1 << 24) as f32
        };
        (0..count)
            .map(|i| StrandSample {
                position: Vec3::new(uniform(), uniform(), uniform()) * Vec3::new(60.0, 40.0, 90.0),
                tangent: Vec3::X,
                strand: i as u32,
                parameter: 0.0,
            })
            .collect()
    }

    #[test]
    fn queries_agree_with_brute_force() {
        let samples = cloud(3000);
        let index = SampleIndex::new(&samples, 4.0);
        for query in cloud(200).iter().map(|s| s.position * 1.2 - 5.0) {
            for radius in [1.0f32, 4.0, 9.0] {
                let mut found = Vec::new();
                index.within(query, radius, |s, _| {
                    found.push(s.strand);
                    true
                });
                found.sort_unstable();
                let expected: Vec<u32> = samples
                    .iter()
                    .filter(|s| s.position.distance_squared(query) <= radius * radius)
                    .map(|s| s.strand)
                    .collect();
                assert_eq!(found, expected);
            }
            let brute = samples.iter().map(|s| s.position.distance(query)).fold(f32::INFINITY, f32::min);
            assert!((index.nearest(query, 200.0, |_| true).unwrap().1 - brute).abs() < 1e-5);
        }
        assert!(SampleIndex::new(&[], 4.0).nearest(Vec3::ZERO, 10.0, |_| true).is_none());
    }

    #[test]
    fn a_polyline_is_sampled_with_both_ends() {
        let mut out = Vec::new();
        sample_polyline(&[Vec3::ZERO, Vec3::X * 5.0, Vec3::new(5.0, 2.0, 0.0)], 3, 1.0, &mut out);
        assert_eq!(out.len(), 8);
        assert_eq!((out[0].position, out[7].position), (Vec3::ZERO, Vec3::new(5.0, 2.0, 0.0)));
        assert!((out[2].parameter - 0.4).abs() < 1e-6 && out[6].tangent == Vec3::Y);
    }
}
