//! Banded matrices without symmetry, and their LU factorisation with partial pivoting.
//!
//! Row i holds the columns i−w .. i+2w for the half-bandwidth w; the last w of them are room for what pivoting fills in.
//! The layout and the order of the swaps are those of LAPACK's `gbtrf` and `gbtrs`.
//!
//! Reference: Golub, Van Loan 2013, algorithm 4.3.1 with row interchanges (section 4.3.3).

use std::ops::{Index, IndexMut};

/// A square banded matrix of doubles, or its factor.
#[derive(Clone, Debug, Default)]
pub struct BandMatrix {
    size: usize,
    half_width: usize,
    entries: Vec<f64>,
    pivots: Vec<usize>,
}

impl BandMatrix {
    /// A matrix of zeros, `size` × `size`, whose entries (i, j) may differ from zero for |i − j| ≤ `half_width`.
    pub fn zeros(size: usize, half_width: usize) -> Self {
        Self { size, half_width, entries: vec![0.0; size * (3 * half_width + 1)], pivots: Vec::with_capacity(size) }
    }

    /// Rows.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Largest |i − j| of an entry.
    pub fn half_width(&self) -> usize {
        self.half_width
    }

    /// Makes all entries zero.
    pub fn clear(&mut self) {
        self.entries.fill(0.0);
        self.pivots.clear();
    }

    /// Where entry (i, j) lies, j in i−w ..= i+2w.
    #[inline]
    fn at(&self, (i, j): (usize, usize)) -> usize {
        debug_assert!(j + self.half_width >= i && j <= i + 2 * self.half_width, "({i}, {j}) is outside of the band");
        i * (3 * self.half_width + 1) + j + self.half_width - i
    }

    /// Factors in place: P A = L U. `false` if the matrix is singular or not finite; the entries are then of no use.
    #[must_use]
    pub fn factor(&mut self) -> bool {
        let (n, w) = (self.size, self.half_width);
        self.pivots.clear();
        for k in 0..n {
            let (below, right) = ((k + w + 1).min(n), (k + 2 * w + 1).min(n));
            let size = |i: usize| self[(i, k)].abs();
            let pivot = (k..below).fold(k, |best, i| if size(i) > size(best) { i } else { best });
            self.pivots.push(pivot);
            let largest = self[(pivot, k)];
            if largest == 0.0 || !largest.is_finite() {
                return false;
            }
            if pivot != k {
                for j in k..right {
                    let (a, b) = (self.at((k, j)), self.at((pivot, j)));
                    self.entries.swap(a, b);
                }
            }
            for i in k + 1..below {
                let multiplier = self[(i, k)] / largest;
                self[(i, k)] = multiplier;
                for j in k + 1..right {
                    let pulled = multiplier * self[(k, j)];
                    self[(i, j)] -= pulled;
                }
            }
        }
        true
    }

    /// Solves A y = y in place with the factor of [`BandMatrix::factor`]. `y` has one entry a row.
    pub fn solve(&self, y: &mut [f64]) {
        let (n, w) = (self.size, self.half_width);
        for (k, &pivot) in self.pivots.iter().enumerate() {
            y.swap(k, pivot);
            for i in k + 1..(k + w + 1).min(n) {
                y[i] -= self[(i, k)] * y[k];
            }
        }
        for k in (0..n).rev() {
            let known: f64 = (k + 1..(k + 2 * w + 1).min(n)).map(|j| self[(k, j)] * y[j]).sum();
            y[k] = (y[k] - known) / self[(k, k)];
        }
    }
}

impl Index<(usize, usize)> for BandMatrix {
    type Output = f64;
    fn index(&self, entry: (usize, usize)) -> &f64 {
        &self.entries[self.at(entry)]
    }
}

impl IndexMut<(usize, usize)> for BandMatrix {
    fn index_mut(&mut self, entry: (usize, usize)) -> &mut f64 {
        let at = self.at(entry);
        &mut self.entries[at]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    #[test]
    fn systems_that_need_pivots_are_solved() {
        let mut random = Pcg64Mcg::seed_from_u64(7);
        for (n, w) in [(1, 0), (2, 1), (12, 11), (40, 3), (60, 11)] {
            let mut a = BandMatrix::zeros(n, w);
            let x: Vec<f64> = (0..n).map(|_| random.random_range(-1.0..1.0)).collect();
            let mut y = vec![0.0; n];
            for i in 0..n {
                for j in i.saturating_sub(w)..(i + w + 1).min(n) {
                    // No help from the diagonal.
                    a[(i, j)] = if i == j && w > 0 { 0.0 } else { random.random_range(-1.0..1.0) };
                    y[i] += a[(i, j)] * x[j];
                }
            }
            assert!(a.factor());
            a.solve(&mut y);
            let error = x.iter().zip(&y).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(error < 1e-10, "{n} × {n}, half-width {w}: {error:.1e}");
        }
    }

    #[test]
    fn a_singular_matrix_is_told() {
        let mut a = BandMatrix::zeros(3, 1);
        (a[(0, 0)], a[(1, 1)]) = (1.0, 2.0);
        assert!(!a.factor());
    }
}
