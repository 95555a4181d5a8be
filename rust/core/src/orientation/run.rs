//! A whole recording: the estimate of every sample, at its own time.

use alloc::vec::Vec;

use super::{
    algebra::{Quat, exp, inverted, mul, normalize},
    filter::{Estimate, Filter, Settings, Status},
    lane::Real,
    method::{Method, mean},
};
use crate::{PairSample, Xyz, condition::BREAK_STEPS};

/// gyr1, acc1, gyr2, acc2 of equal length.
#[derive(Clone, Copy, Debug)]
pub struct Signals<'a> {
    /// The four signals.
    pub xyz: [&'a [Xyz]; 4],
    /// Time of each sample, s; None: even, from 0 on.
    pub time_s: Option<&'a [f64]>,
}

impl Signals<'_> {
    /// Samples that all four have.
    pub fn len(&self) -> usize {
        let least = self.xyz.iter().map(|x| x.len()).min().unwrap_or(0);
        self.time_s.map_or(least, |t| t.len().min(least))
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// One sample; zeros beyond the end.
    #[inline(always)]
    pub fn sample(&self, k: usize) -> PairSample {
        let at = |x: &[Xyz]| x.get(k).copied().unwrap_or_default();
        let [gyr1, acc1, gyr2, acc2] = self.xyz;
        let ([a, b, c], [d, e, f], [g, h, i], [j, l, m]) = (at(gyr1), at(acc1), at(gyr2), at(acc2));
        [a, b, c, d, e, f, g, h, i, j, l, m]
    }

    /// Its time, s.
    #[inline(always)]
    pub fn time(&self, k: usize, rate_hz: f64) -> f64 {
        self.time_s.map_or(k as f64 / rate_hz, |t| t.get(k).copied().unwrap_or(f64::NAN))
    }
}

/// The estimates of a recording, part by part.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Estimates {
    /// Sensor 2 to sensor 1.
    pub q: Vec<Quat<f64>>,
    /// Root of the trace of the covariance of the rotation error, rad.
    pub std: Vec<f64>,
    /// How far to trust it.
    pub status: Vec<Status>,
}

impl Estimates {
    /// Room for so many.
    pub fn with_capacity(count: usize) -> Self {
        Self { q: Vec::with_capacity(count), std: Vec::with_capacity(count), status: Vec::with_capacity(count) }
    }

    /// One more.
    pub fn push(&mut self, estimate: Estimate) {
        self.q.push(estimate.q);
        self.std.push(estimate.std);
        self.status.push(estimate.status);
    }

    /// One after the other.
    pub fn iter(&self) -> impl Iterator<Item = Estimate> {
        let parts = self.q.iter().zip(&self.std).zip(&self.status);
        parts.map(|((q, std), status)| Estimate { q: *q, std: *std, status: *status })
    }
}

/// The samples whose neighbours never came, and the starts.
pub(super) fn finish<T: Real, M: Method>(filter: &mut Filter<T, M>, signals: &Signals<'_>, estimates: &mut Estimates) {
    let last = filter.latest();
    let mut rest = filter.clone();
    rest.flush(&mut |_, e| estimates.push(e));
    if let (Some(end), Status::Starting) = (estimates.q.last_mut(), last.status) {
        *end = last.q;
    }
    carry_back(filter.settings(), signals, estimates);
    make_continuous(estimates);
}

/// Turns the signs so that none flips from one sample to the next. Where the numbers overflowed, the orientation is unknown.
fn make_continuous(estimates: &mut Estimates) {
    let mut before = [0.0; 4];
    for (q, std) in estimates.q.iter_mut().zip(&mut estimates.std) {
        if !((dot4(q, q) - 1.0).abs() < 1e-3 && std.is_finite()) {
            (*q, *std) = ([1.0, 0.0, 0.0, 0.0], core::f64::consts::PI);
        }
        if dot4(q, &before) < 0.0 {
            *q = q.map(|x| -x);
        }
        before = *q;
    }
}

fn dot4(a: &Quat<f64>, b: &Quat<f64>) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3])
}

/// Gives the samples of a start the orientation that it found, turned back by the gyroscopes.
fn carry_back(settings: &Settings, signals: &Signals<'_>, Estimates { q, std, status }: &mut Estimates) {
    let [gyr1, _, gyr2, _] = signals.xyz;
    for k in (0..status.len().saturating_sub(1)).rev() {
        if status[k] != Status::Starting {
            continue;
        }
        let dt = if signals.time_s.is_some() {
            signals.time(k + 1, settings.rate_hz) - signals.time(k, settings.rate_hz)
        } else {
            1.0 / settings.rate_hz
        };
        let turn = |gyr: &[Xyz], bias: Xyz| {
            let rate = if settings.midpoint { mean(gyr[k], gyr[k + 1]) } else { gyr[k + 1] };
            [(rate[0] - bias[0]) * dt, (rate[1] - bias[1]) * dt, (rate[2] - bias[2]) * dt]
        };
        let [step1, step2] = [turn(gyr1, settings.joint.gyr_bias[0]), turn(gyr2, settings.joint.gyr_bias[1])].map(exp);
        q[k] = normalize(mul(mul(step1, q[k + 1]), inverted(step2)));
        // Nothing is carried over a break: before it the orientation stays unknown.
        std[k] = if dt * settings.rate_hz > BREAK_STEPS { core::f64::consts::PI } else { std[k + 1] };
    }
}
