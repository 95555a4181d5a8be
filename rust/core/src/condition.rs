//! What happens to two sensors' samples before any algorithm sees low-passed signals: irregular time becomes even, then the
//! one low-pass, and nothing reaches across a break. One sample in, at most a few out, so a stream and a whole recording
//! agree to the bit.

use alloc::vec::Vec;
use nalgebra::ComplexField;
use serde::{Deserialize, Serialize};

use crate::{PairSample, lowpass::Lowpass};

/// A step longer than this many nominal steps is a break.
pub const BREAK_STEPS: f64 = 2.5;
/// A sample closer than this to its place on the even grid, in steps, is taken as it is.
const ON_GRID_STEPS: f64 = 1e-3;

/// Evens out time and low-passes.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Conditioner {
    step_s: f64,
    lowpass: Lowpass,
    /// Where the even grid of the present stretch starts, and how many of its points have been made.
    origin_s: f64,
    made: u64,
    last: Option<(f64, PairSample)>,
}

impl Conditioner {
    /// For samples that come at about `rate_hz`; `cutoff_hz` and `every` as in [`Lowpass::new`].
    pub fn new(cutoff_hz: f64, rate_hz: f64, every: usize) -> Self {
        let lowpass = Lowpass::new(cutoff_hz, rate_hz, every);
        Self { step_s: 1.0 / rate_hz, lowpass, origin_s: 0.0, made: 0, last: None }
    }

    /// By how much the output is late, s.
    pub fn delay_s(&self) -> f64 {
        self.lowpass.delay_samples() as f64 * self.step_s
    }

    /// Takes the sample at `time_s` (later than all before) and appends what is ready, each with the time it belongs to.
    pub fn push(&mut self, time_s: f64, sample: &PairSample, out: &mut Vec<(f64, PairSample)>) {
        self.pass(time_s, sample, &mut |time, ready| out.push((time, *ready)));
    }

    /// The same, handing what is ready to `out`.
    #[inline]
    pub fn pass(&mut self, time_s: f64, sample: &PairSample, out: &mut impl FnMut(f64, &PairSample)) {
        match self.last {
            Some((before_s, before)) if time_s - before_s <= BREAK_STEPS * self.step_s => {
                // No more points than steps fit: ends also where a step is below the resolution of time.
                for _ in 0..=BREAK_STEPS as usize {
                    let grid_s = self.origin_s + self.made as f64 * self.step_s;
                    let ahead = (grid_s - time_s) / self.step_s;
                    if ahead > ON_GRID_STEPS {
                        break;
                    }
                    if ComplexField::abs(ahead) <= ON_GRID_STEPS {
                        self.emit(time_s, sample, out);
                    } else {
                        let share = (grid_s - before_s) / (time_s - before_s);
                        self.emit(grid_s, &core::array::from_fn(|k| before[k] + share * (sample[k] - before[k])), out);
                    }
                }
            }
            _ => {
                self.lowpass.reset();
                self.origin_s = time_s;
                self.made = 0;
                self.emit(time_s, sample, out);
            }
        }
        self.last = Some((time_s, *sample));
    }

    /// Whether this, read back, can go on where `fresh` would begin.
    pub(crate) fn fits(&self, fresh: &Self) -> bool {
        self.step_s == fresh.step_s && self.lowpass.fits(&fresh.lowpass)
    }

    #[inline]
    fn emit(&mut self, time_s: f64, sample: &PairSample, out: &mut impl FnMut(f64, &PairSample)) {
        self.made += 1;
        if self.lowpass.is_identity() {
            out(time_s, sample);
        } else if let Some(smooth) = self.lowpass.push(sample) {
            out(time_s - self.delay_s(), &smooth);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(cutoff_hz: f64, times: &[f64], value: impl Fn(f64) -> f64) -> Vec<(f64, PairSample)> {
        let mut conditioner = Conditioner::new(cutoff_hz, 100.0, 1);
        let mut out = Vec::new();
        for &t in times {
            conditioner.push(t, &[value(t); 12], &mut out);
        }
        out
    }

    #[test]
    fn without_a_cutoff_even_samples_pass_untouched() {
        let times: Vec<f64> = (0..50).map(|k| 7.0 + k as f64 * 0.01).collect();
        let out = run(0.0, &times, |t| t * t);
        assert_eq!(out.iter().map(|o| o.0).collect::<Vec<_>>(), times);
        assert!(out.iter().all(|(t, s)| s[5] == t * t));
    }

    #[test]
    fn irregular_time_becomes_even_and_a_straight_line_stays_straight() {
        let times: Vec<f64> = (0..400).map(|k| k as f64 * 0.01 + 0.003 * (k as f64 * 1.7).sin()).collect();
        let out = run(5.0, &times, |t| 3.0 * t - 1.0);
        assert!(out.len() > 340);
        for pair in out.windows(2) {
            assert!((pair[1].0 - pair[0].0 - 0.01).abs() < 3e-5);
        }
        assert!(out.iter().all(|(t, s)| (s[0] - (3.0 * t - 1.0)).abs() < 1e-4));
    }

    #[test]
    fn nothing_reaches_across_a_break() {
        let times: Vec<f64> = (0..100).chain(140..300).map(|k| k as f64 * 0.01).collect();
        let step = |t: f64| if t < 1.2 { 0.0 } else { 1.0 };
        let out = run(4.0, &times, step);
        assert!(out.iter().all(|(t, s)| (s[0] - step(*t)).abs() < 1e-12));
        let delay = Conditioner::new(4.0, 100.0, 1).delay_s();
        assert!(out.iter().all(|(t, _)| *t < 1.0 - delay + 1e-9 || *t > 1.4 + delay - 1e-9));
    }

    #[test]
    fn the_lowpass_keeps_slow_waves_and_stops_fast_ones() {
        let times: Vec<f64> = (0..1000).map(|k| k as f64 * 0.01).collect();
        let gain = |hz: f64| {
            let out = run(5.0, &times, |t| (core::f64::consts::TAU * hz * t).sin());
            let power: f64 = out.iter().map(|(_, s)| s[0] * s[0]).sum::<f64>() / out.len() as f64;
            (2.0 * power).sqrt()
        };
        assert!((gain(1.0) - 1.0).abs() < 0.02, "{}", gain(1.0));
        assert!((gain(5.0) - 0.5).abs() < 0.03, "{}", gain(5.0));
        assert!(gain(10.0) < 0.01, "{}", gain(10.0));
    }
}
