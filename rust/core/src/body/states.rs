//! The unknowns, and how a step moves them.

use alloc::vec::Vec;
use nalgebra::{Matrix3, UnitQuaternion, Vector2, Vector3};

use super::{model::Model, tiles::N};
use crate::so3::{retract, tangent_basis};

/// Places of a sensor's unknowns in its tile; one place stays empty.
pub const TURN: usize = 0;
/// Velocity.
pub const VELOCITY: usize = 3;
/// Position.
pub const POSITION: usize = 6;
/// Gyroscope bias.
pub const GYR_BIAS: usize = 9;
/// Accelerometer bias.
pub const ACC_BIAS: usize = 12;
/// Unknowns of a sensor at a moment.
pub const UNKNOWNS: usize = 15;

/// One sensor at one moment.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    /// Sensor to world (z up).
    pub q: UnitQuaternion<f64>,
    /// The same as a matrix.
    pub turn: Matrix3<f64>,
    /// Velocity in the world, m/s.
    pub velocity: Vector3<f64>,
    /// Position in the world, m.
    pub position: Vector3<f64>,
    /// Gyroscope bias, rad/s.
    pub gyr_bias: Vector3<f64>,
    /// Accelerometer bias, m/s².
    pub acc_bias: Vector3<f64>,
}

impl Motion {
    /// From an orientation; all else zero.
    pub fn turned(q: UnitQuaternion<f64>) -> Self {
        let zero = Vector3::zeros();
        let turn = q.to_rotation_matrix().into_inner();
        Self { q, turn, velocity: zero, position: zero, gyr_bias: zero, acc_bias: zero }
    }

    /// Moved by the 15 numbers of a step: `R ← Exp(φ) R`, all else by sums.
    pub fn moved(&self, step: &[f64]) -> Self {
        let part = |at: usize| Vector3::new(step[at], step[at + 1], step[at + 2]);
        let turned = UnitQuaternion::from_scaled_axis(part(TURN));
        let mut q = turned * self.q;
        q.renormalize();
        Self {
            q,
            turn: q.to_rotation_matrix().into_inner(),
            velocity: self.velocity + part(VELOCITY),
            position: self.position + part(POSITION),
            gyr_bias: self.gyr_bias + part(GYR_BIAS),
            acc_bias: self.acc_bias + part(ACC_BIAS),
        }
    }
}

/// All unknowns.
#[derive(Clone, Debug)]
pub struct State {
    /// Every sensor at every moment, moment by moment.
    pub motions: Vec<Motion>,
    /// Of each joint, its centre as seen from the sensors on either side, m.
    pub centers: Vec<[Vector3<f64>; 2]>,
    /// Of each joint, its axis in the frames of the sensors on either side; meaningless where the joint is no hinge.
    pub axes: Vec<[Vector3<f64>; 2]>,
    /// Of each skin, by how much it turns its sensor on the bone and shifts it, rad/rad and m/rad.
    pub skins: Vec<[Vector3<f64>; 2]>,
}

impl State {
    /// Moved by the steps of all nodes (a tile's row a sensor) and of the border.
    pub fn moved(&self, model: &Model, steps: &[f64], border: &[f64]) -> Self {
        let motions = self.motions.iter().zip(steps.chunks_exact(N)).map(|(m, s)| m.moved(s)).collect();
        let mut centers = self.centers.clone();
        let mut axes = self.axes.clone();
        for (j, joint) in model.joints.iter().enumerate() {
            for side in 0..2 {
                let at = model.center_at(j, side);
                centers[j][side] += Vector3::new(border[at], border[at + 1], border[at + 2]);
                if joint.hinge_std.is_some() {
                    let (axis, at) = (axes[j][side], model.axis_at(j, side));
                    axes[j][side] = retract(&axis, &tangent_basis(&axis), &Vector2::new(border[at], border[at + 1]));
                }
            }
        }
        let mut skins = self.skins.clone();
        for (n, skin) in skins.iter_mut().enumerate() {
            for (part, step) in skin.iter_mut().zip(border[model.skin_at(n)..].chunks_exact(3)) {
                *part += Vector3::new(step[0], step[1], step[2]);
            }
        }
        Self { motions, centers, axes, skins }
    }
}
