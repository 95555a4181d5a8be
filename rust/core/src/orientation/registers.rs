//! Eight numbers in the registers of x86-64. Only code that runs after the processor was asked for their width may use them.

use core::{
    arch::x86_64::*,
    ops::{Add, Div, Mul, Neg, Sub},
};

use super::{
    eight::{Array, EIGHT, Eight},
    lane::Lane,
};

/// In one register of AVX-512.
#[derive(Clone, Copy, Debug)]
pub struct Doubles512([__m512d; 1]);
/// In two registers of AVX.
#[derive(Clone, Copy, Debug)]
pub struct Doubles256([__m256d; 2]);
/// In one register of AVX.
#[derive(Clone, Copy, Debug)]
pub struct Singles256([__m256; 1]);

/// Where `x > limit`, `yes`.
#[target_feature(enable = "avx512f")]
#[inline]
fn choose512(x: __m512d, limit: __m512d, yes: __m512d, no: __m512d) -> __m512d {
    _mm512_mask_blend_pd(_mm512_cmp_pd_mask::<_CMP_GT_OQ>(x, limit), no, yes)
}

#[target_feature(enable = "avx512f")]
#[inline]
fn above512(x: __m512d, limit: __m512d) -> bool {
    _mm512_cmp_pd_mask::<_CMP_GT_OQ>(x, limit) != 0
}

#[target_feature(enable = "avx")]
#[inline]
fn choose256(x: __m256d, limit: __m256d, yes: __m256d, no: __m256d) -> __m256d {
    _mm256_blendv_pd(no, yes, _mm256_cmp_pd::<_CMP_GT_OQ>(x, limit))
}

#[target_feature(enable = "avx")]
#[inline]
fn above256(x: __m256d, limit: __m256d) -> bool {
    _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_GT_OQ>(x, limit)) != 0
}

#[target_feature(enable = "avx")]
#[inline]
fn choose256_singles(x: __m256, limit: __m256, yes: __m256, no: __m256) -> __m256 {
    _mm256_blendv_ps(no, yes, _mm256_cmp_ps::<_CMP_GT_OQ>(x, limit))
}

#[target_feature(enable = "avx")]
#[inline]
fn above256_singles(x: __m256, limit: __m256) -> bool {
    _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(x, limit)) != 0
}

/// 8×8: pairs of numbers, then pairs of pairs, then halves change places.
#[target_feature(enable = "avx512f")]
#[inline]
fn transposed512(rows: [Doubles512; EIGHT]) -> [Doubles512; EIGHT] {
    let mut columns = rows;
    for odd in 0..2 {
        let mut pairs = [rows[0].0[0]; 4];
        for (k, pair) in pairs.iter_mut().enumerate() {
            let (a, b) = (rows[2 * k].0[0], rows[2 * k + 1].0[0]);
            *pair = if odd == 0 { _mm512_unpacklo_pd(a, b) } else { _mm512_unpackhi_pd(a, b) };
        }
        let [ab, cd, ef, gh] = pairs;
        let (near, far) = (_mm512_shuffle_f64x2::<0x88>(ab, cd), _mm512_shuffle_f64x2::<0x88>(ef, gh));
        columns[odd].0 = [_mm512_shuffle_f64x2::<0x88>(near, far)];
        columns[odd + 4].0 = [_mm512_shuffle_f64x2::<0xdd>(near, far)];
        let (near, far) = (_mm512_shuffle_f64x2::<0xdd>(ab, cd), _mm512_shuffle_f64x2::<0xdd>(ef, gh));
        columns[odd + 2].0 = [_mm512_shuffle_f64x2::<0x88>(near, far)];
        columns[odd + 6].0 = [_mm512_shuffle_f64x2::<0xdd>(near, far)];
    }
    columns
}

