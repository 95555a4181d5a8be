//! A hinge's axis is one line in space, whichever sensor sees it: `e = r_a − R_aᵀ R_b r_b`. What eqs 6 to 9 say of rates, said of
//! orientations: it also holds the knee's heading while nothing moves. Not in the paper.

use nalgebra::{Matrix3, Matrix3x2, Vector3};

use super::super::states::Motion;
use crate::so3::tangent_basis;

/// Both axes.
#[derive(Clone, Copy, Debug)]
pub struct AxesAgree {
    /// Residual in the frame of a.
    pub residual: Vector3<f64>,
    /// By the rotation of a, then of b.
    pub turns: [Matrix3<f64>; 2],
    /// By the axis in a, then in b.
    pub axes: [Matrix3x2<f64>; 2],
}

/// The residual alone.
pub fn residual(a: &Motion, b: &Motion, axes: &[Vector3<f64>; 2]) -> Vector3<f64> {
    axes[0] - a.turn.tr_mul(&(b.turn * axes[1]))
}

/// Residual and derivatives.
pub fn linearised(a: &Motion, b: &Motion, axes: &[Vector3<f64>; 2]) -> AxesAgree {
    let between = a.turn.tr_mul(&b.turn);
    let carried = between * axes[1];
    AxesAgree {
        residual: axes[0] - carried,
        turns: [-carried.cross_matrix(), between * axes[1].cross_matrix()],
        axes: [tangent_basis(&axes[0]), -(between * tangent_basis(&axes[1]))],
    }
}
