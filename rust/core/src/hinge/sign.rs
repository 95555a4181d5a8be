//! Which of the two sign pairings is right, told from the motion in the plane of the hinge.
//!
//! The gyroscope constraint (eq. 14) does not see the sign of either axis, and gravity along the axis tells the pairing only
//! while the limb hardly turns. But both sensors see the same joint centre (eqs 4–5). In the plane across the axis, with
//! complex numbers for vectors, `c_i` for the acceleration of sensor i, `ω_i` and `α_i` for rate and angular acceleration
//! about its axis, and `θ = ∫(ω_2 − ω_1)` for the joint angle:
//!
//! `c_1 − (iα_1 − ω_1²) r_1 = p e^{iθ} (c_2 − (iα_2 − ω_2²) r_2)`
//!
//! with three unknown constants: the start angle `p`, the lever arms `r_1` and `r_2`. The wrong pairing turns θ the wrong way
//! and leaves more of `c_1` unexplained.

use alloc::vec::Vec;
use nalgebra::{Complex, ComplexField, Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::axes::AxisPair;
use crate::{PairSample, Xyz};

/// Evidence for a pairing beyond this (a third more left unexplained by the other) settles it.
pub const PAIRING_DECIDED: f64 = 0.3;

/// Half the reach of the derivative that needs neighbours on both sides.
const MARGIN: usize = 2;

/// An unbroken, evenly sampled stretch of both sensors' signals.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Stretch {
    /// Time between samples, s.
    pub step_s: f64,
    /// The samples.
    pub samples: Vec<PairSample>,
}

impl Stretch {
    /// Mean squared rate of the quieter sensor, rad²/s²: how much there is to tell the pairing from.
    pub fn liveliness(&self) -> f64 {
        let energy = |from: usize| -> f64 {
            self.samples.iter().map(|s| s[from..from + 3].iter().map(|x| x * x).sum::<f64>()).sum::<f64>()
        };
        energy(0).min(energy(6)) / self.samples.len().max(1) as f64
    }

    /// What of sensor 1's acceleration in the plane stays unexplained under `axes`: mean square, m²/s⁴.
    pub fn unexplained(&self, axes: &AxisPair) -> f64 {
        let n = self.samples.len();
        if n < 2 * MARGIN + 4 {
            return 0.0;
        }
        let tangent = axes.tangent();
        let rate = |s: &PairSample, from: usize, j: &Vector3<f64>| s[from] * j.x + s[from + 1] * j.y + s[from + 2] * j.z;
        let (rates1, rates2): (Vec<f64>, Vec<f64>) =
            self.samples.iter().map(|s| (rate(s, 0, &axes.j1), rate(s, 6, &axes.j2))).unzip();
        let slope = |r: &[f64], k: usize| (r[k - 2] - 8.0 * r[k - 1] + 8.0 * r[k + 1] - r[k + 2]) / (12.0 * self.step_s);
        let planar = |s: &PairSample, from: usize, b: &nalgebra::Matrix3x2<f64>| {
            let acc = Vector3::from(<Xyz>::from([s[from], s[from + 1], s[from + 2]]));
            Complex::new(b.column(0).dot(&acc), b.column(1).dot(&acc))
        };
        let (mut normal, mut right, mut total) = (Matrix3::<Complex<f64>>::zeros(), Vector3::<Complex<f64>>::zeros(), 0.0);
        let mut angle = 0.0;
        for k in MARGIN..n - MARGIN {
            let s = &self.samples[k];
            let relative = |k: usize| rates2[k] - rates1[k];
            if k > MARGIN {
                angle += 0.5 * self.step_s * (relative(k) + relative(k - 1));
            }
            let turn = Complex::new(ComplexField::cos(angle), ComplexField::sin(angle));
            let lever = |r: &[f64]| Complex::new(-r[k] * r[k], slope(r, k));
            let row = Vector3::new(turn * planar(s, 9, &tangent.b2), lever(&rates1), -turn * lever(&rates2));
            let seen = planar(s, 3, &tangent.b1);
            let conjugate = row.map(|z| z.conj());
            normal += conjugate * row.transpose();
            right += conjugate * seen;
            total += seen.norm_sqr();
        }
        let damping = Complex::new(1e-9 * normal.trace().re + f64::MIN_POSITIVE, 0.0);
        let Some(constants) = (normal + Matrix3::identity() * damping).lu().solve(&right) else { return total / n as f64 };
        let explained: f64 = constants.iter().zip(&right).map(|(c, r)| (c.conj() * r).re).sum();
        (total - explained).max(0.0) / (n - 2 * MARGIN) as f64
    }
}

/// Logarithm of how much more the opposite pairing leaves unexplained over all stretches; positive: `axes` are paired right.
/// Zero without stretches.
pub fn pairing_evidence<'a>(axes: &AxisPair, stretches: impl Iterator<Item = &'a Stretch> + Clone) -> f64 {
    /// What is left unexplained anyway, (m/s²)²: noise, and gravity turned by the angle that a gyroscope bias of 1 deg/s adds up
    /// to over a stretch.
    const FLOOR: f64 = 0.05;
    let count = stretches.clone().count();
    if count == 0 {
        return 0.0;
    }
    let power = |axes: &AxisPair| stretches.clone().map(|s| s.unexplained(axes)).sum::<f64>() / count as f64 + FLOOR;
    ComplexField::ln(power(&axes.other_sign_pair()) / power(axes))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A planar linkage whose sensors are mounted with their z axes along the hinge, lever arms r1, r2.
    fn linkage() -> Stretch {
        let (r1, r2) = (Complex::new(0.1, -0.05), Complex::new(-0.12, 0.02));
        let step_s = 0.02;
        let samples = (0..200)
            .map(|k| {
                let t = k as f64 * step_s;
                // Angles of both segments and the joint centre's acceleration (with gravity) in the fixed frame.
                let (a1, w1, d1) = ((2.0 * t).sin(), 2.0 * (2.0 * t).cos(), -4.0 * (2.0 * t).sin());
                let (a2, w2, d2) = (1.5 * (3.0 * t).cos(), -4.5 * (3.0 * t).sin(), -13.5 * (3.0 * t).cos());
                let centre = Complex::new((1.3 * t).sin(), 9.81 + (2.1 * t).cos());
                let seen = |a: f64, w: f64, d: f64, r: Complex<f64>| {
                    Complex::new((-a).cos(), (-a).sin()) * centre + Complex::new(-w * w, d) * r
                };
                let (c1, c2) = (seen(a1, w1, d1, r1), seen(a2, w2, d2, r2));
                [0.0, 0.0, w1, c1.re, c1.im, 0.0, 0.0, 0.0, w2, c2.re, c2.im, 0.0]
            })
            .collect();
        Stretch { step_s, samples }
    }

    #[test]
    fn the_right_pairing_explains_the_motion_and_the_wrong_one_does_not() {
        let stretch = linkage();
        let right = AxisPair::new(Vector3::z(), Vector3::z());
        assert!(stretch.unexplained(&right) < 1e-3, "{}", stretch.unexplained(&right));
        assert!(stretch.unexplained(&right.other_sign_pair()) > 1.0);
        assert!(pairing_evidence(&right, [stretch.clone()].iter()) > 3.0);
        assert!(pairing_evidence(&right.other_sign_pair(), [stretch].iter()) < -3.0);
        assert_eq!(pairing_evidence(&right, [].iter()), 0.0);
    }
}
