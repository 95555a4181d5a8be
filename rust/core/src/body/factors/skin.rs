//! Soft tissue: what is fixed in the bone, as the sensor that sits on it sees it. Not in the paper.
//!
//! With the turn `W = Σ w θ` and the shift `B = Σ b θ` of all that moves the sensor's skin in proportion to an angle θ: a point c is
//! at `Exp(W) c + B`, a direction r along `Exp(W) r`, and the bone turns by `Σ w θ'` faster than the sensor. The angles are those
//! of an earlier estimate: the product of their errors with w and b is of second order.

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::so3::right_jacobian;

/// A sensor on its skin at one moment.
#[derive(Clone, Copy, Debug)]
pub struct Seat {
    /// Bone to sensor, against where they are at zero angles.
    pub turn: Matrix3<f64>,
    /// m.
    pub shift: Vector3<f64>,
    /// By which the bone turns faster than the sensor, rad/s.
    pub rate: Vector3<f64>,
    /// Of `turn`, from the left, by W.
    slope: Matrix3<f64>,
}

impl Seat {
    /// From what each skin of the sensor does (rad/rad, m/rad) and its angle (rad, rad/s).
    pub fn new<'a>(skins: impl Iterator<Item = (&'a [Vector3<f64>; 2], &'a [f64; 2])>) -> Self {
        let zero = Vector3::zeros();
        let (mut turn, mut shift, mut rate) = (zero, zero, zero);
        for ([w, b], [angle, speed]) in skins {
            turn += w * *angle;
            shift += b * *angle;
            rate += w * *speed;
        }
        Self { turn: Rotation3::from_scaled_axis(turn).into_inner(), shift, rate, slope: right_jacobian(&-turn) }
    }

    /// Where the sensor sees a point of the bone.
    pub fn point(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.turn * point + self.shift
    }

    /// How it sees a direction of the bone.
    pub fn direction(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        self.turn * direction
    }

    /// Derivative of either by the turn W; by the shift B that of a point is I. `direction` is `Exp(W)` times it.
    pub fn by_turn(&self, direction: &Vector3<f64>) -> Matrix3<f64> {
        -(direction.cross_matrix() * self.slope)
    }
}
