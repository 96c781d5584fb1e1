//! Work on things that lie in space in an order in which neighbours follow one another, so that memory which one of them
//! has brought into the cache serves the next.

use glam::{UVec3, Vec3};
use rayon::prelude::*;

/// Things that one thread takes at least: enough for neighbours to meet.
const TOGETHER: usize = 32;

/// `work` of every place, in the order of the places. It is done in parallel, and along a space-filling curve; the result
/// does not depend on either. Places \[mm\]; those that are not finite come first.
///
/// Reference: Morton 1966 (the curve).
pub fn map_places<T: Send>(places: &[Vec3], work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let mut done: Vec<(usize, T)> =
        along_curve(places).into_par_iter().with_min_len(TOGETHER).map(|i| (i, work(i))).collect();
    done.sort_unstable_by_key(|(i, _)| *i);
    done.into_iter().map(|(_, result)| result).collect()
}

/// The numbers of the places along the curve.
fn along_curve(places: &[Vec3]) -> Vec<usize> {
    let finite = || places.iter().filter(|place| place.is_finite());
    let (low, high) = finite().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(a, b), p| (a.min(*p), b.max(*p)));
    let scale = 1023.0 / (high - low).max_element().max(1e-3);
    let key = |i: &usize| if places[*i].is_finite() { morton(((places[*i] - low) * scale).as_uvec3()) } else { 0 };
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by_cached_key(key);
    order
}

/// The bits of three numbers below 1024 in turns.
fn morton(cell: UVec3) -> u32 {
    let spread = |n: u32| (0..10).fold(0, |bits, k| bits | (n >> k & 1) << (3 * k));
    spread(cell.x) | spread(cell.y) << 1 | spread(cell.z) << 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_stand_in_the_order_of_the_places_whatever_these_are() {
        let mut places: Vec<Vec3> = (0..500).map(|i| Vec3::new((i * 37 % 101) as f32, (i % 7) as f32, 1.0)).collect();
        places[3] = Vec3::NAN;
        assert_eq!(map_places(&places, |i| i), (0..500).collect::<Vec<_>>());
        assert_eq!(map_places(&places[..1], |i| i), [0]);
        assert!(map_places(&[], |i| i).is_empty());
    }

    #[test]
    fn neighbours_follow_one_another() {
        let places: Vec<Vec3> = (0..4096).map(|i| Vec3::new((i % 64) as f32, (i / 64) as f32, 0.0)).collect();
        let way = |order: &[usize]| order.windows(2).map(|w| places[w[0]].distance(places[w[1]])).sum::<f32>();
        let mixed: Vec<usize> = (0..4096).map(|i| i * 1051 % 4096).collect();
        assert!(way(&along_curve(&places)) < 0.05 * way(&mixed));
    }
}
