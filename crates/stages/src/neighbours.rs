//! The strands around a strand, by their roots.

use glam::DVec3;

/// The `count` candidates whose roots are nearest to that of strand `n` (itself left out, as are roots that are not finite):
/// (squared distance \[mm²\], strand), nearest first; ties by number.
pub(crate) fn nearest_roots(roots: &[DVec3], n: usize, candidates: &[usize], count: usize) -> Vec<(f64, usize)> {
    let mut near: Vec<(f64, usize)> = candidates
        .iter()
        .filter(|&&m| m != n)
        .map(|&m| (roots[m].distance_squared(roots[n]), m))
        .filter(|(d, _)| d.is_finite())
        .collect();
    let order = |a: &(f64, usize), b: &(f64, usize)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    if 0 < count && count < near.len() {
        near.select_nth_unstable_by(count - 1, order);
    }
    near.truncate(count);
    near.sort_unstable_by(order);
    near
}
