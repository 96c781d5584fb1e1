//! Evenly spread samples of a surface: many random samples, of which the most crowded are taken out one by one.
//!
//! Reference: Yuksel 2015 (sample elimination for Poisson-disk sets).

use std::{cmp::Ordering, collections::BTreeMap, collections::BinaryHeap};

use glam::DVec3;

/// Indices, rising, of the `count` candidates that are spread most evenly; all where there are not more.
///
/// `area_mm2` is the area of the surface the candidates were drawn from; three or more candidates for each one kept give
/// a nearest-neighbour distance of at least half the densest packing's.
pub fn thin_out(candidates: &[DVec3], count: usize, area_mm2: f64) -> Vec<usize> {
    if candidates.len() <= count || count == 0 {
        return (0..candidates.len().min(count)).collect();
    }
    // Yuksel eq. 4: the radius of the densest packing, twice of which is the reach of the weights.
    let reach = 2.0 * (area_mm2.max(1e-12) / (2.0 * 3f64.sqrt() * count as f64)).sqrt();
    let neighbours = neighbours_within(candidates, reach);
    let weight = |distance: f64| (1.0 - distance / reach).max(0.0).powi(8);
    let mut crowding: Vec<f64> =
        neighbours.iter().map(|near| near.iter().map(|&(_, distance)| weight(distance)).sum()).collect();
    let mut heap: BinaryHeap<Crowded> = crowding.iter().enumerate().map(|(i, &w)| Crowded(w, i)).collect();
    let mut kept = vec![true; candidates.len()];
    let mut left = candidates.len();
    while left > count {
        let Some(Crowded(stored, i)) = heap.pop() else { break };
        if !kept[i] || stored != crowding[i] {
            continue;
        }
        kept[i] = false;
        left -= 1;
        for &(j, distance) in &neighbours[i] {
            if kept[j] {
                crowding[j] -= weight(distance);
                heap.push(Crowded(crowding[j], j));
            }
        }
    }
    (0..candidates.len()).filter(|&i| kept[i]).collect()
}

/// Ordered by crowding, the lower index first where equal.
#[derive(PartialEq)]
struct Crowded(f64, usize);

impl Eq for Crowded {}

impl PartialOrd for Crowded {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Crowded {
    fn cmp(&self, other: &Self) -> Ordering {
        self.0.total_cmp(&other.0).then(other.1.cmp(&self.1))
    }
}

/// For every point the others within `reach`, with their distance.
fn neighbours_within(points: &[DVec3], reach: f64) -> Vec<Vec<(usize, f64)>> {
    let cell = |p: DVec3| (p / reach).floor().to_array().map(|k| k as i64);
    let mut cells: BTreeMap<[i64; 3], Vec<usize>> = BTreeMap::new();
    for (i, &p) in points.iter().enumerate() {
        cells.entry(cell(p)).or_default().push(i);
    }
    let near = |i: usize| {
        let [x, y, z] = cell(points[i]);
        let around =
            (-1..=1).flat_map(|dz| (-1..=1).flat_map(move |dy| (-1..=1).map(move |dx| [x + dx, y + dy, z + dz])));
        around
            .filter_map(|c| cells.get(&c))
            .flatten()
            .filter(|&&j| j != i)
            .map(|&j| (j, points[i].distance(points[j])))
            .filter(|&(_, distance)| distance < reach)
            .collect()
    };
    (0..points.len()).map(near).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kept_samples_keep_their_distance() {
        // A deterministic random square of 100 mm, 2,000 candidates.
        let mut state = 12345u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as f64 / (1u64 << 31) as f64
        };
        let candidates: Vec<DVec3> = (0..2000).map(|_| DVec3::new(random(), random(), 0.0) * 100.0).collect();
        let kept = thin_out(&candidates, 400, 1e4);
        assert_eq!(kept.len(), 400);
        let nearest = |i: usize| {
            kept.iter()
                .filter(|&&j| j != i)
                .map(|&j| candidates[i].distance(candidates[j]))
                .fold(f64::INFINITY, f64::min)
        };
        let least = kept.iter().map(|&i| nearest(i)).fold(f64::INFINITY, f64::min);
        // The densest packing of 400 in the square has 5.37 mm; random points have 0.1 mm or less.
        assert!(least > 2.7, "{least}");
        assert_eq!(kept, thin_out(&candidates, 400, 1e4));
    }
}
