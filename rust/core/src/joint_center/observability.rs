//! What the samples say of the joint centre, and what they do not: covariance under correlated residuals, and the directions
//! that the motion left open.

use alloc::vec::Vec;
use nalgebra::{ComplexField, SMatrix, SVector, SymmetricEigen};

use super::{
    Matrix12, Unknowns,
    loss::Loss,
    moments::Moments,
    residual::{considered, residual, spread},
    solve::Knowledge,
};

/// Residuals closer in time than this share their causes, s.
pub const PIECE_S: f64 = 1.0;
/// What a sensor gets wrong anyway, m/s²: smaller residuals are no reason to be surer.
pub const LEAST_RESIDUAL: f64 = 0.003;
/// Residuals as large as this, m/s², are no noise: skin, straps or the joint itself move, in step with the motion, so that all
/// samples of a second count as one. Mechanical joints leave 0.01–0.05, knees 0.3–1.
const TISSUE_RESIDUAL: f64 = 0.15;
/// What is not estimated but considered: standard deviations of the scale factors of gyroscopes and accelerometers.
const SCALE_STD: f64 = 0.001;
/// Typical sizes are read off so many samples.
const FEW_SAMPLES: usize = 256;

/// How far a solution can be trusted.
#[derive(Clone, Debug)]
pub struct Evidence {
    /// Covariance of the unknowns, m² and (m/s²)².
    pub covariance: Matrix12,
    /// Standard deviation of the residual, m/s²: rms; with absolute values that of a Gaussian of the same
    /// typical size.
    pub residual_std: f64,
    /// Rms residual at the solution over that at zero lever arms: near 1 the solution explains nothing.
    pub unexplained: f64,
    /// Pieces of time behind the covariance.
    pub pieces: usize,
}

/// Evidence at the solution `x` of `loss`.
pub fn evidence(moments: &Moments, x: &Unknowns, loss: Loss, knowledge: &Knowledge) -> Evidence {
    let count = moments.len().max(1) as f64;
    let few = moments.thinned(FEW_SAMPLES);
    let typical = typical_residual(&few, x);
    // Absolute values have their curvature at 0 only: as much of it as the residuals near 0 show.
    let loss = match loss {
        Loss::Absolute(..) => Loss::Absolute(0.8 * typical.max(LEAST_RESIDUAL), 0.0),
        _ => loss,
    };
    let spread = spread(moments, x, loss, knowledge.biases(), |time| ComplexField::floor(time / PIECE_S));
    let weight = count / (loss.power() * knowledge.correlated) / (spread.cost + count * loss.of(LEAST_RESIDUAL).0);
    let rms = ComplexField::sqrt(spread.squares / count);
    let judged = Judged { scores: &spread.scores, scatter: &spread.scatter, hessian: &spread.hessian, count };
    let covariance = judged.covariance(weight, if loss.power() == 1.0 { typical } else { rms }, knowledge);
    let covariance = covariance
        + considered_covariance(&few, x, loss, weight * count / few.len().max(1) as f64, &(spread.hessian * weight), knowledge);
    Evidence {
        covariance: (covariance + covariance.transpose()) * 0.5,
        residual_std: if loss.power() == 1.0 { typical * 1.2533 } else { rms },
        unexplained: ComplexField::sqrt(spread.unexplained),
        pieces: spread.scores.len(),
    }
}

/// Median of the absolute residuals over ln 2, their mean if they are Laplace's: outliers do not enter.
fn typical_residual(few: &Moments, x: &Unknowns) -> f64 {
    let mut sizes: Vec<f64> = (0..few.len()).map(|k| ComplexField::abs(residual(&few.at(k), x).0)).collect();
    sizes.sort_by(f64::total_cmp);
    sizes.get(sizes.len() / 2).copied().unwrap_or(0.0) / core::f64::consts::LN_2
}

/// What a covariance is made from: sums over the samples.
pub(super) struct Judged<'a> {
    /// Scores of pieces of time.
    pub scores: &'a [Unknowns],
    /// Sum of the outer products of the scores of single samples.
    pub scatter: &'a Matrix12,
    /// Curvature of the cost.
    pub hessian: &'a Matrix12,
    /// Samples.
    pub count: f64,
}

