//! How far an estimate of the hinge axis can be trusted: covariance (section 6.1), angular deviation in closed form, residuals.

use nalgebra::{ComplexField, Matrix2, Matrix4, Matrix6, RealField, SymmetricEigen, Vector4};

use super::{
    axes::{AxisPair, Tangent},
    cost::{HingeCost, Piece},
};

/// Numbers that say how far to trust an estimate. Covariances are of the stacked axes `[j1; j2]` in sensor coordinates,
/// singular along each axis; infinite where the data do not determine the axes or are too few to tell.
#[derive(Clone, Debug)]
pub struct Evidence {
    /// From the scatter of the scores over pieces of time (sandwich), rad².
    pub covariance: Matrix6<f64>,
    /// The paper's covariance (eq. 57), which takes residuals as independent, rad².
    pub published_covariance: Matrix6<f64>,
    /// Sample standard deviation of the gyroscope residual (eq. 58, unweighted), rad/s.
    pub gyr_residual_std: f64,
    /// Sample standard deviation of the accelerometer residual (eq. 58, unweighted), m/s².
    pub acc_residual_std: f64,
    /// See [`HingeCost::unexplained`].
    pub unexplained: f64,
    /// Pieces of time that the covariance was estimated from.
    pub pieces: usize,
}

impl Evidence {
    /// Evidence at `axes`, a minimum of `cost`.
    pub fn at(axes: &AxisPair, cost: &HingeCost) -> Self {
        let tangent = axes.tangent();
        let basis = tangent.stacked();
        let to_sensor = |p: Option<Matrix4<f64>>| match p {
            Some(p) => basis * p * basis.transpose(),
            None => Matrix6::from_diagonal_element(f64::INFINITY),
        };
        let (gyr, acc) = (cost.gyr_normal_equations(axes, &tangent), cost.acc_normal_equations(axes, &tangent));
        let gyr_residual_std = sample_std(2.0 * gyr.half_cost, gyr.sum, cost.gyr_count());
        let acc_residual_std = sample_std(cost.acc_squares(axes), acc.sum, cost.acc_count());
        let scaled = |hessian: Matrix4<f64>, std: f64| if std > 0.0 { hessian / (std * std) } else { Matrix4::zeros() };
        let pieces = cost.pieces(axes, &tangent);
        let bread = inverse(cost.weighted(&gyr, &acc).hessian);
        Self {
            covariance: to_sensor(bread.and_then(|bread| sandwich(&bread, &pieces))),
            // (J_sᵀ J_s)⁻¹ with each kind of residual scaled by its own standard deviation (eq. 57).
            published_covariance: to_sensor(inverse(
                scaled(gyr.hessian, gyr_residual_std) + scaled(acc.hessian, acc_residual_std),
            )),
            gyr_residual_std,
            acc_residual_std,
            unexplained: cost.unexplained(axes),
            pieces: pieces.len(),
        }
    }
}

/// What constant offsets do to the axes, in the coordinates of [`Evidence`]: of every gyroscope channel, rad² per (rad/s)² of
/// its variance, and between the accelerations along the axis, rad² per (m/s²)².
pub fn offset_covariances(axes: &AxisPair, cost: &HingeCost) -> (Matrix6<f64>, Matrix6<f64>) {
    let tangent = axes.tangent();
    let Some(bread) = inverse(cost.normal_equations(axes, &tangent).hessian) else {
        return (Matrix6::from_diagonal_element(f64::INFINITY), Matrix6::from_diagonal_element(f64::INFINITY));
    };
    let (gyr, acc) = cost.offset_sensitivity(axes, &tangent);
    let (gyr, acc) = (tangent.stacked() * bread * gyr, tangent.stacked() * bread * acc);
    (gyr * gyr.transpose(), acc * acc.transpose())
}

/// Sample standard deviation (eq. 58) from sums.
fn sample_std(sum_of_squares: f64, sum: f64, count: usize) -> f64 {
    if count < 2 {
        return 0.0;
    }
    let n = count as f64;
    ComplexField::sqrt(((sum_of_squares - sum * sum / n) / (n - 1.0)).max(0.0))
}

