//! Products and triangular solves of 16×16 tiles: the whole of the work in a step of the solver.
//!
//! One source, compiled for the registers that the processor has; nothing is fused and every sum keeps its order, so all of
//! them give the same bits.

use nalgebra::ComplexField;

/// Rows and columns of a tile.
pub const N: usize = 16;
/// One row.
pub type Row = [f64; N];

/// A 16×16 block.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct Tile(pub [Row; N]);

impl Tile {
    /// Nothing.
    pub const ZERO: Self = Self([[0.0; N]; N]);
}

/// The widest registers that this processor has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    /// What every processor of its kind has.
    Base,
    /// 256 bits.
    #[cfg(all(feature = "std", target_arch = "x86_64"))]
    Avx2,
    /// 512 bits.
    #[cfg(all(feature = "std", target_arch = "x86_64"))]
    Avx512,
}

impl Width {
    /// Of this processor.
    pub fn here() -> Self {
        #[cfg(all(feature = "std", target_arch = "x86_64"))]
        {
            if std::arch::is_x86_feature_detected!("avx512f") {
                return Self::Avx512;
            }
            if std::arch::is_x86_feature_detected!("avx2") {
                return Self::Avx2;
            }
        }
        Self::Base
    }
}

/// Makes a kernel, `$name(width, ...)`, from one source, `$body`.
macro_rules! kernel {
    ($(#[$doc:meta])* $name:ident = $body:ident($($arg:ident: $kind:ty),*) $(-> $out:ty)?, $avx2:ident, $avx512:ident) => {
        #[cfg(all(feature = "std", target_arch = "x86_64"))]
        #[target_feature(enable = "avx2")]
        fn $avx2($($arg: $kind),*) $(-> $out)? {
            $body($($arg),*)
        }

        #[cfg(all(feature = "std", target_arch = "x86_64"))]
        #[target_feature(enable = "avx512f")]
        fn $avx512($($arg: $kind),*) $(-> $out)? {
            $body($($arg),*)
        }

        $(#[$doc])*
        #[inline]
        pub fn $name(width: Width, $($arg: $kind),*) $(-> $out)? {
            match width {
                Width::Base => $body($($arg),*),
                // SAFETY: a width is only ever made by asking the processor.
                #[cfg(all(feature = "std", target_arch = "x86_64"))]
                Width::Avx2 => unsafe { $avx2($($arg),*) },
                // SAFETY: as above.
                #[cfg(all(feature = "std", target_arch = "x86_64"))]
                Width::Avx512 => unsafe { $avx512($($arg),*) },
            }
        }
    };
}

kernel!(
    /// `c += aᵀ b`, of rows that belong together.
    add = add_source(c: &mut Tile, a: &[Row], b: &[Row]), add_avx2, add_avx512
);
kernel!(
    /// `c −= aᵀ b`.
    sub = sub_source(c: &mut Tile, a: &[Row], b: &[Row]), sub_avx2, sub_avx512
);
kernel!(
    /// `c −= a b`.
    sub_plain = sub_plain_source(c: &mut Tile, a: &Tile, b: &Tile), sub_plain_avx2, sub_plain_avx512
);
kernel!(
    /// The upper triangle of a symmetric tile as `Rᵀ R`: R takes its place, the reciprocals of its diagonal on the diagonal. What
    /// is below the diagonal is not looked at. False where a pivot is not above `floor`.
    factor = factor_source(c: &mut Tile, floor: f64) -> bool, factor_avx2, factor_avx512
);
kernel!(
    /// `x ← R⁻ᵀ x`.
    solve_lower = solve_lower_source(r: &Tile, x: &mut Tile), solve_lower_avx2, solve_lower_avx512
);
kernel!(
    /// `x ← R⁻¹ x`.
    solve_upper = solve_upper_source(r: &Tile, x: &mut Tile), solve_upper_avx2, solve_upper_avx512
);

/// Rows of the result that are kept in registers together.
const BLOCK: usize = 4;

#[inline(always)]
fn product(c: &mut Tile, a: &[Row], b: &[Row], sign: f64) {
    for i in (0..N).step_by(BLOCK) {
        let mut sums = [[0.0; N]; BLOCK];
        for (a, b) in a.iter().zip(b) {
            for (r, sum) in sums.iter_mut().enumerate() {
                let factor = a[i + r];
                for (s, b) in sum.iter_mut().zip(b) {
                    *s += factor * b;
                }
            }
        }
        for (row, sum) in c.0[i..i + BLOCK].iter_mut().zip(&sums) {
            for (v, s) in row.iter_mut().zip(sum) {
                *v += sign * s;
            }
        }
    }
}

#[inline(always)]
fn add_source(c: &mut Tile, a: &[Row], b: &[Row]) {
    product(c, a, b, 1.0);
}

#[inline(always)]
fn sub_source(c: &mut Tile, a: &[Row], b: &[Row]) {
    product(c, a, b, -1.0);
}

#[inline(always)]
fn sub_plain_source(c: &mut Tile, a: &Tile, b: &Tile) {
    for i in (0..N).step_by(BLOCK) {
        let mut sums = [[0.0; N]; BLOCK];
        for (k, b) in b.0.iter().enumerate() {
            for (r, sum) in sums.iter_mut().enumerate() {
                let factor = a.0[i + r][k];
                for (s, b) in sum.iter_mut().zip(b) {
                    *s += factor * b;
                }
            }
        }
        for (row, sum) in c.0[i..i + BLOCK].iter_mut().zip(&sums) {
            for (v, s) in row.iter_mut().zip(sum) {
                *v -= s;
            }
        }
    }
}

#[inline(always)]
fn factor_source(c: &mut Tile, floor: f64) -> bool {
    for k in 0..N {
        let pivot = c.0[k][k];
        if pivot.is_nan() || pivot <= floor || pivot.is_infinite() {
            return false;
        }
        let inverse = 1.0 / ComplexField::sqrt(pivot);
        c.0[k][..k].fill(0.0);
        c.0[k][k..].iter_mut().for_each(|v| *v *= inverse);
        c.0[k][k] = inverse;
        let top = c.0[k];
        for (i, row) in c.0.iter_mut().enumerate().skip(k + 1) {
            let factor = top[i];
            for (v, t) in row.iter_mut().zip(&top) {
                *v -= factor * t;
            }
        }
    }
    true
}

#[inline(always)]
fn solve_lower_source(r: &Tile, x: &mut Tile) {
    for k in 0..N {
        let row = x.0[k].map(|v| v * r.0[k][k]);
        x.0[k] = row;
        for (i, below) in x.0.iter_mut().enumerate().skip(k + 1) {
            let factor = r.0[k][i];
            for (v, t) in below.iter_mut().zip(&row) {
                *v -= factor * t;
            }
        }
    }
}

#[inline(always)]
fn solve_upper_source(r: &Tile, x: &mut Tile) {
    for k in (0..N).rev() {
        let mut row = x.0[k];
        for (i, below) in x.0.iter().enumerate().skip(k + 1) {
            let factor = r.0[k][i];
            for (v, t) in row.iter_mut().zip(below) {
                *v -= factor * t;
            }
        }
        x.0[k] = row.map(|v| v * r.0[k][k]);
    }
}

/// `x ← R⁻ᵀ x` of one vector.
pub fn solve_lower_one(r: &Tile, x: &mut [f64]) {
    for k in 0..N {
        let value = x[k] * r.0[k][k];
        x[k] = value;
        for (v, t) in x[k + 1..N].iter_mut().zip(&r.0[k][k + 1..]) {
            *v -= t * value;
        }
    }
}

/// `x ← R⁻¹ x` of one vector.
pub fn solve_upper_one(r: &Tile, x: &mut [f64]) {
    for k in (0..N).rev() {
        let rest: f64 = r.0[k][k + 1..].iter().zip(&x[k + 1..N]).map(|(t, v)| t * v).sum();
        x[k] = (x[k] - rest) * r.0[k][k];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some(seed: u64) -> Tile {
        let mut state = seed;
        let mut draw = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        Tile(core::array::from_fn(|_| core::array::from_fn(|_| draw())))
    }

    fn dense(t: &Tile) -> nalgebra::SMatrix<f64, 16, 16> {
        nalgebra::SMatrix::from_fn(|i, j| t.0[i][j])
    }

    fn widths() -> Vec<Width> {
        let mut all = vec![Width::Base];
        #[cfg(target_arch = "x86_64")]
        {
            if std::arch::is_x86_feature_detected!("avx2") {
                all.push(Width::Avx2);
            }
            if std::arch::is_x86_feature_detected!("avx512f") {
                all.push(Width::Avx512);
            }
        }
        all
    }

    #[test]
    fn every_kernel_is_its_formula_and_gives_the_same_bits_on_every_width() {
        let (a, b, c) = (some(1), some(2), some(3));
        let mut posed = Tile::ZERO;
        add(Width::Base, &mut posed, &a.0, &a.0);
        (0..N).for_each(|k| posed.0[k][k] += 1.0);
        let mut first: Option<[Tile; 6]> = None;
        for width in widths() {
            let [mut sum, mut difference, mut plain, mut r, mut lower, mut upper] = [c, c, c, posed, b, b];
            add(width, &mut sum, &a.0[..5], &b.0[..5]);
            sub(width, &mut difference, &a.0, &b.0);
            sub_plain(width, &mut plain, &a, &b);
            assert!(factor(width, &mut r, 0.0));
            solve_lower(width, &r, &mut lower);
            solve_upper(width, &r, &mut upper);
            let five = dense(&a).rows(0, 5).tr_mul(&dense(&b).rows(0, 5));
            assert!((dense(&sum) - dense(&c) - five).norm() < 1e-13);
            assert!((dense(&difference) - dense(&c) + dense(&a).tr_mul(&dense(&b))).norm() < 1e-13);
            assert!((dense(&plain) - dense(&c) + dense(&a) * dense(&b)).norm() < 1e-13);
            let mut full = dense(&r);
            (0..N).for_each(|k| full[(k, k)] = 1.0 / full[(k, k)]);
            assert!((full.tr_mul(&full) - dense(&posed)).norm() < 1e-12);
            assert!((full.tr_mul(&dense(&lower)) - dense(&b)).norm() < 1e-12);
            assert!((full * dense(&upper) - dense(&b)).norm() < 1e-12);
            let mut one: [f64; N] = core::array::from_fn(|k| b.0[k][3]);
            let mut other = one;
            solve_lower_one(&r, &mut one);
            solve_upper_one(&r, &mut other);
            assert!((0..N).all(|k| (one[k] - lower.0[k][3]).abs() < 1e-13 && (other[k] - upper.0[k][3]).abs() < 1e-13));
            let all = [sum, difference, plain, r, lower, upper];
            assert_eq!(*first.get_or_insert(all), all);
        }
    }

    #[test]
    fn what_is_not_positive_definite_is_refused() {
        let mut tile = Tile::ZERO;
        (0..N).for_each(|k| tile.0[k][k] = 1.0);
        tile.0[0][1] = 2.0;
        assert!(!factor(Width::Base, &mut tile, 0.0));
        let mut broken = Tile::ZERO;
        broken.0[0][0] = f64::NAN;
        assert!(!factor(Width::Base, &mut broken, 0.0));
    }
}
