//! What a residual costs.

use nalgebra::ComplexField;
use serde::{Deserialize, Serialize};

/// Residuals that go through the arithmetic together: enough to keep the vector units busy, few enough to stay in the
/// nearest cache.
pub(crate) const CHUNK: usize = 32;
pub(crate) type Chunk = [f64; CHUNK];

/// The cost of a residual e.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Loss {
    /// `e²/2` (eq. 15).
    Square,
    /// `e²/2` up to this residual, m/s², a straight line beyond.
    Huber(f64),
    /// `√(e² + ε²)` with this ε, m/s²: `|e|` (eq. 20) as ε goes to 0, and never less. With this share of the majorising
    /// curvature `1/√(e² + ε²)` mixed into the true one, so that a step is defined also where no residual is near 0.
    Absolute(f64, f64),
}

impl Loss {
    /// The power with which the scale of the residuals enters: squares grow with its square.
    pub(crate) fn power(self) -> f64 {
        if let Self::Absolute(..) = self { 1.0 } else { 2.0 }
    }

    /// What a residual of this size adds to the cost that a [`Solution`](super::solve::Solution) states.
    pub(crate) fn of_size(self, e: f64) -> f64 {
        if self.power() == 1.0 { e } else { e * e }
    }

    /// Cost, slope and curvature (never negative) of many residuals.
    #[inline(always)]
    pub(crate) fn apply(self, e: &Chunk, rho: &mut Chunk, psi: &mut Chunk, curvature: &mut Chunk) {
        match self {
            Self::Square => {
                for k in 0..CHUNK {
                    (rho[k], psi[k], curvature[k]) = (0.5 * e[k] * e[k], e[k], 1.0);
                }
            }
            Self::Huber(limit) => {
                for k in 0..CHUNK {
                    let size = ComplexField::abs(e[k]);
                    let weight = if size > limit { limit / size } else { 1.0 };
                    rho[k] = if size > limit { limit * (size - 0.5 * limit) } else { 0.5 * size * size };
                    (psi[k], curvature[k]) = (weight * e[k], weight);
                }
            }
            Self::Absolute(epsilon, majorising) => {
                let square = epsilon * epsilon;
                for k in 0..CHUNK {
                    let size = ComplexField::sqrt(e[k] * e[k] + square);
                    let inverse = 1.0 / size;
                    rho[k] = size;
                    psi[k] = e[k] * inverse;
                    curvature[k] = inverse * (square * inverse * inverse + majorising);
                }
            }
        }
    }

    /// The same for one residual.
    pub fn of(self, e: f64) -> (f64, f64, f64) {
        let (mut rho, mut psi, mut curvature) = ([0.0; CHUNK], [0.0; CHUNK], [0.0; CHUNK]);
        self.apply(&[e; CHUNK], &mut rho, &mut psi, &mut curvature);
        (rho[0], psi[0], curvature[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_is_the_derivative_and_the_absolute_value_the_limit() {
        for loss in [Loss::Square, Loss::Huber(0.7), Loss::Absolute(0.3, 0.0), Loss::Absolute(1e-3, 0.02)] {
            for e in [-2.0, -0.6999, 0.0, 0.1, 0.8, 5.0] {
                let h = 1e-6;
                let slope = (loss.of(e + h).0 - loss.of(e - h).0) / (2.0 * h);
                assert!((slope - loss.of(e).1).abs() < 1e-6 * (1.0 + e.abs()), "{loss:?} at {e}");
                assert!(loss.of(e).2 > 0.0);
            }
        }
        assert!((Loss::Absolute(1e-9, 0.0).of(-3.0).0 - 3.0).abs() < 1e-12);
    }
}
