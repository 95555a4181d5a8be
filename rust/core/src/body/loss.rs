//! How much a large residual counts where soft tissue enters.

use nalgebra::{ComplexField, Matrix3, Vector3};

/// Student's t of three dimensions with so many degrees of freedom; infinite: Gaussian.
#[derive(Clone, Copy, Debug)]
pub struct Loss {
    /// Degrees of freedom.
    pub tail: f64,
}

/// Along the residual the curvature of a heavy tail is less than its weight, and beyond the shoulder negative; no less than this
/// share of the weight is taken: less overshoots far from the minimum, all of it creeps near it.
const LEAST_BEND: f64 = 0.6;
/// Components of a residual.
const DIMENSIONS: f64 = 3.0;

impl Loss {
    /// Minus the logarithm of the likelihood, of the square of a white residual.
    pub fn cost(&self, square: f64) -> f64 {
        if self.tail.is_finite() {
            0.5 * (self.tail + DIMENSIONS) * ComplexField::ln_1p(square / self.tail)
        } else {
            0.5 * square
        }
    }

    /// Twice its derivative by the square: the weight with which squares go down the same slope.
    pub fn weight(&self, square: f64) -> f64 {
        if self.tail.is_finite() { (self.tail + DIMENSIONS) / (self.tail + square) } else { 1.0 }
    }
}

impl Loss {
    /// What a white residual becomes in the normal equations: a matrix for its derivatives, and the residual that goes with it,
    /// so that the gradient is exact and the curvature that of the loss (Triggs et al. 2000, section 4.3). With the weight alone
    /// the search would creep.
    pub fn bend(&self, residual: &Vector3<f64>) -> (Matrix3<f64>, Vector3<f64>) {
        let square = residual.norm_squared();
        let root = ComplexField::sqrt(self.weight(square));
        if !self.tail.is_finite() || square < 1e-12 {
            return (Matrix3::identity() * root, residual * root);
        }
        let along = ComplexField::sqrt(((self.tail - square) / (self.tail + square)).max(LEAST_BEND));
        let matrix = (Matrix3::identity() - residual * residual.transpose() * ((1.0 - along) / square)) * root;
        (matrix, residual * (root / along))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weight_is_the_slope_and_a_wide_tail_is_gaussian() {
        for tail in [2.0, 5.0, 1e9, f64::INFINITY] {
            let loss = Loss { tail };
            for square in [0.0, 0.3, 4.0, 90.0] {
                let slope = (loss.cost(square + 1e-4) - loss.cost(square)) / 0.5e-4;
                assert!((slope - loss.weight(square + 0.5e-4)).abs() < 1e-6 * (1.0 + 1e-9 * tail.min(1e9)) + 1e-6);
            }
        }
        let e = Vector3::new(0.5, -1.0, 0.7);
        for tail in [2.0, 20.0, f64::INFINITY] {
            let loss = Loss { tail };
            let (matrix, residual) = loss.bend(&e);
            assert!((matrix.tr_mul(&residual) - e * loss.weight(e.norm_squared())).norm() < 1e-12);
            // Where the curvature is not cut off it is that of the cost.
            let at = |x: &Vector3<f64>| loss.cost(x.norm_squared());
            let h = 1e-4;
            let step = Vector3::new(0.3, 0.2, -0.4) * h;
            let found = (at(&(e + step)) - 2.0 * at(&e) + at(&(e - step))) / (h * h);
            let stated = (matrix * step).norm_squared() / (h * h);
            assert!(tail < 5.0 || (found - stated).abs() < 1e-5, "{found} {stated}");
        }
        assert!((Loss { tail: 1e9 }.cost(5.0) - 2.5).abs() < 1e-6);
        assert_eq!(Loss { tail: f64::INFINITY }.cost(5.0), 2.5);
    }
}