/// `H⁻¹ (Σ s sᵀ) H⁻¹` over the scores s of pieces of time, and of pairs of pieces; the larger. Holds under residuals that are
/// correlated within a piece and of any distribution. Few pieces widen it (factor `B/(B−4)`), five are the least.
fn sandwich(bread: &Matrix4<f64>, pieces: &[Piece]) -> Option<Matrix4<f64>> {
    let of_length = |length: f64| {
        let group = |piece: &Piece| ComplexField::floor(piece.number / length);
        let scores = pieces.chunk_by(|a, b| group(a) == group(b)).map(|g| g.iter().map(|p| p.score).sum::<Vector4<f64>>());
        let (meat, count) = scores.fold((Matrix4::zeros(), 0.0), |(meat, n), s| (meat + s * s.transpose(), n + 1.0));
        (count > 4.0).then(|| bread * meat * bread * (count / (count - 4.0)))
    };
    let (single, double) = (of_length(1.0)?, of_length(2.0));
    Some(double.filter(|d| d.trace() > single.trace()).unwrap_or(single))
}

/// Inverse of a matrix that is positive definite to working precision.
pub(super) fn inverse(m: Matrix4<f64>) -> Option<Matrix4<f64>> {
    let scale = m.trace();
    let factor = m.cholesky()?;
    factor.l_dirty().diagonal().iter().all(|d| d * d > 1e-13 * scale).then(|| factor.inverse())
}

/// Mean and standard deviation of the angle between an axis and its estimate, rad, for a Gaussian error with the 2×2
/// covariance `p` in the tangent plane: eqs 62–65 in closed form. With eigenvalues a ≥ b of `p`, the length of the error has
/// mean `√(2a/π)·E(1 − b/a)` (complete elliptic integral of the second kind) and mean square `a + b`.
pub fn angular_deviation(p: &Matrix2<f64>) -> (f64, f64) {
    if !p.iter().all(|x| x.is_finite()) {
        return (f64::INFINITY, f64::INFINITY);
    }
    let e = SymmetricEigen::new(*p).eigenvalues;
    let (a, b) = (e.max().max(0.0), e.min().max(0.0));
    if a == 0.0 {
        return (0.0, 0.0);
    }
    let mean = ComplexField::sqrt(2.0 * a / f64::pi()) * elliptic_e(1.0 - b / a);
    (mean, ComplexField::sqrt((a + b - mean * mean).max(0.0)))
}

/// The 2×2 tangent covariance of axis 1 or 2 out of the 6×6 covariance in sensor coordinates.
pub fn tangent_covariance(covariance: &Matrix6<f64>, tangent: &Tangent) -> [Matrix2<f64>; 2] {
    let (p1, p2) = (covariance.fixed_view::<3, 3>(0, 0), covariance.fixed_view::<3, 3>(3, 3));
    [tangent.b1.transpose() * p1 * tangent.b1, tangent.b2.transpose() * p2 * tangent.b2]
}

/// Complete elliptic integral of the second kind E(m), 0 ≤ m ≤ 1, by the arithmetic-geometric mean.
fn elliptic_e(m: f64) -> f64 {
    if m >= 1.0 {
        return 1.0;
    }
    let (mut mean, mut root) = (1.0, ComplexField::sqrt(1.0 - m));
    let (mut weight, mut sum) = (0.5, 0.5 * m);
    // Converges quadratically: a handful of rounds.
    while mean - root > 1e-16 * mean && weight < 1e6 {
        let half_difference = 0.5 * (mean - root);
        (mean, root) = (0.5 * (mean + root), ComplexField::sqrt(mean * root));
        weight *= 2.0;
        sum += weight * half_difference * half_difference;
    }
    f64::pi() / (2.0 * mean) * (1.0 - sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elliptic_integral_has_its_known_values() {
        assert!((elliptic_e(0.0) - core::f64::consts::FRAC_PI_2).abs() < 1e-15);
        // Abramowitz & Stegun, table 17.1.
        for (m, e) in [(0.5, 1.350_643_881_047_675), (0.9, 1.104_774_732_704_073), (1.0, 1.0)] {
            assert!((elliptic_e(m) - e).abs() < 1e-14, "E({m}) = {}", elliptic_e(m));
        }
    }

    #[test]
    fn angular_deviation_has_the_moments_of_its_limits() {
        let pi = core::f64::consts::PI;
        let (mean, std) = angular_deviation(&Matrix2::identity()); // Rayleigh
        assert!((mean - (pi / 2.0).sqrt()).abs() < 1e-14 && (std - (2.0 - pi / 2.0).sqrt()).abs() < 1e-14);
        let (mean, std) = angular_deviation(&Matrix2::new(4.0, 0.0, 0.0, 0.0)); // half normal
        assert!((mean - 2.0 * (2.0 / pi).sqrt()).abs() < 1e-14 && (std - 2.0 * (1.0 - 2.0 / pi).sqrt()).abs() < 1e-14);
    }
}
