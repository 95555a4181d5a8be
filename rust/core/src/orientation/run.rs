//! A whole recording: the estimate of every sample, at its own time.

use alloc::{vec, vec::Vec};
use core::ops::Range;

use super::{
    algebra::{Quat, dot4, exp, inverted, mul, normalize, scale, sub},
    filter::{Estimate, Filter, Status},
    lane::Real,
    method::Method,
    ring::is_even,
    turns::{cubic_turn, mean},
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

    /// What is wrong with them: numbers that are none, or times that do not rise.
    pub fn fault(&self) -> Option<&'static str> {
        const FAULTS: [&str; 4] = [
            "gyr1 holds values that are not finite",
            "acc1 holds values that are not finite",
            "gyr2 holds values that are not finite",
            "acc2 holds values that are not finite",
        ];
        let is_finite = |xyz: &[Xyz]| xyz.as_flattened().iter().all(|x| x.is_finite());
        let rise = |t: &[f64]| t.iter().all(|t| t.is_finite()) && t.windows(2).all(|t| t[0] < t[1]);
        let times = || self.time_s.is_some_and(|t| !rise(t)).then_some("time_s must be finite and increase");
        FAULTS.into_iter().zip(self.xyz).find(|(_, xyz)| !is_finite(xyz)).map(|(fault, _)| fault).or_else(times)
    }

    /// One sample; zeros beyond the end.
    #[inline(always)]
    pub fn sample(&self, k: usize) -> PairSample {
        let at = |x: &[Xyz]| x.get(k).copied().unwrap_or_default();
        let [gyr1, acc1, gyr2, acc2] = self.xyz;
        let ([a, b, c], [d, e, f], [g, h, i], [j, l, m]) = (at(gyr1), at(acc1), at(gyr2), at(acc2));
        [a, b, c, d, e, f, g, h, i, j, l, m]
    }

    /// Whether samples follow each other evenly.
    pub(super) fn is_even(&self, rows: Range<usize>, rate_hz: f64) -> bool {
        self.time_s.is_none_or(|t| t[rows].windows(2).all(|t| is_even((t[1] - t[0]) * rate_hz)))
    }

    /// Its time, s.
    #[inline(always)]
    pub fn time(&self, k: usize, rate_hz: f64) -> f64 {
        self.time_s.map_or(k as f64 / rate_hz, |t| t.get(k).copied().unwrap_or(f64::NAN))
    }
}

/// Memory for the estimates of recordings.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Estimates {
    /// Sensor 2 to sensor 1.
    pub q: Vec<Quat<f64>>,
    /// Root of the trace of the covariance of the rotation error, rad.
    pub std: Vec<f64>,
}

impl Estimates {
    /// Room for so many.
    pub fn of_size(count: usize) -> Self {
        Self { q: vec![[0.0; 4]; count], std: vec![0.0; count] }
    }

    /// All of it, to be written.
    pub fn page(&mut self) -> Page<'_> {
        Page::new(&mut self.q, &mut self.std)
    }

    /// Those of a recording, one after the other.
    pub fn of<'a>(&'a self, done: &'a Done) -> impl Iterator<Item = Estimate> + 'a {
        let rows = self.q[done.rows.clone()].iter().zip(&self.std[done.rows.clone()]);
        rows.enumerate().map(|(k, (q, std))| {
            let starting = done.starts.iter().any(|start| start.contains(&k));
            Estimate { q: *q, std: *std, status: if starting { Status::Starting } else { Status::of(*std) } }
        })
    }
}

/// What became of a recording.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Done {
    /// Where its estimates are: one a sample, but for samples that were passed over.
    pub rows: Range<usize>,
    /// Rows, from its first on, in which a start was looked for: turned back from where it was found.
    pub starts: Vec<Range<usize>>,
    /// How often its filter started anew.
    pub restarts: u32,
}

/// Where the estimates of one recording go.
#[derive(Debug, Default)]
pub struct Page<'a> {
    q: &'a mut [Quat<f64>],
    std: &'a mut [f64],
    /// Of which it was said that they are of a start.
    pub(super) starts: Vec<Range<usize>>,
    /// So many are there already.
    pub(super) filled: usize,
    /// From here on all are sound, none flips, and none is of a start: nothing has to be done about them in the end.
    settled: usize,
}

impl<'a> Page<'a> {
    /// Memory of the caller, a quaternion and a standard deviation a sample; what is in it does not matter.
    pub fn new(q: &'a mut [Quat<f64>], std: &'a mut [f64]) -> Self {
        Self { q, std, ..Self::default() }
    }

    /// Samples that there is room for.
    pub(super) fn room(&self) -> usize {
        self.q.len().min(self.std.len())
    }

