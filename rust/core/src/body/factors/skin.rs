//! Soft tissue: a joint's centre, as the sensor sees it that skin and straps move on its bone. Not in the paper.
//!
//! With the turn `W = Σ w θ` and the shift `B = Σ b θ` of all that moves the sensor in proportion to an angle θ of a joint nearby, a
//! centre c is at `Exp(W) c + B`. The angles are those of an earlier estimate: their errors times w and b are of second order.
//!
//! Hinges keep their axes: to gyroscopes a knee that is not quite a hinge (its shank turns inwards as it bends) looks as if skin
//! turned its sensors, and on real walking the skin took it all, 40 degrees per radian of it.

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::so3::right_jacobian;

/// How a sensor sits on its bone at one moment, against how it would at zero angles.
#[derive(Clone, Copy, Debug)]
pub struct Seat {
    /// Exp(W).
    pub turn: Matrix3<f64>,
    /// m.
    pub shift: Vector3<f64>,
    /// `Exp(W + δ) = Exp(slope δ) Exp(W)`.
    slope: Matrix3<f64>,
}

impl Seat {
    /// From what each skin of the sensor does (rad/rad, m/rad) and its angle, rad.
    pub fn new<'a>(skins: impl Iterator<Item = (&'a [Vector3<f64>; 2], &'a f64)>) -> Self {
        let (mut turn, mut shift) = (Vector3::zeros(), Vector3::zeros());
        for ([w, b], angle) in skins {
            turn += w * *angle;
            shift += b * *angle;
        }
        Self { turn: Rotation3::from_scaled_axis(turn).into_inner(), shift, slope: right_jacobian(&-turn) }
    }

    /// Where the sensor sees a point of the bone.
    pub fn point(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.turn * point + self.shift
    }

    /// Its derivative by W; by the point it is `turn`, by B it is I.
    pub fn by_turn(&self, point: &Vector3<f64>) -> Matrix3<f64> {
        -((self.turn * point).cross_matrix() * self.slope)
    }
}