impl Judged<'_> {
    /// `H⁻¹ (c S + P) H⁻¹` with the scatter S of single scores, what is known beforehand (P), and the correlation c: by how
    /// much the scores of whole seconds scatter more than single ones would make them. As one number, since its own scatter
    /// over twelve directions would be worse than what it corrects.
    pub(super) fn covariance(&self, weight: f64, residual: f64, knowledge: &Knowledge) -> Matrix12 {
        let active = if knowledge.biases() { 12 } else { 6 };
        let prior = least_known(knowledge);
        let bread = invert(&(self.hessian * weight + prior), active);
        let unknowns = active as f64;
        let pieces = self.scores.iter().fold(Matrix12::zeros(), |sum, s| sum + s * s.transpose());
        let ratio = (invert(self.scatter, active) * pieces).trace() / unknowns;
        let correlation = if ratio.is_finite() { ratio.max(1.0) } else { 1.0 };
        // Few independent samples: the scale of the residuals is itself uncertain, and they fit too well.
        let independent = self.count / correlation;
        let few = 1.0 + unknowns / (independent - unknowns).max(0.1 * unknowns);
        let tissue = (residual / TISSUE_RESIDUAL).min(1.0);
        let second = knowledge.correlated / correlation * tissue * tissue;
        bread * (self.scatter * (weight * weight * correlation * (few + second)) + prior) * bread
    }
}

/// What gyroscope biases and scale factors, which are not estimated, do to the solution; each of the few samples with the
/// weight of those that it stands for.
fn considered_covariance(
    few: &Moments,
    x: &Unknowns,
    loss: Loss,
    weight: f64,
    information: &Matrix12,
    knowledge: &Knowledge,
) -> Matrix12 {
    let mut effect = SMatrix::<f64, 12, 10>::zeros();
    for k in 0..few.len() {
        let sides = few.at(k);
        let (e, slope) = residual(&sides, x);
        effect += slope * considered(&sides, x).transpose() * loss.of(e).2;
    }
    let active = if knowledge.biases() { 12 } else { 6 };
    let prior = least_known(knowledge);
    let std = SVector::<f64, 10>::from_fn(|k, _| if k < 6 { knowledge.gyr_bias_std } else { SCALE_STD });
    let moved = invert(&(information + prior), active) * (effect * weight) * SMatrix::from_diagonal(&std);
    moved * moved.transpose()
}

/// What is known beforehand; where that is nothing, that a lever arm is within tens of metres: what nothing depends on is then
/// uncertain by as much, and no matrix singular.
fn least_known(knowledge: &Knowledge) -> Matrix12 {
    const LEAST_INFORMATION: f64 = 1e-3;
    Matrix12::from_diagonal(&knowledge.information().map(|i| i.max(LEAST_INFORMATION)))
}

/// Inverse over the first `active` unknowns, zero elsewhere.
fn invert(matrix: &Matrix12, active: usize) -> Matrix12 {
    let mut held = *matrix;
    for k in active..12 {
        held.row_mut(k).fill(0.0);
        held.column_mut(k).fill(0.0);
        held[(k, k)] = 1.0;
    }
    let scale = (0..active).map(|k| held[(k, k)]).sum::<f64>();
    let mut inverse = (held + Matrix12::identity() * (1e-14 * scale)).cholesky().map_or(Matrix12::zeros(), |c| c.inverse());
    for k in active..12 {
        inverse[(k, k)] = 0.0;
    }
    inverse
}

/// A direction is open, too, when it is this many times less certain than the third most certain...
const OUTLIER: f64 = 20.0;
/// ...and less certain than this, m.
const OUTLIER_STD: f64 = 0.002;

/// Unit directions of the stacked lever arms that are open: their standard deviation exceeds `limit`, or stands out by far (a
/// hinge in clean motion). The worst first.
pub fn open_levers(covariance: &SMatrix<f64, 6, 6>, limit: f64) -> Vec<SVector<f64, 6>> {
    if !covariance.iter().all(|v| v.is_finite()) {
        return everything();
    }
    let mut values = SymmetricEigen::new(*covariance).eigenvalues;
    values.as_mut_slice().sort_by(f64::total_cmp);
    let standing_out = (OUTLIER * ComplexField::sqrt(values[2].max(0.0))).max(OUTLIER_STD);
    beyond(covariance, limit.min(standing_out))
}

/// Unit directions of a covariance in which the standard deviation exceeds `limit`, the worst first.
pub fn beyond(covariance: &SMatrix<f64, 6, 6>, limit: f64) -> Vec<SVector<f64, 6>> {
    if !covariance.iter().all(|v| v.is_finite()) {
        return everything();
    }
    let eigen = SymmetricEigen::new(*covariance);
    let mut open: Vec<usize> = (0..6).filter(|&k| eigen.eigenvalues[k] > limit * limit).collect();
    open.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    open.into_iter().map(|k| eigen.eigenvectors.column(k).into()).collect()
}

/// Nothing is determined.
fn everything() -> Vec<SVector<f64, 6>> {
    (0..6).map(|k| SMatrix::<f64, 6, 6>::identity().column(k).into()).collect()
}
