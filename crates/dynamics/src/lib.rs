//! Strand springs, implicit Euler, exact adjoint, bound-constrained fit and warp.
