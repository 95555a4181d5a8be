//! Which samples to estimate from: Algorithm 2 (gyroscope) and Algorithm 3 (accelerometer), as streams with bounded memory.

use alloc::{collections::BinaryHeap, vec::Vec};
use core::cmp::{Ordering, Reverse};
use serde::{Deserialize, Serialize};

use super::{prune::prune, residual::acc_row};
use crate::{PairSample, Xyz};

/// A sample that may be chosen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// Its score: `s_ω` or `s_a`.
    pub score: f64,
    /// Running number; the smaller wins a tie.
    pub index: u64,
    /// s.
    pub time: f64,
    /// Rate (gyroscope) or acceleration (accelerometer) of both sensors.
    pub values: [Xyz; 2],
}

impl Candidate {
    /// The gyroscope part of an instant.
    pub fn gyr(index: u64, time: f64, sample: &PairSample, score: f64) -> Self {
        Self { score, index, time, values: [[sample[0], sample[1], sample[2]], [sample[6], sample[7], sample[8]]] }
    }

    /// The accelerometer part of an instant.
    pub fn acc(index: u64, time: f64, sample: &PairSample, score: f64) -> Self {
        Self { score, index, time, values: [[sample[3], sample[4], sample[5]], [sample[9], sample[10], sample[11]]] }
    }
}

impl Eq for Candidate {}
impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.score.total_cmp(&other.score).then(self.index.cmp(&other.index))
    }
}

/// Algorithm 2 as a stream: of all samples so far the half of `N_max` with the highest scores and the half with the lowest,
/// O(log N_max) a sample.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct GyrSelection {
    high: BinaryHeap<Reverse<Candidate>>,
    low: BinaryHeap<Candidate>,
    max_high: usize,
    max_low: usize,
}

impl GyrSelection {
    /// Keeps at most `max_samples`.
    pub fn new(max_samples: usize) -> Self {
        let max_low = max_samples / 2;
        Self { high: BinaryHeap::new(), low: BinaryHeap::new(), max_high: max_samples - max_low, max_low }
    }

    /// Considers a sample; says whether the selection changed.
    pub fn push(&mut self, candidate: Candidate) -> bool {
        if self.high.len() < self.max_high {
            self.high.push(Reverse(candidate));
            return true;
        }
        // Whatever falls out of the high half is offered to the low half.
        let offered = match self.high.peek() {
            Some(Reverse(least)) if candidate > *least => {
                self.high.push(Reverse(candidate));
                self.high.pop().map_or(candidate, |Reverse(fallen)| fallen)
            }
            _ => candidate,
        };
        let into_high = offered != candidate;
        if self.low.len() < self.max_low {
            self.low.push(offered);
            return true;
        }
        match self.low.peek() {
            Some(most) if offered < *most => {
                self.low.push(offered);
                self.low.pop();
                true
            }
            _ => into_high,
        }
    }

    /// The samples chosen, in the order they came.
    pub fn chosen(&self) -> Vec<Candidate> {
        let mut all: Vec<Candidate> = self.high.iter().map(|Reverse(c)| *c).chain(self.low.iter().copied()).collect();
        all.sort_by_key(|c| c.index);
        all
    }

    /// Whether this, read back, can go on where `fresh` would begin.
    pub(crate) fn fits(&self, fresh: &Self) -> bool {
        (self.max_high, self.max_low) == (fresh.max_high, fresh.max_low)
            && self.high.len() <= self.max_high
            && self.low.len() <= self.max_low
    }

    /// How many are chosen.
    pub fn len(&self) -> usize {
        self.high.len() + self.low.len()
    }

    /// Whether none is chosen.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Algorithm 3 as a stream: samples above the energy threshold are passed over, the others kept until [`Self::settle`]
/// prunes them to `N_max`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct AccSelection {
    kept: Vec<Candidate>,
    max_samples: usize,
    energy_threshold: f64,
    always_quiet: bool,
}

impl AccSelection {
    /// Keeps at most `max_samples` after each settling, none with a score above `energy_threshold` (rad²/s²); unless
    /// `always_quiet`, louder ones are kept too while there are fewer than `max_samples`, as published.
    pub fn new(max_samples: usize, energy_threshold: f64, always_quiet: bool) -> Self {
        Self { kept: Vec::new(), max_samples, energy_threshold, always_quiet }
    }

    /// Considers a sample; says whether it became a candidate.
    pub fn push(&mut self, candidate: Candidate) -> bool {
        if self.always_quiet && candidate.score > self.energy_threshold {
            return false;
        }
        self.kept.push(candidate);
        true
    }

    /// Prunes to `N_max`.
    pub fn settle(&mut self) {
        if self.kept.len() > self.max_samples {
            self.kept.retain(|c| c.score <= self.energy_threshold);
        }
        if self.kept.len() > self.max_samples {
            let rows: Vec<_> = self.kept.iter().map(|c| acc_row(&c.values[0], &c.values[1])).collect();
            let scores: Vec<f64> = self.kept.iter().map(|c| c.score).collect();
            let mut keep = prune(&rows, &scores, self.max_samples).into_iter();
            self.kept.retain(|_| keep.next().unwrap_or(true));
        }
    }

    /// Whether this, read back, can go on where `fresh` would begin.
    pub(crate) fn fits(&self, fresh: &Self) -> bool {
        (self.max_samples, self.energy_threshold, self.always_quiet)
            == (fresh.max_samples, fresh.energy_threshold, fresh.always_quiet)
    }

    /// The samples chosen, in the order they came; settled.
    pub fn chosen(&self) -> &[Candidate] {
        &self.kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_heaps_hold_the_two_ends_of_the_sorted_list() {
        let score = |k: u64| ((k * 7919) % 101) as f64 - 50.0;
        for (count, max) in [(5_u64, 10_usize), (10, 10), (500, 10), (500, 7), (500, 1), (37, 36)] {
            let mut selection = GyrSelection::new(max);
            let mut all: Vec<Candidate> =
                (0..count).map(|k| Candidate { score: score(k), index: k, time: k as f64, values: [[0.0; 3]; 2] }).collect();
            all.iter().for_each(|c| {
                selection.push(*c);
            });
            all.sort();
            let low = (max / 2).min(all.len().saturating_sub(max - max / 2));
            let high = (max - max / 2).min(all.len());
            let mut expected: Vec<u64> = all[..low].iter().chain(&all[all.len() - high..]).map(|c| c.index).collect();
            expected.sort();
            let got: Vec<u64> = selection.chosen().iter().map(|c| c.index).collect();
            assert_eq!(got, expected, "{count} {max}");
        }
    }
}
