//! The unknowns: a pair of unit vectors, and the planes in which they move.

use nalgebra::{Matrix6x4, Vector2, Vector3, Vector4, Vector6};
use serde::{Deserialize, Serialize};

use crate::so3::{retract, tangent_basis};

/// The hinge axis in both sensor frames, unit vectors with one common sign.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AxisPair {
    /// In sensor frame 1.
    pub j1: Vector3<f64>,
    /// In sensor frame 2.
    pub j2: Vector3<f64>,
}

impl AxisPair {
    /// Both vectors scaled to unit length; a vector without a direction (zero, not finite) becomes x.
    pub fn new(j1: Vector3<f64>, j2: Vector3<f64>) -> Self {
        let unit = |v: Vector3<f64>| {
            let scaled = v / v.amax(); // so that no square overflows
            if scaled.iter().all(|x| x.is_finite()) { scaled.normalize() } else { Vector3::x() }
        };
        Self { j1: unit(j1), j2: unit(j2) }
    }

    /// The opposite sign pairing, where Algorithm 1 starts again (eq. 28).
    pub fn other_sign_pair(&self) -> Self {
        Self { j1: self.j1, j2: -self.j2 }
    }

    /// The same axis with the overall sign turned.
    pub fn flipped(&self) -> Self {
        Self { j1: -self.j1, j2: -self.j2 }
    }

    /// The canonical one of the two overall signs: the largest component of `j1` is positive.
    pub fn canonical(&self) -> Self {
        if self.j1[self.j1.iamax()] < 0.0 { self.flipped() } else { *self }
    }

    /// The tangent planes of both axes.
    pub fn tangent(&self) -> Tangent {
        Tangent { b1: tangent_basis(&self.j1), b2: tangent_basis(&self.j2) }
    }

    /// The pair reached by a tangent step (two components for each axis).
    pub fn step(&self, tangent: &Tangent, step: &Vector4<f64>) -> Self {
        Self {
            j1: retract(&self.j1, &tangent.b1, &Vector2::new(step[0], step[1])),
            j2: retract(&self.j2, &tangent.b2, &Vector2::new(step[2], step[3])),
        }
    }
}

/// Orthonormal bases of the tangent planes at an [`AxisPair`].
#[derive(Clone, Copy, Debug)]
pub struct Tangent {
    /// At `j1`, in sensor frame 1.
    pub b1: nalgebra::Matrix3x2<f64>,
    /// At `j2`, in sensor frame 2.
    pub b2: nalgebra::Matrix3x2<f64>,
}

impl Tangent {
    /// The 6×4 matrix that takes a tangent step to the stacked change of `(j1, j2)`.
    pub fn stacked(&self) -> Matrix6x4<f64> {
        let mut b = Matrix6x4::zeros();
        b.fixed_view_mut::<3, 2>(0, 0).copy_from(&self.b1);
        b.fixed_view_mut::<3, 2>(3, 2).copy_from(&self.b2);
        b
    }
}

/// The axes stacked, `[j1; j2]`.
pub fn stack(axes: &AxisPair) -> Vector6<f64> {
    Vector6::new(axes.j1.x, axes.j1.y, axes.j1.z, axes.j2.x, axes.j2.y, axes.j2.z)
}
