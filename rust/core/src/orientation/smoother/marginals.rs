//! Marginal covariances: the blocks of the inverse that belong to single nodes and to neighbours, by one pass backwards.

use alloc::vec::Vec;
use nalgebra::{Matrix3, SMatrix, Vector3};

use super::{
    arrowhead::{Eliminated, back},
    residual::CONSTANTS,
};

/// Of one node.
#[derive(Clone, Copy, Debug)]
pub struct Marginal {
    /// Its covariance.
    pub own: Matrix3<f64>,
    /// Its covariance with the next node.
    pub with_next: Matrix3<f64>,
}

/// The marginals of every node.
///
/// Given the next node and the border, node k is `F_n x_k+1 + F_b b` with covariance `D_k⁻¹`, where
/// `[F_n F_b] = −L⁻ᵀ [U_n U_b]`; so its covariances follow from those of the next.
pub fn marginals(eliminated: &Eliminated) -> Vec<Marginal> {
    let mut all = alloc::vec![Marginal { own: Matrix3::zeros(), with_next: Matrix3::zeros() }; eliminated.nodes.len()];
    let (mut own, mut with_border) = (Matrix3::zeros(), SMatrix::<f64, 3, CONSTANTS>::zeros());
    for (node, marginal) in eliminated.nodes.iter().zip(&mut all).rev() {
        let l = &node.diagonal;
        let column = |v: Vector3<f64>| -back(l, v);
        let to_next = Matrix3::from_columns(&[0, 1, 2].map(|c| column(node.next.column(c).into())));
        let to_border = SMatrix::<f64, 3, CONSTANTS>::from_columns(&core::array::from_fn::<_, CONSTANTS, _>(|c| {
            column(Vector3::new(node.border[0][c], node.border[1][c], node.border[2][c]))
        }));
        let half = inverse_transpose(l);
        // Covariances with the next node and with the border.
        let with_next = to_next * own + to_border * with_border.transpose();
        let to_constants = to_next * with_border + to_border * eliminated.border;
        let covariance = half * half.transpose() + with_next * to_next.transpose() + to_constants * to_border.transpose();
        own = 0.5 * (covariance + covariance.transpose());
        with_border = to_constants;
        *marginal = Marginal { own, with_next };
    }
    all
}

/// The same with the border known: what of a residual the chain alone absorbs. A fraction of the work.
pub fn chain_marginals(eliminated: &Eliminated) -> Vec<Marginal> {
    let mut all = alloc::vec![Marginal { own: Matrix3::zeros(), with_next: Matrix3::zeros() }; eliminated.nodes.len()];
    let mut own = Matrix3::zeros();
    for (node, marginal) in eliminated.nodes.iter().zip(&mut all).rev() {
        let half = inverse_transpose(&node.diagonal);
        let to_next = -(half * node.next);
        let with_next = to_next * own;
        own = half * half.transpose() + with_next * to_next.transpose();
        *marginal = Marginal { own, with_next };
    }
    all
}

/// `L⁻ᵀ`.
fn inverse_transpose(l: &Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::from_columns(&[Vector3::x(), Vector3::y(), Vector3::z()].map(|e| back(l, e)))
}
