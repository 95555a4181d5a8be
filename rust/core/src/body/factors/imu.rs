//! IMU dynamics, section 2.2.1: eqs 44 and 45 of Forster et al. 2017.
//!
//! `e_R = Log((ΔR Exp(∂R δb_g))ᵀ R_iᵀ R_j)`, `e_v = R_iᵀ (v_j − v_i − g Δt) − Δv(b)`,
//! `e_p = R_iᵀ (p_j − p_i − v_i Δt − g Δt²/2) − Δp(b)`, with increments corrected to first order for the biases at i.

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::super::{preintegration::Preintegrated, states::Motion};
use crate::{
    orientation::smoother::residual::inverse_right_jacobian,
    so3::{log, right_jacobian},
};

/// Rotation, velocity and position.
pub type Residual = [Vector3<f64>; 3];

/// The residual; `gravity` along −z.
pub fn residual(pre: &Preintegrated, i: &Motion, j: &Motion, gravity: f64) -> Residual {
    let parts = Parts::new(pre, i, j, gravity);
    parts.residual
}

struct Parts {
    residual: Residual,
    /// R_iᵀ times the change of velocity and of position.
    seen: [Vector3<f64>; 2],
    /// Correction of the rotation by the gyroscope bias, rad.
    correction: Vector3<f64>,
}

impl Parts {
    fn new(pre: &Preintegrated, i: &Motion, j: &Motion, gravity: f64) -> Self {
        let t = pre.span_s;
        let down = Vector3::new(0.0, 0.0, -gravity);
        let [db_gyr, db_acc] = [i.gyr_bias - pre.bias[0], i.acc_bias - pre.bias[1]];
        let correction = pre.turn_gyr * db_gyr;
        let expected = pre.turn * Rotation3::from_scaled_axis(correction).into_inner();
        let turn = log(&expected.tr_mul(&i.turn.tr_mul(&j.turn)));
        let by_velocity = i.turn.tr_mul(&(j.velocity - i.velocity - down * t));
        let by_position = i.turn.tr_mul(&(j.position - i.position - i.velocity * t - down * (0.5 * t * t)));
        let velocity = pre.velocity + pre.velocity_bias[0] * db_gyr + pre.velocity_bias[1] * db_acc;
        let position = pre.position + pre.position_bias[0] * db_gyr + pre.position_bias[1] * db_acc;
        Self { residual: [turn, by_velocity - velocity, by_position - position], seen: [by_velocity, by_position], correction }
    }
}

/// Residual and derivatives: rows rotation, velocity, position; columns rotation, velocity, position, gyroscope and
/// accelerometer bias at i, then rotation, velocity, position at j.
pub fn linearised(pre: &Preintegrated, i: &Motion, j: &Motion, gravity: f64) -> (Residual, [[Matrix3<f64>; 8]; 3]) {
    let parts = Parts::new(pre, i, j, gravity);
    let turn = parts.residual[0];
    let zero = Matrix3::zeros();
    let inverse = inverse_right_jacobian(&turn);
    let back = i.turn.transpose();
    let between = j.turn.tr_mul(&i.turn);
    let turned = Rotation3::from_scaled_axis(-turn).into_inner();
    let by_bias = -(inverse * turned * right_jacobian(&parts.correction) * pre.turn_gyr);
    let rows = [
        [-(inverse * between), zero, zero, by_bias, zero, inverse, zero, zero],
        [parts.seen[0].cross_matrix(), -back, zero, -pre.velocity_bias[0], -pre.velocity_bias[1], zero, back, zero],
        [
            parts.seen[1].cross_matrix(),
            back * -pre.span_s,
            -back,
            -pre.position_bias[0],
            -pre.position_bias[1],
            zero,
            zero,
            back,
        ],
    ];
    (parts.residual, rows)
}