    /// Tears off the first part.
    pub(super) fn take(&mut self, count: usize) -> Page<'a> {
        let (q, std);
        (q, self.q) = core::mem::take(&mut self.q).split_at_mut(count);
        (std, self.std) = core::mem::take(&mut self.std).split_at_mut(count);
        Page::new(q, std)
    }

    /// One more.
    pub(super) fn push(&mut self, estimate: Estimate) {
        let at = self.filled;
        let starting = estimate.status == Status::Starting;
        (self.q[at], self.std[at]) = (estimate.q, estimate.std);
        match self.starts.last_mut() {
            Some(start) if starting && start.end == at => start.end += 1,
            _ if starting => self.starts.push(at..at + 1),
            _ => {}
        }
        self.look_at(at..at + 1, starting);
    }

    /// Looks at new rows while they are near.
    #[inline(always)]
    fn look_at(&mut self, now: Range<usize>, starting: bool) {
        let from = now.start.saturating_sub(1).max(self.settled);
        if starting || !are_continuous(&self.q[from..now.end], &self.std[from..now.end]) {
            self.settled = now.end;
        }
        self.filled = now.end;
    }

    /// Many more; `smooth`: of which it is known that nothing has to be done about them.
    #[inline(always)]
    pub(super) fn extend<T: Real>(&mut self, q: &[[T; 4]], std: &[T], smooth: bool) {
        let now = self.filled..self.filled + q.len();
        for (to, [w, x, y, z]) in self.q[now.clone()].iter_mut().zip(q) {
            *to = [w.to_f64(), x.to_f64(), y.to_f64(), z.to_f64()];
        }
        for (to, from) in self.std[now.clone()].iter_mut().zip(std) {
            *to = from.to_f64();
        }
        if smooth {
            self.filled = now.end;
        } else {
            self.look_at(now, false);
        }
    }
}

/// The samples whose neighbours never came, and the starts.
pub(super) fn finish<T: Real, M: Method>(filter: &mut Filter<T, M>, signals: &Signals<'_>, page: &mut Page<'_>) {
    let last = filter.latest();
    let mut rest = filter.clone();
    rest.flush(&mut |_, e| page.push(e));
    let all = ..page.filled;
    let (q, std) = (&mut page.q[all], &mut page.std[all]);
    if let (Some(q), Some(std), Status::Starting) = (q.last_mut(), std.last_mut(), last.status) {
        (*q, *std) = (last.q, last.std);
    }
    carry_back(filter, signals, q, std, &page.starts);
    make_continuous(q, std, page.settled);
}

/// Turns the signs so that none flips from one sample to the next. Where the numbers overflowed, the orientation is unknown. The
/// rows from `settled` on need it only if the first of them does.
fn make_continuous(q: &mut [Quat<f64>], std: &mut [f64], settled: usize) {
    let mut before = [0.0; 4];
    for (k, (q, std)) in q.iter_mut().zip(std).enumerate() {
        let flips = dot4(*q, before) < 0.0;
        if k >= settled && !flips {
            return;
        }
        if !is_sound(q, *std) {
            (*q, *std) = ([1.0, 0.0, 0.0, 0.0], core::f64::consts::PI);
        }
        if dot4(*q, before) < 0.0 {
            *q = q.map(|x| -x);
        }
        before = *q;
    }
}

/// By so much the square of a sound orientation differs from one at most.
pub(super) const UNSOUND: f64 = 1e-3;

/// Whether all are sound and none flips.
#[inline(always)]
fn are_continuous(q: &[Quat<f64>], std: &[f64]) -> bool {
    let sound = q.iter().zip(std).fold(true, |all, (q, std)| all & is_sound(q, *std));
    let pairs = q.iter().zip(q.get(1..).unwrap_or_default());
    sound & pairs.fold(true, |all, (a, b)| all & (dot4(*a, *b) >= 0.0))
}

#[inline(always)]
fn is_sound(q: &Quat<f64>, std: f64) -> bool {
    ((dot4(*q, *q) - 1.0).abs() < UNSOUND) & std.is_finite()
}

/// Gives the samples of a start the orientation that it found, turned back by the gyroscopes.
fn carry_back<T: Real, M: Method>(
    filter: &Filter<T, M>,
    signals: &Signals<'_>,
    q: &mut [Quat<f64>],
    std: &mut [f64],
    starts: &[Range<usize>],
) {
    let ([gyr1, _, gyr2, _], settings) = (signals.xyz, filter.settings());
    for k in starts.iter().rev().flat_map(|start| start.clone().rev()) {
        if k + 1 >= q.len() {
            continue;
        }
        let dt = if signals.time_s.is_some() {
            signals.time(k + 1, settings.rate_hz) - signals.time(k, settings.rate_hz)
        } else {
            1.0 / settings.rate_hz
        };
        let turn = |gyr: &[Xyz], bias: Xyz| {
            if filter.turns_by_cubics() && k > 0 && k + 2 < gyr.len() && signals.is_even(k - 1..k + 3, settings.rate_hz) {
                return cubic_turn([gyr[k - 1], gyr[k], gyr[k + 1], gyr[k + 2]].map(|rate| sub(rate, bias)), dt);
            }
            scale(sub(if settings.midpoint { mean(gyr[k], gyr[k + 1]) } else { gyr[k + 1] }, bias), dt)
        };
        let [step1, step2] = [turn(gyr1, settings.joint.gyr_bias[0]), turn(gyr2, settings.joint.gyr_bias[1])].map(exp);
        q[k] = normalize(mul(mul(step1, q[k + 1]), inverted(step2)));
        // Nothing is carried over a break: before it the orientation stays unknown.
        std[k] = if dt * settings.rate_hz > BREAK_STEPS { core::f64::consts::PI } else { std[k + 1] };
    }
}
