//! Joint centre, section 2.2.3: eq. 10, `e = R_a s_a + p_a − R_b s_b − p_b`.

use nalgebra::{Matrix3, Vector3};

use super::super::states::Motion;

/// One joint.
#[derive(Clone, Copy, Debug)]
pub struct JointCenter {
    /// Residual in the world, m.
    pub residual: Vector3<f64>,
    /// By the rotation of a, then of b. By the positions it is I and −I.
    pub turns: [Matrix3<f64>; 2],
    /// By the centre as seen from a, then from b.
    pub centers: [Matrix3<f64>; 2],
}

/// The residual alone.
pub fn residual(a: &Motion, b: &Motion, centers: &[Vector3<f64>; 2]) -> Vector3<f64> {
    a.turn * centers[0] + a.position - b.turn * centers[1] - b.position
}

/// Residual and derivatives.
pub fn linearised(a: &Motion, b: &Motion, centers: &[Vector3<f64>; 2]) -> JointCenter {
    JointCenter {
        residual: residual(a, b, centers),
        turns: [-(a.turn * centers[0].cross_matrix()), b.turn * centers[1].cross_matrix()],
        centers: [a.turn, -b.turn],
    }
}
