//! All samples between two moments in one: Forster et al. 2017, *On-Manifold Preintegration for Real-Time Visual–Inertial
//! Odometry*, sections V and VI.
//!
//! Over a short step with constant rate ω and specific force a, from the increments (ΔR, Δv, Δp) in the frame of the first
//! moment, with the force turned to the middle of the step (`E = Exp(ω dt/2)`; the paper uses its beginning, which is off by
//! half a step):
//!
//! `Δp += Δv dt + ΔR E a dt²/2`, `Δv += ΔR E a dt`, `ΔR ← ΔR Exp(ω dt)`.
//!
//! Errors are a rotation vector on the right of ΔR, and sums for the others.

use nalgebra::{ComplexField, Matrix3, Rotation3, Vector3};

use crate::so3::right_jacobian;

/// A step of a strapdown: what one sensor did meanwhile.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Length, s.
    pub dt: f64,
    /// Mean rate, rad/s.
    pub gyr: Vector3<f64>,
    /// Mean specific force, m/s².
    pub acc: Vector3<f64>,
}

/// What lies between two moments.
#[derive(Clone, Debug)]
pub struct Preintegrated {
    /// s.
    pub span_s: f64,
    /// ΔR.
    pub turn: Matrix3<f64>,
    /// Δv, m/s.
    pub velocity: Vector3<f64>,
    /// Δp, m.
    pub position: Vector3<f64>,
    /// Derivative of the rotation by the gyroscope bias.
    pub turn_gyr: Matrix3<f64>,
    /// Of Δv by the gyroscope and the accelerometer bias.
    pub velocity_bias: [Matrix3<f64>; 2],
    /// Of Δp likewise.
    pub position_bias: [Matrix3<f64>; 2],
    /// Biases with which it was made.
    pub bias: [Vector3<f64>; 2],
    /// Covariance of rotation, velocity and position: blocks RR, Rv, Rp, vv, vp, pp.
    covariance: [Matrix3<f64>; 6],
}

impl Preintegrated {
    /// Nothing yet, to be made with these biases.
    pub fn new(gyr_bias: Vector3<f64>, acc_bias: Vector3<f64>) -> Self {
        let zero = Matrix3::zeros();
        Self {
            span_s: 0.0,
            turn: Matrix3::identity(),
            velocity: Vector3::zeros(),
            position: Vector3::zeros(),
            turn_gyr: zero,
            velocity_bias: [zero; 2],
            position_bias: [zero; 2],
            bias: [gyr_bias, acc_bias],
            covariance: [zero; 6],
        }
    }

    /// Takes one step; `gyr_std`, `acc_std`, `position_std` are densities, rad/s/√Hz, m/s²/√Hz, m/√s.
    pub fn push(&mut self, step: &Step, gyr_std: f64, acc_std: f64, position_std: f64) {
        let dt = step.dt;
        let rate = step.gyr - self.bias[0];
        let force = step.acc - self.bias[1];
        let half = Rotation3::from_scaled_axis(rate * (0.5 * dt)).into_inner();
        let turned = Rotation3::from_scaled_axis(rate * dt).into_inner();
        let middle = self.turn * half;
        let pull = middle * force;
        // How the pull answers to an error of ΔR, and to one of the rate within the step.
        let by_turn = -(self.turn * (half * force).cross_matrix());
        let by_rate = -(middle * force.cross_matrix() * right_jacobian(&(rate * (0.5 * dt)))) * (0.5 * dt);
        let jacobian = right_jacobian(&(rate * dt));

        // Derivatives by the biases: a bias takes away from the rate and the force.
        let pull_bias = [by_turn * self.turn_gyr - by_rate, -middle];
        for (b, pull) in pull_bias.iter().enumerate() {
            self.position_bias[b] += self.velocity_bias[b] * dt + pull * (0.5 * dt * dt);
            self.velocity_bias[b] += pull * dt;
        }
        self.turn_gyr = turned.tr_mul(&self.turn_gyr) - jacobian * dt;

        // Covariance: what there is carried on, then the noise of this step.
        let [rr, rv, rp, vv, vp, pp] = self.covariance;
        let (a, b) = (by_turn * dt, by_turn * (0.5 * dt * dt));
        let carried_rv = rr * a.transpose() + rv;
        let carried_rp = rr * b.transpose() + rv * dt + rp;
        let new_vv = a * carried_rv + rv.transpose() * a.transpose() + vv;
        // Cov(v', p'): v' = a φ + v, p' = b φ + v dt + p.
        let new_vp = a * carried_rp + rv.tr_mul(&b.transpose()) + vv * dt + vp;
        let new_pp = b * carried_rp
            + (rv.tr_mul(&b.transpose()) + vv * dt + vp) * dt
            + rp.tr_mul(&b.transpose())
            + vp.transpose() * dt
            + pp;
        let (g, f) = (gyr_std * gyr_std / dt, acc_std * acc_std / dt);
        let into_turn = jacobian * dt;
        let into_velocity = by_rate * dt;
        let into_position = by_rate * (0.5 * dt * dt);
        let eye = Matrix3::identity();
        self.covariance = [
            turned.tr_mul(&(rr * turned)) + into_turn * into_turn.transpose() * g,
            turned.tr_mul(&carried_rv) + into_turn * into_velocity.transpose() * g,
            turned.tr_mul(&carried_rp) + into_turn * into_position.transpose() * g,
            new_vv + into_velocity * into_velocity.transpose() * g + eye * (f * dt * dt),
            new_vp + into_velocity * into_position.transpose() * g + eye * (f * 0.5 * dt * dt * dt),
            new_pp
                + into_position * into_position.transpose() * g
                + eye * (f * 0.25 * dt * dt * dt * dt + position_std * position_std * dt),
        ];

        self.position += self.velocity * dt + pull * (0.5 * dt * dt);
        self.velocity += pull * dt;
        self.turn *= turned;
        self.span_s += dt;
    }

    /// Covariance of rotation, velocity and position.
    pub fn covariance(&self) -> [[f64; 9]; 9] {
        let [rr, rv, rp, vv, vp, pp] = &self.covariance;
        let block = [[*rr, *rv, *rp], [rv.transpose(), *vv, *vp], [rp.transpose(), vp.transpose(), *pp]];
        core::array::from_fn(|i| {
            core::array::from_fn(|j| 0.5 * (block[i / 3][j / 3][(i % 3, j % 3)] + block[j / 3][i / 3][(j % 3, i % 3)]))
        })
    }

    /// L⁻¹, lower triangle, where L Lᵀ is the covariance: it makes residuals white. None where there is no noise in some
    /// direction.
    pub fn whitening(&self) -> Option<[[f64; 9]; 9]> {
        let mut l = self.covariance();
        for i in 0..9 {
            for j in 0..=i {
                let left: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
                let value = l[i][j] - left;
                if i == j {
                    if value.is_nan() || value <= 0.0 || value.is_infinite() {
                        return None;
                    }
                    l[i][i] = ComplexField::sqrt(value);
                } else {
                    l[i][j] = value / l[j][j];
                }
            }
        }
        let mut inverse: [[f64; 9]; 9] = [[0.0; 9]; 9];
        for i in 0..9 {
            let (done, rest) = inverse.split_at_mut(i);
            let row = &mut rest[0];
            row[i] = 1.0 / l[i][i];
            for (j, value) in row.iter_mut().enumerate().take(i) {
                let left: f64 = done.iter().zip(&l[i]).skip(j).map(|(above, factor)| factor * above[j]).sum();
                *value = -left / l[i][i];
            }
        }
        Some(inverse)
    }
}
