//! Symmetric positive definite block-banded systems: 3×3 blocks, three blocks left of the diagonal (half-bandwidth 11).
//!
//! Row i holds the blocks (i, i−d) for d = 0..=3; entry (r, c) of a block at 3 r + c. The factor L of A = L Lᵀ has the
//! same shape, with the reciprocals of its diagonal stored in place of the diagonal. Blocks rather than scalars because
//! one block product is nine independent sums over six loads, which fills the registers of a vector unit.

use crate::lanes::{Lanes, V3};

/// A 3×3 block, row major.
pub type Block<R> = [R; 9];

/// The blocks (i, i−d), d = 0..=3, of one block row.
pub type BlockRow<R> = [Block<R>; 4];

/// A block row of zeros.
#[inline(always)]
pub fn zero_row<R: Lanes>() -> BlockRow<R> {
    [[R::zero(); 9]; 4]
}

/// `a −= b cᵀ`.
#[inline(always)]
fn subtract_product<R: Lanes>(a: &mut Block<R>, b: &Block<R>, c: &Block<R>) {
    for r in 0..3 {
        for s in 0..3 {
            let product = b[3 * r].mul_add(c[3 * s], b[3 * r + 1].mul_add(c[3 * s + 1], b[3 * r + 2] * c[3 * s + 2]));
            a[3 * r + s] -= product;
        }
    }
}

/// Solves X Lᵀ = X in place for the lower triangle `l` with reciprocal diagonal.
#[inline(always)]
pub(crate) fn solve_right<R: Lanes>(x: &mut Block<R>, l: &Block<R>) {
    for r in 0..3 {
        let x0 = x[3 * r] * l[0];
        let x1 = (x[3 * r + 1] - x0 * l[3]) * l[4];
        let x2 = (x[3 * r + 2] - x0 * l[6] - x1 * l[7]) * l[8];
        (x[3 * r], x[3 * r + 1], x[3 * r + 2]) = (x0, x1, x2);
    }
}

/// Cholesky factor of a diagonal block; only its lower triangle is read and written.
#[inline(always)]
fn factor_diagonal<R: Lanes>(a: &mut Block<R>) {
    let one = R::splat(1.0);
    a[0] = one / a[0].sqrt();
    a[3] = a[3] * a[0];
    a[6] = a[6] * a[0];
    a[4] = one / (a[4] - a[3] * a[3]).sqrt();
    a[7] = (a[7] - a[6] * a[3]) * a[4];
    a[8] = one / (a[8] - a[6] * a[6] - a[7] * a[7]).sqrt();
}

/// Factors the rows from `first` on in place; earlier rows and columns are ignored. An indefinite matrix gives NaN.
#[expect(clippy::needless_range_loop, reason = "iterators over vectors lose the vector instructions of their caller")]
#[inline(always)]
pub fn factor<R: Lanes>(a: &mut [BlockRow<R>], first: usize) {
    for i in first..a.len() {
        let (above, rest) = a.split_at_mut(i);
        let row = &mut rest[0];
        // Blocks of the row from left to right: subtract what earlier columns explain, then divide.
        if i >= first + 3 {
            solve_right(&mut row[3], &above[i - 3][0]);
        }
        if i >= first + 2 {
            let mut block = row[2];
            if i >= first + 3 {
                subtract_product(&mut block, &row[3], &above[i - 2][1]);
            }
            solve_right(&mut block, &above[i - 2][0]);
            row[2] = block;
        }
        if i > first {
            let mut block = row[1];
            if i >= first + 3 {
                subtract_product(&mut block, &row[3], &above[i - 1][2]);
            }
            if i >= first + 2 {
                subtract_product(&mut block, &row[2], &above[i - 1][1]);
            }
            solve_right(&mut block, &above[i - 1][0]);
            row[1] = block;
        }
        let mut diagonal = row[0];
        for d in 1..4 {
            if i >= first + d {
                subtract_product(&mut diagonal, &row[d], &row[d]);
            }
        }
        factor_diagonal(&mut diagonal);
        row[0] = diagonal;
    }
}

/// Solves A y = y in place with the factor of [`factor`]; entries before `first` are left alone.
#[inline(always)]
pub fn solve<R: Lanes>(l: &[BlockRow<R>], first: usize, y: &mut [V3<R>]) {
    let n = l.len();
    for i in first..n {
        let mut b = y[i];
        for d in 1..4 {
            if i >= first + d {
                let (block, x) = (&l[i][d], y[i - d]);
                for r in 0..3 {
                    b[r] -= block[3 * r].mul_add(x[0], block[3 * r + 1].mul_add(x[1], block[3 * r + 2] * x[2]));
                }
            }
        }
        let t = &l[i][0];
        b[0] = b[0] * t[0];
        b[1] = (b[1] - t[3] * b[0]) * t[4];
        b[2] = (b[2] - t[6] * b[0] - t[7] * b[1]) * t[8];
        y[i] = b;
    }
    for i in (first..n).rev() {
        let mut b = y[i];
        for d in 1..4 {
            if i + d < n {
                let (block, x) = (&l[i + d][d], y[i + d]);
                for r in 0..3 {
                    b[r] -= block[r].mul_add(x[0], block[r + 3].mul_add(x[1], block[r + 6] * x[2]));
                }
            }
        }
        let t = &l[i][0];
        b[2] = b[2] * t[8];
        b[1] = (b[1] - t[7] * b[2]) * t[4];
        b[0] = (b[0] - t[3] * b[1] - t[6] * b[2]) * t[0];
        y[i] = b;
    }
}
