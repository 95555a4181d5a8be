//! What a rigid body does to a sensor that sits off the joint centre: eqs 1–5 of Olsson & Halvorsen 2017, and the angular
//! acceleration that they need.

use alloc::vec::Vec;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use crate::{PairSample, Xyz};

/// `K(ω, ω̇) = [ω×]² + [ω̇×]` (eq. 5): what the acceleration of a point gains per metre away from the joint centre, 1/s².
pub fn lever_matrix(gyr: &Vector3<f64>, gyr_dot: &Vector3<f64>) -> Matrix3<f64> {
    let omega = gyr.cross_matrix();
    omega * omega + gyr_dot.cross_matrix()
}

/// `K(ω, ω̇) r = ω×(ω×r) + ω̇×r`, m/s².
pub fn lever_acceleration(gyr: &Vector3<f64>, gyr_dot: &Vector3<f64>, r: &Vector3<f64>) -> Vector3<f64> {
    gyr.cross(&gyr.cross(r)) + gyr_dot.cross(r)
}

/// Specific force at the joint centre in the frame of a sensor that sits at `r` from it (eqs 3–4): `a − K(ω, ω̇) r`.
pub fn joint_center_acceleration(
    acc: &Vector3<f64>,
    gyr: &Vector3<f64>,
    gyr_dot: &Vector3<f64>,
    r: &Vector3<f64>,
) -> Vector3<f64> {
    acc - lever_acceleration(gyr, gyr_dot, r)
}

/// Central differences on even samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Stencil {
    /// `(y₊₁ − y₋₁)/2h`, exact for parabolas: eq. 8.
    Three,
    /// `(8(y₊₁ − y₋₁) − (y₊₂ − y₋₂))/12h`, exact for polynomials of degree four.
    Five,
}

impl Stencil {
    /// Samples on either side, and the delay in samples.
    pub fn reach(self) -> usize {
        match self {
            Self::Three => 1,
            Self::Five => 2,
        }
    }

    /// Derivative in the middle of `2·reach + 1` values that are `step_s` apart.
    #[inline(always)]
    pub fn derivative(self, value: impl Fn(usize) -> f64, step_s: f64) -> f64 {
        match self {
            Self::Three => (value(2) - value(0)) / (2.0 * step_s),
            Self::Five => (8.0 * (value(3) - value(1)) - (value(4) - value(0))) / (12.0 * step_s),
        }
    }
}

/// One instant of two sensors with their angular accelerations (rad/s²).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Moment {
    /// Time, s.
    pub time_s: f64,
    /// gyr1, acc1, gyr2, acc2.
    pub sample: PairSample,
    /// Angular acceleration of sensor 1.
    pub gyr_dot1: Xyz,
    /// Angular acceleration of sensor 2.
    pub gyr_dot2: Xyz,
}

/// Moments that are made side by side.
pub(crate) const RUN: usize = 32;
/// Channels of a moment: gyr, gyr_dot, acc of sensor 1, then of sensor 2.
pub(crate) const MOMENT: usize = 18;

/// Up to [`RUN`] moments, each channel on its own.
#[derive(Clone, Debug)]
pub(crate) struct Run {
    pub count: usize,
    pub time_s: [f64; RUN],
    pub channels: [[f64; RUN]; MOMENT],
}

/// Differentiates the rates of an even stream; late by [`Stencil::reach`] samples.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Differentiator {
    stencil: Stencil,
    step_s: f64,
    /// Samples that wait, the oldest first: those whose neighbours have been seen already lead.
    samples: Vec<(f64, PairSample)>,
}

impl Differentiator {
    /// For samples `step_s` apart.
    pub fn new(stencil: Stencil, step_s: f64) -> Self {
        Self { stencil, step_s, samples: Vec::new() }
    }

    /// Forgets what it holds: no derivative crosses a break.
    pub fn reset(&mut self) {
        self.samples.clear();
    }

    /// Takes one sample, and says whether a whole [`Run`] is ready.
    #[inline]
    pub(crate) fn push(&mut self, time_s: f64, sample: &PairSample) -> bool {
        self.samples.push((time_s, *sample));
        self.samples.len() == RUN + 2 * self.stencil.reach()
    }

    /// The moments of all samples whose neighbours have come.
    pub(crate) fn drain(&mut self) -> Option<Run> {
        let reach = self.stencil.reach();
        let count = self.samples.len().checked_sub(2 * reach).filter(|&count| count > 0)?;
        let mut run = Run { count, time_s: [0.0; RUN], channels: [[0.0; RUN]; MOMENT] };
        let [one, two] = [0, 6];
        for (k, window) in self.samples.windows(2 * reach + 1).enumerate() {
            let (time_s, sample) = &window[reach];
            run.time_s[k] = *time_s;
            for c in 0..3 {
                for (from, to) in [(one, 0), (two, MOMENT / 2)] {
                    run.channels[to + c][k] = sample[from + c];
                    run.channels[to + 3 + c][k] = self.stencil.derivative(|n| window[n].1[from + c], self.step_s);
                    run.channels[to + 6 + c][k] = sample[from + 3 + c];
                }
            }
        }
        self.samples.drain(..count);
        Some(run)
    }

    /// Whether this, read back, can go on where `fresh` would begin.
    pub(crate) fn fits(&self, fresh: &Self) -> bool {
        self.stencil == fresh.stencil && self.step_s == fresh.step_s && self.samples.len() <= 2 * self.stencil.reach()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lever_matrix_is_the_lever_acceleration() {
        let (gyr, gyr_dot, r) = (Vector3::new(0.3, -2.0, 1.1), Vector3::new(5.0, 0.4, -7.0), Vector3::new(0.1, 0.3, -0.2));
        assert!((lever_matrix(&gyr, &gyr_dot) * r - lever_acceleration(&gyr, &gyr_dot, &r)).norm() < 1e-14);
        // Steady turning pulls towards the axis with ω²r.
        let pull = lever_acceleration(&Vector3::new(0.0, 0.0, 3.0), &Vector3::zeros(), &Vector3::new(0.5, 0.0, 0.0));
        assert!((pull - Vector3::new(-4.5, 0.0, 0.0)).norm() < 1e-15);
    }

    #[test]
    fn stencils_are_exact_for_their_polynomials_and_late_as_stated() {
        for (stencil, degree) in [(Stencil::Three, 2), (Stencil::Five, 4)] {
            let mut differentiator = Differentiator::new(stencil, 0.01);
            let value = |t: f64| (0..=degree).map(|p| t.powi(p)).sum::<f64>();
            let slope = |t: f64| (1..=degree).map(|p| f64::from(p) * t.powi(p - 1)).sum::<f64>();
            let mut count = 0;
            for k in 0..40 {
                let t = k as f64 * 0.01;
                let whole = differentiator.push(t, &[value(t); 12]);
                if let Some(run) = if whole || k % 7 == 0 { differentiator.drain() } else { None } {
                    assert_eq!(whole, run.count == RUN);
                    assert!((run.time_s[run.count - 1] - (t - stencil.reach() as f64 * 0.01)).abs() < 1e-12);
                    for n in 0..run.count {
                        assert!((run.channels[3][n] - slope(run.time_s[n])).abs() < 1e-9);
                        assert_eq!(run.channels[3][n], run.channels[12][n]);
                        assert_eq!(run.channels[6][n], value(run.time_s[n]));
                    }
                    count += run.count;
                }
            }
            count += differentiator.drain().map_or(0, |run| run.count);
            assert_eq!(count, 40 - 2 * stencil.reach());
        }
    }
}
