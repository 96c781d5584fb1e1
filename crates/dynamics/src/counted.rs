//! A lane type that counts: the floating-point operations of a kernel are what the kernel does, not an estimate.

use std::{
    cell::Cell,
    ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign},
};

use crate::lanes::Lanes;

thread_local! {
    static OPERATIONS: Cell<u64> = const { Cell::new(0) };
}

/// Operations on [`Counted`] values in this thread since the last call: additions, products, divisions, roots, maxima one
/// each, fused products two. Changes of sign and copies count nothing.
pub fn take_operations() -> u64 {
    OPERATIONS.replace(0)
}

fn count(operations: u64) {
    OPERATIONS.set(OPERATIONS.get() + operations);
}

/// Two `f64` that count what is done to them, each operation once (the second keeps company, so that the kernels take it
/// for a pack and run the code of the packs).
#[derive(Clone, Copy, Debug)]
pub struct Counted(f64);

macro_rules! counted_operator {
    ($trait:ident, $method:ident, $op:tt) => {
        impl $trait for Counted {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                count(1);
                Self(self.0 $op other.0)
            }
        }
    };
}
counted_operator!(Add, add, +);
counted_operator!(Sub, sub, -);
counted_operator!(Mul, mul, *);
counted_operator!(Div, div, /);

impl Neg for Counted {
    type Output = Self;
    fn neg(self) -> Self {
        Self(-self.0)
    }
}
impl AddAssign for Counted {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}
impl SubAssign for Counted {
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl Lanes for Counted {
    const COUNT: usize = 2;

    fn splat(value: f64) -> Self {
        Self(value)
    }
    fn get(&self, _: usize) -> f64 {
        self.0
    }
    fn set(&mut self, _: usize, value: f64) {
        self.0 = value;
    }
    fn mul_add(self, b: Self, c: Self) -> Self {
        count(2);
        Self(self.0 * b.0 + c.0)
    }
    fn sqrt(self) -> Self {
        count(1);
        Self(self.0.sqrt())
    }
    fn at_least_zero(self) -> Self {
        count(1);
        Self(if self.0 > 0.0 { self.0 } else { 0.0 })
    }
    fn where_positive(self, value: Self) -> Self {
        count(1);
        Self(if self.0 > 0.0 { value.0 } else { 0.0 })
    }
}