/// Numbers 0, 3, 6… of 24, numbers 1, 4, 7… and 2, 5, 8…: of the first two registers, then of the third.
#[target_feature(enable = "avx512f")]
#[inline]
fn apart512([a, b, c]: [Doubles512; 3]) -> [Doubles512; 3] {
    let ([a], [b], [c]) = (a.0, b.0, c.0);
    let x = _mm512_permutex2var_pd(a, _mm512_setr_epi64(0, 3, 6, 9, 12, 15, 0, 0), b);
    let y = _mm512_permutex2var_pd(a, _mm512_setr_epi64(1, 4, 7, 10, 13, 0, 0, 0), b);
    let z = _mm512_permutex2var_pd(a, _mm512_setr_epi64(2, 5, 8, 11, 14, 0, 0, 0), b);
    [
        Doubles512([_mm512_permutex2var_pd(x, _mm512_setr_epi64(0, 1, 2, 3, 4, 5, 10, 13), c)]),
        Doubles512([_mm512_permutex2var_pd(y, _mm512_setr_epi64(0, 1, 2, 3, 4, 8, 11, 14), c)]),
        Doubles512([_mm512_permutex2var_pd(z, _mm512_setr_epi64(0, 1, 2, 3, 4, 9, 12, 15), c)]),
    ]
}

/// 8×8 in four 4×4 blocks.
#[target_feature(enable = "avx")]
#[inline]
fn transposed256(rows: [Doubles256; EIGHT]) -> [Doubles256; EIGHT] {
    let mut columns = rows;
    for down in 0..2 {
        for across in 0..2 {
            let [a, b, c, d] = [
                rows[4 * down].0[across],
                rows[4 * down + 1].0[across],
                rows[4 * down + 2].0[across],
                rows[4 * down + 3].0[across],
            ];
            let (ab, cd) = (_mm256_unpacklo_pd(a, b), _mm256_unpacklo_pd(c, d));
            columns[4 * across].0[down] = _mm256_permute2f128_pd::<0x20>(ab, cd);
            columns[4 * across + 2].0[down] = _mm256_permute2f128_pd::<0x31>(ab, cd);
            let (ab, cd) = (_mm256_unpackhi_pd(a, b), _mm256_unpackhi_pd(c, d));
            columns[4 * across + 1].0[down] = _mm256_permute2f128_pd::<0x20>(ab, cd);
            columns[4 * across + 3].0[down] = _mm256_permute2f128_pd::<0x31>(ab, cd);
        }
    }
    columns
}

/// 8×8 through memory.
#[target_feature(enable = "avx")]
#[inline]
fn transposed256_singles(rows: [Singles256; EIGHT]) -> [Singles256; EIGHT] {
    let mut numbers = [Array([0.0; EIGHT]); EIGHT];
    for (numbers, row) in numbers.iter_mut().zip(rows) {
        row.store(&mut numbers.0);
    }
    let mut columns = rows;
    for (column, numbers) in columns.iter_mut().zip(Array::transposed(numbers)) {
        *column = Singles256::load(&numbers.0);
    }
    columns
}

