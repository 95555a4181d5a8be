//! The one low-pass of imufast: a symmetric (linear-phase) FIR, so that a stream and a whole recording agree to the bit. The
//! output is late by [`Lowpass::delay_samples`] and belongs to the middle of its window; nothing comes out for a window that
//! is not full, and [`Lowpass::reset`] empties it where time jumps.

use alloc::{vec, vec::Vec};
use nalgebra::{ComplexField, RealField};
use serde::{Deserialize, Serialize};

use crate::PairSample;

/// Filters all channels of two sensors side by side.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Lowpass {
    /// Weights of the middle sample and of each pair around it.
    half_kernel: Vec<f64>,
    window: Vec<PairSample>,
    next: usize,
    filled: usize,
    /// One output for so many samples.
    every: usize,
    /// Samples until the next output, once the window is full.
    wait: usize,
}

impl Lowpass {
    /// A windowed sinc (Hamming) with −6 dB at `cutoff_hz` and zeros beyond; its half length is one period of the cut-off.
    /// `cutoff_hz` at or above half the rate, or not positive, gives the identity. Of the filtered samples every `every`-th
    /// comes out; the others are never computed.
    pub fn new(cutoff_hz: f64, rate_hz: f64, every: usize) -> Self {
        let half_kernel = design(cutoff_hz, rate_hz);
        let length = 2 * half_kernel.len() - 1;
        Self { half_kernel, window: vec![[0.0; 12]; length], next: 0, filled: 0, every: every.max(1), wait: 0 }
    }

    /// By how many samples the output is late.
    pub fn delay_samples(&self) -> usize {
        self.half_kernel.len() - 1
    }

    /// Whether every sample comes out as it came.
    pub fn is_identity(&self) -> bool {
        self.window.len() == 1 && self.every == 1
    }

    /// Forgets what it holds: what comes next is not joined to what came before.
    pub fn reset(&mut self) {
        (self.next, self.filled, self.wait) = (0, 0, 0);
    }

    /// Takes one sample and gives the filtered sample of [`Self::delay_samples`] ago, once the window is full.
    pub fn push(&mut self, sample: &PairSample) -> Option<PairSample> {
        let length = self.window.len();
        self.window[self.next] = *sample;
        self.next = if self.next + 1 == length { 0 } else { self.next + 1 };
        self.filled = (self.filled + 1).min(length);
        if self.filled < length {
            return None;
        }
        let due = self.wait == 0;
        self.wait = if due { self.every - 1 } else { self.wait - 1 };
        due.then(|| self.output())
    }

    /// Whether this, read back, can go on where `fresh` would begin.
    pub(crate) fn fits(&self, fresh: &Self) -> bool {
        self.half_kernel == fresh.half_kernel
            && self.every == fresh.every
            && self.window.len() == fresh.window.len()
            && self.next < self.window.len()
            && self.filled <= self.window.len()
            && self.wait < self.every
    }

    fn output(&self) -> PairSample {
        let length = self.window.len();
        let middle = self.delay_samples();
        // self.next is the oldest sample of a full window.
        let at = |offset: usize| {
            let i = self.next + offset;
            &self.window[if i >= length { i - length } else { i }]
        };
        let mut sum = at(middle).map(|x| x * self.half_kernel[0]);
        for (k, weight) in self.half_kernel.iter().enumerate().skip(1) {
            let (before, after) = (at(middle - k), at(middle + k));
            for c in 0..12 {
                sum[c] += weight * (before[c] + after[c]);
            }
        }
        sum
    }
}

/// Weights of the middle sample and of each pair around it; see [`Lowpass::new`].
pub(crate) fn design(cutoff_hz: f64, rate_hz: f64) -> Vec<f64> {
    let ratio = cutoff_hz / rate_hz;
    if !(ratio > 0.0 && ratio < 0.5) {
        return vec![1.0];
    }
    let half = ComplexField::ceil(1.0 / ratio) as usize;
    let pi = f64::pi();
    let mut kernel: Vec<f64> = (0..=half)
        .map(|k| {
            let x = 2.0 * pi * ratio * k as f64;
            let sinc = if k == 0 { 1.0 } else { ComplexField::sin(x) / x };
            sinc * (0.54 + 0.46 * ComplexField::cos(pi * k as f64 / half as f64))
        })
        .collect();
    let sum = kernel[0] + 2.0 * kernel[1..].iter().sum::<f64>();
    kernel.iter_mut().for_each(|k| *k /= sum);
    kernel
}
