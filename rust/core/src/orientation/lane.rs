//! Numbers the filters compute with: one stream (`f64`, `f32`) or several side by side ([`Wide`]). The arithmetic of a filter is
//! written once over [`Lane`]; lanes never mix, so a stream in a lane gives the bits it gives alone.

use core::ops::{Add, Div, Mul, Neg, Sub};

use nalgebra::ComplexField;
use serde::{Serialize, de::DeserializeOwned};

/// What a filter needs of a number.
pub trait Lane:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// The same number in every lane.
    fn splat(value: f64) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// `yes` where `self > limit`, else `no`.
    fn where_above(self, limit: Self, yes: Self, no: Self) -> Self;
    /// The larger; `other` where `self` is no number.
    #[inline(always)]
    fn at_least(self, other: Self) -> Self {
        self.where_above(other, self, other)
    }
    /// The smaller.
    #[inline(always)]
    fn at_most(self, other: Self) -> Self {
        self.where_above(other, other, self)
    }
}

/// A number of one stream, as it is stored and saved.
pub trait Real: Lane + Serialize + DeserializeOwned + Default + core::fmt::Debug + PartialEq + Send + 'static {
    /// As a double.
    fn to_f64(self) -> f64;
}

macro_rules! real {
    ($real:ty) => {
        impl Lane for $real {
            #[inline(always)]
            fn splat(value: f64) -> Self {
                value as Self
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                ComplexField::sqrt(self)
            }
            #[inline(always)]
            fn where_above(self, limit: Self, yes: Self, no: Self) -> Self {
                if self > limit { yes } else { no }
            }
        }
        impl Real for $real {
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
        }
    };
}
real!(f64);
real!(f32);

/// `N` streams side by side.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub struct Wide<T, const N: usize>(pub [T; N]);

macro_rules! lanewise {
    ($name:ident, $call:ident) => {
        impl<T: Real, const N: usize> $name for Wide<T, N> {
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

impl<T: Real, const N: usize> Neg for Wide<T, N> {
    type Output = Self;
    #[inline(always)]
    fn neg(mut self) -> Self {
        for a in &mut self.0 {
            *a = -*a;
        }
        self
    }
}

impl<T: Real, const N: usize> Lane for Wide<T, N> {
    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self([T::splat(value); N])
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
        for k in 0..N {
            no.0[k] = self.0[k].where_above(limit.0[k], yes.0[k], no.0[k]);
        }
        no
    }
}
