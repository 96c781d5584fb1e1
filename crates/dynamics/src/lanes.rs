//! The arithmetic of the kernels: one value, or one value for each of several independent problems.
//!
//! Every kernel of this crate is written once over [`Lanes`]. With `f64` it is the scalar reference that the golden
//! vectors test; with a pack of `f32` one lane is one strand and all lanes run the same instructions. Packs are thin
//! wrappers around the machine's vector types: arrays of floats left to the auto-vectoriser are split into scalars
//! before it sees them, and the deep expressions of the altitude springs do not come back together.
//!
//! Every function here is `inline(always)`: the instructions must end up inside the one function that enables them
//! (see `dispatch`).

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use wide::f32x4;

/// A number, or a pack of numbers treated alike.
pub trait Lanes:
    Copy
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
{
    /// How many problems one value holds.
    const COUNT: usize;

    /// The same value in every lane.
    fn splat(value: f64) -> Self;
    /// One lane's value.
    fn get(&self, lane: usize) -> f64;
    /// Sets one lane.
    fn set(&mut self, lane: usize, value: f64);
    /// `self · b + c`, fused where the instruction set has it.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Lane-wise maximum with zero.
    fn at_least_zero(self) -> Self;
    /// `value` in the lanes where `self` > 0, zero elsewhere.
    fn where_positive(self, value: Self) -> Self;

    /// `a` in the lanes where `self` > 0, `b` elsewhere.
    #[inline(always)]
    fn choose(self, a: Self, b: Self) -> Self {
        self.where_positive(a) + (-self).where_positive(b)
    }

    /// Zero.
    #[inline(always)]
    fn zero() -> Self {
        Self::splat(0.0)
    }
}

impl Lanes for f64 {
    const COUNT: usize = 1;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn get(&self, _: usize) -> f64 {
        *self
    }
    #[inline(always)]
    fn set(&mut self, _: usize, value: f64) {
        *self = value;
    }
    // Not fused: without the instruction it would be a library call.
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        self * b + c
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn at_least_zero(self) -> Self {
        if self > 0.0 { self } else { 0.0 }
    }
    #[inline(always)]
    fn where_positive(self, value: Self) -> Self {
        if self > 0.0 { value } else { 0.0 }
    }
}

/// Four `f32` in one vector of whatever every machine of an architecture has: SSE2, NEON, WebAssembly's; else an array.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub struct Portable(f32x4);

macro_rules! portable_operator {
    ($trait:ident, $method:ident) => {
        impl $trait for Portable {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(self.0.$method(other.0))
            }
        }
    };
}
portable_operator!(Add, add);
portable_operator!(Sub, sub);
portable_operator!(Mul, mul);
portable_operator!(Div, div);

impl Neg for Portable {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}
impl AddAssign for Portable {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}
impl SubAssign for Portable {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl Lanes for Portable {
    const COUNT: usize = 4;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self(f32x4::splat(value as f32))
    }
    #[inline(always)]
    fn get(&self, lane: usize) -> f64 {
        f64::from(self.0.as_array()[lane])
    }
    #[inline(always)]
    fn set(&mut self, lane: usize, value: f64) {
        self.0.as_mut_array()[lane] = value as f32;
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        Self(self.0.mul_add(b.0, c.0))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt())
    }
    #[inline(always)]
    fn at_least_zero(self) -> Self {
        self.where_positive(self)
    }
    #[inline(always)]
    fn where_positive(self, value: Self) -> Self {
        Self(self.0.simd_gt(f32x4::ZERO) & value.0)
    }
}

/// A vector in space.
pub type V3<R> = [R; 3];

/// The zero vector.
#[inline(always)]
pub fn zero3<R: Lanes>() -> V3<R> {
    [R::zero(); 3]
}

/// `a + b`.
#[inline(always)]
pub fn add<R: Lanes>(a: V3<R>, b: V3<R>) -> V3<R> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `a − b`.
#[inline(always)]
pub fn sub<R: Lanes>(a: V3<R>, b: V3<R>) -> V3<R> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `s a`.
#[inline(always)]
pub fn scale<R: Lanes>(s: R, a: V3<R>) -> V3<R> {
    [s * a[0], s * a[1], s * a[2]]
}

/// `s a + b`.
#[inline(always)]
pub fn axpy<R: Lanes>(s: R, a: V3<R>, b: V3<R>) -> V3<R> {
    [s.mul_add(a[0], b[0]), s.mul_add(a[1], b[1]), s.mul_add(a[2], b[2])]
}

/// `a · b`.
#[inline(always)]
pub fn dot<R: Lanes>(a: V3<R>, b: V3<R>) -> R {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// `a × b`.
#[inline(always)]
pub fn cross<R: Lanes>(a: V3<R>, b: V3<R>) -> V3<R> {
    [a[1].mul_add(b[2], -(a[2] * b[1])), a[2].mul_add(b[0], -(a[0] * b[2])), a[0].mul_add(b[1], -(a[1] * b[0]))]
}