macro_rules! operator {
    ($type:ident, $name:ident, $call:ident, $instruction:ident) => {
        impl $name for $type {
            type Output = Self;
            #[inline(always)]
            fn $call(mut self, other: Self) -> Self {
                for (a, b) in self.0.iter_mut().zip(other.0) {
                    // SAFETY: the processor has the registers, else there would be no such value.
                    *a = unsafe { $instruction(*a, b) };
                }
                self
            }
        }
    };
}
macro_rules! registers {
    ($type:ident, $real:ty, $add:ident, $sub:ident, $mul:ident, $div:ident, $set:ident, $sqrt:ident, $max:ident,
     $min:ident, $choose:ident, $above:ident) => {
        operator!($type, Add, add, $add);
        operator!($type, Sub, sub, $sub);
        operator!($type, Mul, mul, $mul);
        operator!($type, Div, div, $div);

        impl Neg for $type {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                Self::splat(-0.0) - self
            }
        }

        impl Lane for $type {
            #[inline(always)]
            fn splat(value: f64) -> Self {
                // SAFETY: only code that was compiled for these registers and runs on such a processor makes values.
                Self([unsafe { $set(value as $real) }; _])
            }
            #[inline(always)]
            fn sqrt(mut self) -> Self {
                for a in &mut self.0 {
                    // SAFETY: as above.
                    *a = unsafe { $sqrt(*a) };
                }
                self
            }
            #[inline(always)]
            fn where_above(self, limit: Self, yes: Self, mut no: Self) -> Self {
                for k in 0..no.0.len() {
                    // SAFETY: as above.
                    no.0[k] = unsafe { $choose(self.0[k], limit.0[k], yes.0[k], no.0[k]) };
                }
                no
            }
            #[inline(always)]
            fn at_least(mut self, other: Self) -> Self {
                for (a, b) in self.0.iter_mut().zip(other.0) {
                    // SAFETY: as above. The second where one is no number, as for one number.
                    *a = unsafe { $max(*a, b) };
                }
                self
            }
            #[inline(always)]
            fn at_most(mut self, other: Self) -> Self {
                for (a, b) in self.0.iter_mut().zip(other.0) {
                    // SAFETY: as above.
                    *a = unsafe { $min(b, *a) };
                }
                self
            }
            #[inline(always)]
            fn any_above(self, limit: Self) -> bool {
                let mut any = false;
                for k in 0..self.0.len() {
                    // SAFETY: as above.
                    any |= unsafe { $above(self.0[k], limit.0[k]) };
                }
                any
            }
        }
    };
}
macro_rules! eight {
    ($type:ident, $real:ty, $width:literal, $load:ident, $store:ident, $transposed:ident, { $($more:tt)* }) => {
        impl Eight<$real> for $type {
            #[inline(always)]
            fn load(from: &[$real; EIGHT]) -> Self {
                let mut all = Self::splat(0.0);
                for (a, from) in all.0.iter_mut().zip(from.as_chunks::<$width>().0) {
                    // SAFETY: as above; a whole register's width is read, of any alignment.
                    *a = unsafe { $load(from.as_ptr()) };
                }
                all
            }
            #[inline(always)]
            fn store(self, to: &mut [$real; EIGHT]) {
                for (a, to) in self.0.iter().zip(to.as_chunks_mut::<$width>().0) {
                    // SAFETY: as above; a whole register's width is written, of any alignment.
                    unsafe { $store(to.as_mut_ptr(), *a) };
                }
            }
            #[inline(always)]
            fn transposed(rows: [Self; EIGHT]) -> [Self; EIGHT] {
                // SAFETY: as above.
                unsafe { $transposed(rows) }
            }
            $($more)*
        }
    };
}
registers!(
    Doubles512,
    f64,
    _mm512_add_pd,
    _mm512_sub_pd,
    _mm512_mul_pd,
    _mm512_div_pd,
    _mm512_set1_pd,
    _mm512_sqrt_pd,
    _mm512_max_pd,
    _mm512_min_pd,
    choose512,
    above512
);
registers!(
    Doubles256,
    f64,
    _mm256_add_pd,
    _mm256_sub_pd,
    _mm256_mul_pd,
    _mm256_div_pd,
    _mm256_set1_pd,
    _mm256_sqrt_pd,
    _mm256_max_pd,
    _mm256_min_pd,
    choose256,
    above256
);
registers!(
    Singles256,
    f32,
    _mm256_add_ps,
    _mm256_sub_ps,
    _mm256_mul_ps,
    _mm256_div_ps,
    _mm256_set1_ps,
    _mm256_sqrt_ps,
    _mm256_max_ps,
    _mm256_min_ps,
    choose256_singles,
    above256_singles
);
eight!(Doubles512, f64, 8, _mm512_loadu_pd, _mm512_storeu_pd, transposed512, {
    #[inline(always)]
    fn apart(xyz: [Self; 3]) -> [Self; 3] {
        // SAFETY: as above.
        unsafe { apart512(xyz) }
    }
    #[inline(always)]
    fn difference(from: &[f64; EIGHT], less: &[f64; EIGHT]) -> Self {
        Self::load(from) - Self::load(less)
    }
});
eight!(Doubles256, f64, 4, _mm256_loadu_pd, _mm256_storeu_pd, transposed256, {
    #[inline(always)]
    fn difference(from: &[f64; EIGHT], less: &[f64; EIGHT]) -> Self {
        Self::load(from) - Self::load(less)
    }
});
eight!(Singles256, f32, 8, _mm256_loadu_ps, _mm256_storeu_ps, transposed256_singles, {});
