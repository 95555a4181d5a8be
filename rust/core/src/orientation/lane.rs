//! Numbers the filters compute with: one (`f64`, `f32`), or eight side by side (`eight`). The arithmetic of a filter is written
//! once over [`Lane`]; lanes never mix, so each gives the bits it gives alone.

use core::ops::{Add, Div, Mul, Neg, Sub};

use nalgebra::ComplexField;
use serde::{Serialize, de::DeserializeOwned};

use super::eight::Eight;

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
    /// Whether some lane is above its limit.
    fn any_above(self, limit: Self) -> bool;
}

/// A number of one stream, as it is stored and saved.
pub trait Real: Lane + Serialize + DeserializeOwned + Default + core::fmt::Debug + PartialEq + Send + 'static {
    /// Eight of them in AVX registers, where there are any.
    type Registers: Eight<Self>;
    /// Eight of them in AVX-512 registers...
    type Wider: Eight<Self>;
    /// ...if that is worth it.
    const HAS_WIDER: bool;
    /// As a double.
    fn to_f64(self) -> f64;
}

macro_rules! real {
    ($real:ty, $registers:ty, $wider:ty, $has_wider:literal) => {
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
            #[inline(always)]
            fn any_above(self, limit: Self) -> bool {
                self > limit
            }
        }
        impl Real for $real {
            type Registers = $registers;
            type Wider = $wider;
            const HAS_WIDER: bool = $has_wider;
            #[inline(always)]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
        }
    };
}
#[cfg(all(feature = "std", target_arch = "x86_64"))]
use super::registers::{Doubles256, Doubles512, Singles256};
#[cfg(all(feature = "std", target_arch = "x86_64"))]
real!(f64, Doubles256, Doubles512, true);
#[cfg(all(feature = "std", target_arch = "x86_64"))]
real!(f32, Singles256, Singles256, false);
#[cfg(not(all(feature = "std", target_arch = "x86_64")))]
use super::eight::Array;
#[cfg(not(all(feature = "std", target_arch = "x86_64")))]
real!(f64, Array<f64>, Array<f64>, false);
#[cfg(not(all(feature = "std", target_arch = "x86_64")))]
real!(f32, Array<f32>, Array<f32>, false);
