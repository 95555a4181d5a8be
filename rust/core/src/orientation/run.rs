//! A whole recording: the estimate of every sample, at its own time.

use alloc::vec::Vec;

use super::{
    algebra::{exp, mul, normalize},
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

/// The samples whose neighbours never came, and the starts.
pub(super) fn finish<T: Real, M: Method>(filter: &mut Filter<T, M>, signals: &Signals<'_>, estimates: &mut Vec<Estimate>) {
    let last = filter.latest();
    let mut rest = filter.clone();
    rest.flush(&mut |_, e| estimates.push(e));
    if let (Some(end), Status::Starting) = (estimates.last_mut(), last.status) {
        end.q = last.q;
    }
    carry_back(filter.settings(), signals, estimates);
}

/// Gives the samples of a start the orientation that it found, turned back by the gyroscopes.
fn carry_back(settings: &Settings, signals: &Signals<'_>, estimates: &mut [Estimate]) {
    let [gyr1, _, gyr2, _] = signals.xyz;
    for k in (0..estimates.len().saturating_sub(1)).rev() {
        if estimates[k].status != Status::Starting {
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
        let [w, x, y, z] = exp(turn(gyr2, settings.joint.gyr_bias[1]));
        let Estimate { q, std, .. } = estimates[k + 1];
        estimates[k].q = normalize(mul(mul(exp(turn(gyr1, settings.joint.gyr_bias[0])), q), [w, -x, -y, -z]));
        // Nothing is carried over a break: before it the orientation stays unknown.
        estimates[k].std = if dt * settings.rate_hz > BREAK_STEPS { core::f64::consts::PI } else { std };
    }
}
