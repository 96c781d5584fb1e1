//! Packs of the x86-64 vector extensions: 16 or 8 `f32`, 8 or 4 `f64`.
//!
//! A value of these types is only made inside the functions of `dispatch` that enable the extension after asking the
//! processor, which is what makes the intrinsics sound.

use std::{
    arch::x86_64::*,
    ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign},
};

use crate::lanes::Lanes;

macro_rules! pack {
    ($name:ident, $doc:literal, $vector:ty, $float:ty, $count:literal, $set1:ident, $add:ident, $sub:ident, $mul:ident,
     $div:ident, $fma:ident, $sqrt:ident, $max:ident, $positive:expr) => {
        #[doc = $doc]
        #[derive(Clone, Copy, Debug)]
        #[repr(transparent)]
        pub struct $name($vector);

        impl Add for $name {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                // SAFETY: see the module; so for every block below.
                Self(unsafe { $add(self.0, other.0) })
            }
        }
        impl Sub for $name {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                Self(unsafe { $sub(self.0, other.0) })
            }
        }
        impl Mul for $name {
            type Output = Self;
            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                Self(unsafe { $mul(self.0, other.0) })
            }
        }
        impl Div for $name {
            type Output = Self;
            #[inline(always)]
            fn div(self, other: Self) -> Self {
                Self(unsafe { $div(self.0, other.0) })
            }
        }
        impl Neg for $name {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                Self(unsafe { $sub($set1(-0.0), self.0) })
            }
        }
        impl AddAssign for $name {
            #[inline(always)]
            fn add_assign(&mut self, other: Self) {
                *self = *self + other;
            }
        }
        impl SubAssign for $name {
            #[inline(always)]
            fn sub_assign(&mut self, other: Self) {
                *self = *self - other;
            }
        }
        impl Lanes for $name {
            const COUNT: usize = $count;

            #[inline(always)]
            fn splat(value: f64) -> Self {
                Self(unsafe { $set1(value as $float) })
            }
            #[inline(always)]
            fn get(&self, lane: usize) -> f64 {
                // SAFETY: a vector of $count floats has the layout of an array of them.
                let array: &[$float; $count] = unsafe { &*std::ptr::from_ref(self).cast() };
                array[lane] as f64
            }
            #[inline(always)]
            fn set(&mut self, lane: usize, value: f64) {
                // SAFETY: as in `get`.
                let array: &mut [$float; $count] = unsafe { &mut *std::ptr::from_mut(self).cast() };
                array[lane] = value as $float;
            }
            #[inline(always)]
            fn mul_add(self, b: Self, c: Self) -> Self {
                Self(unsafe { $fma(self.0, b.0, c.0) })
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                Self(unsafe { $sqrt(self.0) })
            }
            #[inline(always)]
            fn at_least_zero(self) -> Self {
                Self(unsafe { $max(self.0, $set1(0.0)) })
            }
            #[inline(always)]
            fn where_positive(self, value: Self) -> Self {
                Self(unsafe { $positive(self.0, value.0) })
            }
        }
    };
}

#[inline(always)]
unsafe fn positive_512(test: __m512, value: __m512) -> __m512 {
    unsafe { _mm512_maskz_mov_ps(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(test, _mm512_setzero_ps()), value) }
}

#[inline(always)]
unsafe fn positive_512d(test: __m512d, value: __m512d) -> __m512d {
    unsafe { _mm512_maskz_mov_pd(_mm512_cmp_pd_mask::<_CMP_GT_OQ>(test, _mm512_setzero_pd()), value) }
}

#[inline(always)]
unsafe fn positive_256(test: __m256, value: __m256) -> __m256 {
    unsafe { _mm256_and_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(test, _mm256_setzero_ps()), value) }
}

#[inline(always)]
unsafe fn positive_256d(test: __m256d, value: __m256d) -> __m256d {
    unsafe { _mm256_and_pd(_mm256_cmp_pd::<_CMP_GT_OQ>(test, _mm256_setzero_pd()), value) }
}

pack!(
    F32x16,
    "Sixteen `f32` (AVX-512).",
    __m512,
    f32,
    16,
    _mm512_set1_ps,
    _mm512_add_ps,
    _mm512_sub_ps,
    _mm512_mul_ps,
    _mm512_div_ps,
    _mm512_fmadd_ps,
    _mm512_sqrt_ps,
    _mm512_max_ps,
    positive_512
);
pack!(
    F64x8,
    "Eight `f64` (AVX-512).",
    __m512d,
    f64,
    8,
    _mm512_set1_pd,
    _mm512_add_pd,
    _mm512_sub_pd,
    _mm512_mul_pd,
    _mm512_div_pd,
    _mm512_fmadd_pd,
    _mm512_sqrt_pd,
    _mm512_max_pd,
    positive_512d
);
pack!(
    F32x8,
    "Eight `f32` (AVX2 and FMA).",
    __m256,
    f32,
    8,
    _mm256_set1_ps,
    _mm256_add_ps,
    _mm256_sub_ps,
    _mm256_mul_ps,
    _mm256_div_ps,
    _mm256_fmadd_ps,
    _mm256_sqrt_ps,
    _mm256_max_ps,
    positive_256
);
pack!(
    F64x4,
    "Four `f64` (AVX2 and FMA).",
    __m256d,
    f64,
    4,
    _mm256_set1_pd,
    _mm256_add_pd,
    _mm256_sub_pd,
    _mm256_mul_pd,
    _mm256_div_pd,
    _mm256_fmadd_pd,
    _mm256_sqrt_pd,
    _mm256_max_pd,
    positive_256d
);
