//! Where the world's origin lies and where it faces, section 3.7: nothing in the data says, so the first sensor begins where its
//! start says, with the start's velocity and heading.
//!
//! The heading is the angle, in the horizontal plane, of a sensor axis that is not upright.

use nalgebra::{ComplexField, RealField, Vector3};

use super::super::states::Motion;

/// The first moment of a stretch.
#[derive(Clone, Copy, Debug)]
pub struct Gauge {
    /// In the sensor's frame: the axis whose heading is held.
    pub axis: Vector3<f64>,
    /// Its heading, rad.
    pub heading: f64,
    /// m.
    pub position: Vector3<f64>,
    /// m/s.
    pub velocity: Vector3<f64>,
    /// Whether position and velocity are held; else the heading alone.
    pub place: bool,
}

impl Gauge {
    /// As the start says; the axis is the coordinate axis that is the least upright.
    pub fn of(start: &Motion) -> Self {
        let mut axis = Vector3::zeros();
        axis[start.turn.row(2).transpose().iamin()] = 1.0;
        let seen = start.turn * axis;
        Self {
            axis,
            heading: RealField::atan2(seen.y, seen.x),
            position: start.position,
            velocity: start.velocity,
            place: true,
        }
    }

    /// Heading residual, rad.
    pub fn heading_residual(&self, at: &Motion) -> f64 {
        let seen = at.turn * self.axis;
        let (sin, cos) = ComplexField::sin_cos(self.heading);
        RealField::atan2(seen.y * cos - seen.x * sin, seen.x * cos + seen.y * sin)
    }

    /// Its derivative by the rotation.
    pub fn heading_turn(&self, at: &Motion) -> Vector3<f64> {
        let seen = at.turn * self.axis;
        let by_turn = -(at.turn * self.axis.cross_matrix());
        let square = seen.x * seen.x + seen.y * seen.y;
        (by_turn.row(1) * seen.x - by_turn.row(0) * seen.y).transpose() / square
    }
}
