//! What the samples say of the joint centre, and what they do not: covariance under correlated residuals, and the directions
//! that the motion left open.

use alloc::vec::Vec;
use nalgebra::{ComplexField, SMatrix, SVector, SymmetricEigen};

use super::{
    Matrix12, Unknowns,
    loss::Loss,
    moments::Moments,
    residual::{spread, sums},
    solve::Knowledge,
};

/// Residuals closer in time than this share their causes and count as one observation, s.
pub const PIECE_S: f64 = 1.0;
/// What a sensor gets wrong anyway, m/s²: smaller residuals are no reason to be surer.
pub const LEAST_RESIDUAL: f64 = 0.01;

/// How far a solution can be trusted.
#[derive(Clone, Debug)]
pub struct Evidence {
    /// Covariance of the unknowns, m² and (m/s²)².
    pub covariance: Matrix12,
    /// Standard deviation of the residual, m/s²: rms; of absolute values, their mean times √(π/2).
    pub residual_std: f64,
    /// Rms residual at the solution over that at zero lever arms: near 1 the solution explains nothing.
    pub unexplained: f64,
    /// Pieces of time behind the covariance.
    pub pieces: usize,
}

/// Evidence at the solution `x` of `loss`.
pub fn evidence(moments: &Moments, x: &Unknowns, loss: Loss, knowledge: &Knowledge) -> Evidence {
    let count = moments.len().max(1) as f64;
    // Absolute values have their curvature at 0 only: as much of it as the residuals near 0 show.
    let loss = match loss {
        Loss::Absolute(..) => Loss::Absolute(0.5 * (sums(moments, x, loss, false).absolute / count).max(LEAST_RESIDUAL), 0.0),
        _ => loss,
    };
    let spread = spread(moments, x, loss, knowledge.biases(), |time| ComplexField::floor(time / PIECE_S));
    let weight = count / (loss.power() * knowledge.correlated) / (spread.cost + count * loss.of(LEAST_RESIDUAL).0);
    let rms = ComplexField::sqrt(spread.squares / count);
    Evidence {
        covariance: sandwich(&spread.scores, &spread.hessian, weight, knowledge),
        residual_std: if loss.power() == 1.0 { spread.absolute / count * 1.2533 } else { rms },
        unexplained: if spread.without_levers > 0.0 { ComplexField::sqrt(spread.squares / spread.without_levers) } else { 1.0 },
        pieces: spread.scores.len(),
    }
}

/// `H⁻¹ (Σ s sᵀ + P) H⁻¹` over the scores s of pieces of time, with what is known beforehand (P) in both.
pub(super) fn sandwich(scores: &[Unknowns], hessian: &Matrix12, weight: f64, knowledge: &Knowledge) -> Matrix12 {
    let active = if knowledge.biases() { 12 } else { 6 };
    let prior = Matrix12::from_diagonal(&knowledge.information());
    let bread = invert(&(hessian * weight + prior), active);
    let few = scores.len() as f64 / (scores.len() as f64 - active as f64 * 0.5).max(1.0);
    let meat = scores.iter().fold(Matrix12::zeros(), |meat, s| meat + s * s.transpose());
    bread * (meat * (weight * weight * few) + prior) * bread
}

/// Inverse over the first `active` unknowns, zero elsewhere.
fn invert(matrix: &Matrix12, active: usize) -> Matrix12 {
    let mut held = *matrix;
    for k in active..12 {
        held.row_mut(k).fill(0.0);
        held.column_mut(k).fill(0.0);
        held[(k, k)] = 1.0;
    }
    let scale = held.trace();
    let mut inverse = (held + Matrix12::identity() * (1e-14 * scale)).cholesky().map_or(Matrix12::zeros(), |c| c.inverse());
    (active..12).for_each(|k| inverse[(k, k)] = 0.0);
    inverse
}

/// Unit directions of a 6×6 covariance in which the standard deviation exceeds `limit`, the worst first.
pub fn undetermined(covariance: &SMatrix<f64, 6, 6>, limit: f64) -> Vec<SVector<f64, 6>> {
    let eigen = SymmetricEigen::new(*covariance);
    let mut open: Vec<usize> = (0..6).filter(|&k| eigen.eigenvalues[k] > limit * limit).collect();
    open.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    open.into_iter().map(|k| eigen.eigenvectors.column(k).into()).collect()
}
