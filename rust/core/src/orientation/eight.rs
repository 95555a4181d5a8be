//! Eight numbers side by side: neighbouring samples of one recording, or the same sample of eight recordings.

use core::ops::{Add, Div, Mul, Neg, Sub};

use super::lane::{Lane, Real};

/// So many.
pub const EIGHT: usize = 8;

/// Eight numbers as one [`Lane`].
pub trait Eight<T: Real>: Lane {
    /// From memory.
    fn load(from: &[T; EIGHT]) -> Self;
    /// To memory.
    fn store(self, to: &mut [T; EIGHT]);
    /// Number `j` of row `k` becomes number `k` of row `j`.
    fn transposed(rows: [Self; EIGHT]) -> [Self; EIGHT];
    /// Eight times x, y, z one after the other become all x, all y, all z.
    #[inline(always)]
    fn apart(xyz: [Self; 3]) -> [Self; 3] {
        let (mut mixed, mut numbers) = ([[T::default(); EIGHT]; 3], [[T::default(); EIGHT]; 3]);
        for (to, from) in mixed.iter_mut().zip(xyz) {
            from.store(to);
        }
        for (k, one) in mixed.as_flattened().as_chunks::<3>().0.iter().enumerate() {
            for (to, x) in numbers.iter_mut().zip(one) {
                to[k] = *x;
            }
        }
        [Self::load(&numbers[0]), Self::load(&numbers[1]), Self::load(&numbers[2])]
    }
    /// `from − less` of doubles, which may become shorter numbers.
    #[inline(always)]
    fn difference(from: &[f64; EIGHT], less: &[f64; EIGHT]) -> Self {
        let mut numbers = [T::default(); EIGHT];
        for (number, (x, less)) in numbers.iter_mut().zip(from.iter().zip(less)) {
            *number = T::splat(x - less);
        }
        Self::load(&numbers)
    }
}

/// Eight numbers on any machine.
#[derive(Clone, Copy, Debug)]
pub struct Array<T>(pub [T; EIGHT]);

macro_rules! lanewise {
    ($name:ident, $call:ident) => {
        impl<T: Real> $name for Array<T> {
            type Output = Self;
            #[inline(always)]
            fn $call(mut self, other: Self) -> Self {
                for (a, b) in self.0.iter_mut().zip(other.0) {
                    *a = a.$call(b);
                }
                self
            }
        }
    };
}
lanewise!(Add, add);
lanewise!(Sub, sub);
lanewise!(Mul, mul);
lanewise!(Div, div);

impl<T: Real> Neg for Array<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(mut self) -> Self {
        for a in &mut self.0 {
            *a = -*a;
        }
        self
    }
}

impl<T: Real> Lane for Array<T> {
    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self([T::splat(value); EIGHT])
    }
    #[inline(always)]
    fn sqrt(mut self) -> Self {
        for a in &mut self.0 {
            *a = a.sqrt();
        }
        self
    }
    #[inline(always)]
    fn where_above(self, limit: Self, yes: Self, mut no: Self) -> Self {
        for k in 0..EIGHT {
            no.0[k] = self.0[k].where_above(limit.0[k], yes.0[k], no.0[k]);
        }
        no
    }
    #[inline(always)]
    fn any_above(self, limit: Self) -> bool {
        self.0.iter().zip(limit.0).any(|(x, limit)| x.any_above(limit))
    }
}

impl<T: Real> Eight<T> for Array<T> {
    #[inline(always)]
    fn load(from: &[T; EIGHT]) -> Self {
        Self(*from)
    }
    #[inline(always)]
    fn store(self, to: &mut [T; EIGHT]) {
        *to = self.0;
    }
    #[inline(always)]
    fn transposed(rows: [Self; EIGHT]) -> [Self; EIGHT] {
        let mut columns = rows;
        for (k, row) in rows.iter().enumerate() {
            for (column, x) in columns.iter_mut().zip(row.0) {
                column.0[k] = x;
            }
        }
        columns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NUMBERS: [f64; EIGHT] = [0.0, -0.0, 1.5, -2.25, 1e300, f64::NAN, f64::INFINITY, 0.1];

    /// All that a lane can do, of both numbers.
    fn all<L: Lane>(a: L, b: L) -> [L; 9] {
        [a + b, a - b, a * b, a / b, -a, a.sqrt(), a.at_least(b), a.at_most(b), a.where_above(b, L::splat(3.7), a)]
    }

    fn lanes_do_what_numbers_do<T: Real, V: Eight<T>>() {
        let a = NUMBERS.map(T::splat);
        for turn in 0..EIGHT {
            let b: [T; EIGHT] = core::array::from_fn(|k| a[(k + turn) % EIGHT]);
            let wide = all(V::load(&a), V::load(&b)).map(|v| {
                let mut numbers = [T::default(); EIGHT];
                v.store(&mut numbers);
                numbers
            });
            for k in 0..EIGHT {
                for (what, one) in all(a[k], b[k]).into_iter().enumerate() {
                    // Which NaN it is may differ.
                    let [x, y] = [wide[what][k], one].map(T::to_f64);
                    assert!(x.to_bits() == y.to_bits() || (x.is_nan() && y.is_nan()), "{what} of {a:?}, {b:?}: {x} {y}");
                }
            }
            let mut rows = [V::load(&a); EIGHT];
            for (k, row) in rows.iter_mut().enumerate() {
                *row = V::load(&core::array::from_fn(|j| T::splat((10 * k + j) as f64)));
            }
            let apart = V::apart([rows[0], rows[1], rows[2]]);
            for (c, column) in apart.into_iter().enumerate() {
                let mut numbers = a;
                column.store(&mut numbers);
                // Number n of the 24 is 10·(n / 8) + n mod 8.
                let n = |k: usize| 3 * k + c;
                assert_eq!(numbers, core::array::from_fn(|k| T::splat((10 * (n(k) / 8) + n(k) % 8) as f64)));
            }
            for (j, column) in V::transposed(rows).into_iter().enumerate() {
                let mut numbers = a;
                column.store(&mut numbers);
                assert_eq!(numbers, core::array::from_fn(|k| T::splat((10 * k + j) as f64)));
            }
            let from = NUMBERS.map(|x| x * 1.5);
            let mut less = [T::default(); EIGHT];
            V::difference(&from, &NUMBERS).store(&mut less);
            for (less, (from, number)) in less.into_iter().zip(from.into_iter().zip(NUMBERS)) {
                let expected = T::splat(from - number).to_f64();
                assert!(less.to_f64() == expected || (less.to_f64().is_nan() && expected.is_nan()));
            }
            assert_eq!(V::load(&a).any_above(V::load(&b)), a.iter().zip(b).any(|(a, b)| a.any_above(b)));
        }
    }

    #[test]
    fn eight_side_by_side_give_the_bits_of_one() {
        lanes_do_what_numbers_do::<f64, Array<f64>>();
        lanes_do_what_numbers_do::<f32, Array<f32>>();
        #[cfg(all(feature = "std", target_arch = "x86_64"))]
        {
            if std::arch::is_x86_feature_detected!("avx2") {
                lanes_do_what_numbers_do::<f64, crate::orientation::registers::Doubles256>();
                lanes_do_what_numbers_do::<f32, crate::orientation::registers::Singles256>();
            }
            if std::arch::is_x86_feature_detected!("avx512f") {
                lanes_do_what_numbers_do::<f64, crate::orientation::registers::Doubles512>();
            }
        }
    }
}
