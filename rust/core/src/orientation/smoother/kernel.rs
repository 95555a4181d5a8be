//! Weights that average a signal, and its second derivative, over a short stretch of time around a key.

use alloc::{borrow::Cow, vec::Vec};
use core::f64::consts::FRAC_PI_2;
use nalgebra::{ComplexField, SMatrix, SVector};

/// Shortest window: five samples determine a second derivative that is exact for polynomials of degree four.
pub const LEAST_REACH: usize = 2;

/// Weights of one window of samples: `Σ average·a` is the mean of `a`, `Σ curvature·p` the same mean of `p̈`.
#[derive(Clone, Debug, Default)]
pub struct Window {
    /// Sums to 1.
    pub average: Vec<f64>,
    /// 1/s².
    pub curvature: Vec<f64>,
}

impl Window {
    /// Weights `cos⁴(πt/2h)` for samples at the times `offset_s` from the key, where `h` is `half_s`.
    ///
    /// The second derivative goes over to the weights: `∫h p̈ = ∫ḧ p`, so nothing is ever differenced. Sampled weights obey
    /// this only nearly; the least change makes `Σ curvature·tⁿ` what the mean of the second derivative of `tⁿ` is, for
    /// n = 0 … 4, at any spacing.
    pub fn new(offset_s: impl Iterator<Item = f64>, half_s: f64) -> Self {
        let place: Vec<f64> = offset_s.map(|t| t / half_s).collect();
        let mut average = Vec::with_capacity(place.len());
        let mut curvature = Vec::with_capacity(place.len());
        for &x in &place {
            let inside = ComplexField::abs(x) < 1.0;
            let (sin, cos) = ComplexField::sin_cos(FRAC_PI_2 * x);
            let square = cos * cos;
            average.push(if inside { square * square } else { 0.0 });
            let bend = FRAC_PI_2 * FRAC_PI_2 * (12.0 * square * sin * sin - 4.0 * square * square);
            curvature.push(if inside { bend } else { 0.0 });
        }
        let sum: f64 = average.iter().sum();
        average.iter_mut().for_each(|w| *w /= sum);
        curvature.iter_mut().for_each(|w| *w /= sum);
        let powers = |x: f64| SVector::<f64, 5>::new(1.0, x, x * x, x * x * x, x * x * x * x);
        let (mut gram, mut short) = (SMatrix::<f64, 5, 5>::zeros(), SVector::<f64, 5>::zeros());
        for ((&x, a), c) in place.iter().zip(&average).zip(&curvature) {
            let p = powers(x);
            gram += p * p.transpose();
            short += SVector::<f64, 5>::new(0.0, 0.0, 2.0, 6.0 * x, 12.0 * x * x) * *a - p * *c;
        }
        if let Some(change) = gram.lu().solve(&short) {
            for (c, &x) in curvature.iter_mut().zip(&place) {
                *c += powers(x).dot(&change);
            }
        }
        curvature.iter_mut().for_each(|c| *c /= half_s * half_s);
        Self { average, curvature }
    }
}

/// Windows of every reach on even samples, made once.
#[derive(Clone, Debug)]
pub struct Kernel {
    reach: usize,
    step_s: f64,
    even: Vec<Window>,
}

impl Kernel {
    /// Windows up to `window_s` long on samples about `step_s` apart.
    pub fn new(window_s: f64, step_s: f64) -> Self {
        let reach = (ComplexField::round(0.5 * window_s / step_s) as usize).max(LEAST_REACH);
        let window = |n: usize| Window::new((0..=2 * n).map(|k| (k as f64 - n as f64) * step_s), (n + 1) as f64 * step_s);
        Self { reach, step_s, even: (LEAST_REACH..=reach).map(window).collect() }
    }

    /// Samples on either side of the key in the longest window.
    pub fn reach(&self) -> usize {
        self.reach
    }

    /// The longest window that fits `time_s`: the times of `2·reach + 1` samples around the key.
    pub fn window(&self, time_s: &[f64]) -> Cow<'_, Window> {
        let reach = time_s.len() / 2;
        let middle = time_s[reach];
        let off_grid = |(k, t): (usize, &f64)| {
            let steps = (t - middle) / self.step_s - (k as f64 - reach as f64);
            ComplexField::abs(steps) > EVEN_STEPS
        };
        if time_s.iter().enumerate().any(off_grid) {
            return Cow::Owned(Window::new(time_s.iter().map(|t| t - middle), (reach + 1) as f64 * self.step_s));
        }
        Cow::Borrowed(&self.even[reach - LEAST_REACH])
    }
}

/// Samples closer than this to their places on an even grid count as even, in steps.
const EVEN_STEPS: f64 = 0.01;
