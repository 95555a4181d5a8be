//! Knee hinge, section 2.2.2: eqs 6, 7 and 9 (eq. 8 as printed lost the proximal rate).
//!
//! `e = m − (m·r) r` with the relative rate `m = R_aᵀ R_b ω_b − ω_a` in the frame of sensor a, whose axis is r. The rates are
//! those of the gyroscopes less their biases: the paper's rates as unknowns of their own (eq. 4) are eliminated, which leaves the
//! same residual with the variance `σ_hinge² + 4 σ_rate²` (of two sensors that differ `σ_hinge² + 2 σ_a² + 2 σ_b²`), exact where both
//! axes agree.

use nalgebra::{Matrix3, Matrix3x2, Vector3};

use super::super::states::Motion;
use crate::so3::tangent_basis;

/// One side of a hinge.
#[derive(Clone, Copy, Debug)]
pub struct Hinge {
    /// Residual in the frame of a, rad/s.
    pub residual: Vector3<f64>,
    /// By the rotation of a, then of b.
    pub turns: [Matrix3<f64>; 2],
    /// By the gyroscope bias of a, then of b.
    pub biases: [Matrix3<f64>; 2],
    /// By the axis in a.
    pub axis: Matrix3x2<f64>,
}

/// The residual alone; `gyr` are the rates that the sensors read.
pub fn residual(a: &Motion, b: &Motion, gyr: [&Vector3<f64>; 2], axis: &Vector3<f64>) -> Vector3<f64> {
    let relative = a.turn.tr_mul(&(b.turn * (gyr[1] - b.gyr_bias))) - (gyr[0] - a.gyr_bias);
    relative - axis * axis.dot(&relative)
}

/// Residual and derivatives.
pub fn linearised(a: &Motion, b: &Motion, gyr: [&Vector3<f64>; 2], axis: &Vector3<f64>) -> Hinge {
    let between = a.turn.tr_mul(&b.turn);
    let rate_b = gyr[1] - b.gyr_bias;
    let carried = between * rate_b;
    let relative = carried - (gyr[0] - a.gyr_bias);
    let along = axis.dot(&relative);
    let across = Matrix3::identity() - axis * axis.transpose();
    let seen = across * between;
    Hinge {
        residual: relative - axis * along,
        turns: [across * carried.cross_matrix(), -(seen * rate_b.cross_matrix())],
        biases: [across, -seen],
        axis: -(axis * relative.transpose() + Matrix3::identity() * along) * tangent_basis(axis),
    }
}
