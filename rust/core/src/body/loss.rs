//! How much a large residual counts where soft tissue enters.

use nalgebra::ComplexField;

/// Student's t of three dimensions with so many degrees of freedom; infinite: Gaussian.
#[derive(Clone, Copy, Debug)]
pub struct Loss {
    /// Degrees of freedom.
    pub tail: f64,
}

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
        assert!((Loss { tail: 1e9 }.cost(5.0) - 2.5).abs() < 1e-6);
        assert_eq!(Loss { tail: f64::INFINITY }.cost(5.0), 2.5);
    }
}
