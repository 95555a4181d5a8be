//! How much each instant tells about the axis: the windowed scores of eqs 42–46, O(1) a sample.

use alloc::{vec, vec::Vec};
use nalgebra::ComplexField;
use serde::{Deserialize, Serialize};

use crate::PairSample;

/// An instant with its scores.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scored {
    /// s.
    pub time: f64,
    /// Signals of both sensors.
    pub sample: PairSample,
    /// `s_ω` (eqs 42–44): of the differences ‖ω1‖ − ‖ω2‖ within the window the smallest in size, with its sign, rad/s.
    pub gyr_score: f64,
    /// `s_a` (eqs 45–46): the quieter sensor's mean angular rate energy within the window, rad²/s².
    pub acc_score: f64,
}

/// Number of samples, in all, of a window that lasts `window_s`: odd, so that it has a middle (0.42 s at 50 Hz: 21).
pub fn window_samples(window_s: f64, rate_hz: f64) -> usize {
    2 * (ComplexField::round(((window_s * rate_hz - 1.0) / 2.0).max(0.0)) as usize) + 1
}

/// Slides a window over the samples and scores its middle one.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ScoreWindow {
    /// The latest `length` samples and what they add to a window, a ring.
    recent: Vec<(f64, PairSample)>,
    terms: Vec<Term>,
    /// `terms[k..]` of the block before the present one, joined (van Herk's way: every window is the end of one block and
    /// the beginning of the next, so that each sum is fresh and no rounding piles up).
    ends: Vec<Term>,
    beginning: Term,
    /// Samples since the last break.
    count: usize,
}

/// What is joined over a window.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Term {
    difference: f64,
    energy1: f64,
    energy2: f64,
}

impl Term {
    const NONE: Self = Self { difference: f64::INFINITY, energy1: 0.0, energy2: 0.0 };

    fn of(sample: &PairSample) -> Self {
        let energy = |k: usize| sample[k] * sample[k] + sample[k + 1] * sample[k + 1] + sample[k + 2] * sample[k + 2];
        let (energy1, energy2) = (energy(0), energy(6));
        Self { difference: ComplexField::sqrt(energy1) - ComplexField::sqrt(energy2), energy1, energy2 }
    }

    /// The earlier difference wins a tie.
    fn then(&self, later: &Self) -> Self {
        let later_wins = ComplexField::abs(later.difference) < ComplexField::abs(self.difference);
        Self {
            difference: if later_wins { later.difference } else { self.difference },
            energy1: self.energy1 + later.energy1,
            energy2: self.energy2 + later.energy2,
        }
    }
}

impl ScoreWindow {
    /// A window of `length` samples in all, odd.
    pub fn new(length: usize) -> Self {
        Self {
            recent: vec![(0.0, [0.0; 12]); length],
            terms: vec![Term::NONE; length],
            ends: vec![Term::NONE; length + 1],
            beginning: Term::NONE,
            count: 0,
        }
    }

    /// Samples between the newest and the one that is scored.
    pub fn delay_samples(&self) -> usize {
        self.recent.len() / 2
    }

    /// Whether this, read back, can go on where `fresh` would begin.
    pub(crate) fn fits(&self, fresh: &Self) -> bool {
        let lengths = |w: &Self| (w.recent.len(), w.terms.len(), w.ends.len());
        lengths(self) == lengths(fresh) && self.count < usize::MAX / 2
    }

    /// What comes next is not joined to what came before.
    pub fn reset(&mut self) {
        self.count = 0;
    }

    /// Takes a sample and scores the one half a window ago, once the window is full.
    pub fn push(&mut self, time: f64, sample: &PairSample) -> Option<Scored> {
        let length = self.recent.len();
        let slot = self.count % length;
        if slot == 0 {
            self.beginning = Term::NONE;
        }
        self.recent[slot] = (time, *sample);
        self.terms[slot] = Term::of(sample);
        self.beginning = self.beginning.then(&self.terms[slot]);
        self.count += 1;
        let full = (self.count >= length).then(|| {
            // The window is the last part of the block before, after this slot, and this block up to it.
            let all = if slot + 1 == length { self.beginning } else { self.ends[slot + 1].then(&self.beginning) };
            let (time, sample) = self.recent[(self.count - 1 - self.delay_samples()) % length];
            let mean = |energy: f64| energy / length as f64;
            Scored { time, sample, gyr_score: all.difference, acc_score: mean(all.energy1).min(mean(all.energy2)) }
        });
        if slot + 1 == length {
            self.ends[length] = Term::NONE;
            for k in (0..length).rev() {
                self.ends[k] = self.terms[k].then(&self.ends[k + 1]);
            }
            self.count = length; // the ring has come round: only the phase matters from here on
        }
        full
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scores_are_those_of_the_plain_window() {
        let value = |k: usize, c: usize| ((k * 7 + c * 3) as f64 * 0.37).sin() * (1.0 + (k as f64 * 0.05).cos());
        let samples: Vec<PairSample> = (0..200).map(|k| core::array::from_fn(|c| value(k, c))).collect();
        for length in [1, 3, 21] {
            let mut window = ScoreWindow::new(length);
            let scored: Vec<Scored> = samples.iter().enumerate().filter_map(|(k, s)| window.push(k as f64, s)).collect();
            assert_eq!(scored.len(), samples.len() + 1 - length);
            for (k, got) in scored.iter().enumerate() {
                let terms: Vec<Term> = samples[k..k + length].iter().map(Term::of).collect();
                let smallest = terms.iter().map(|t| t.difference).min_by(|a, b| a.abs().total_cmp(&b.abs()));
                let energy = |f: fn(&Term) -> f64| terms.iter().map(f).sum::<f64>() / length as f64;
                assert_eq!(got.time, (k + length / 2) as f64);
                assert_eq!(Some(got.gyr_score), smallest);
                assert!((got.acc_score - energy(|t| t.energy1).min(energy(|t| t.energy2))).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn the_papers_window_has_21_samples_in_all() {
        assert_eq!(window_samples(0.42, 50.0), 21);
        assert_eq!(window_samples(0.42, 100.0), 43);
        assert_eq!(window_samples(0.0, 50.0), 1);
    }
}
