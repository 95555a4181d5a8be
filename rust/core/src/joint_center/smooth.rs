//! The low-pass of the joint centre, taken where it changes nothing but the bandwidth: in a frame that does not turn.
//!
//! With the orientation R(t) of a sensor in any frame at rest, the position of the sensor is `x_joint + R r`, so that
//! `R a = (ẍ_joint − g) + R̈ r + R b`. Every term is filtered by the same kernel h, and the equation stays exact:
//! `h∗(R a) = h∗(ẍ_joint − g) + (h∗R)¨ r + (h∗R) b`. A low-pass of the signals in the turning frame of the sensor would mix
//! them. R comes from the rates alone; over the second that the kernel sees it does not drift. No rate is differentiated: the
//! second derivative falls on the kernel. Both sensors get frames of their own, which norms do not see; the result is turned
//! back to the sensor frame of the middle of the kernel, where LS needs it.

use alloc::{vec, vec::Vec};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::moments::Side;
use crate::{PairSample, Xyz, lowpass::design, wide::wide};

/// Weights of a second difference over nine samples, middle first (exact for polynomials of degree nine).
const SECOND_DIFFERENCE: [f64; 5] = [-205.0 / 72.0, 8.0 / 5.0, -1.0 / 5.0, 8.0 / 315.0, -1.0 / 560.0];

/// Channels of both sensors: the columns of R, then R a.
const CHANNELS: usize = 24;
type Row = [f64; CHANNELS];

/// The low-pass.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct InertialLowpass {
    step_s: f64,
    /// Weights of the middle sample and of each pair around it: of h, and of its second derivative.
    kernel: Vec<[f64; 2]>,
    rows: Vec<Row>,
    rates: Vec<[Xyz; 2]>,
    next: usize,
    filled: usize,
    every: usize,
    wait: usize,
    orientation: [UnitQuaternion<f64>; 2],
    /// The latest four samples: a step is integrated once the sample after it is known.
    latest: [PairSample; 4],
    seen: usize,
}

impl InertialLowpass {
    /// For even samples `step_s` apart; `cutoff_hz` as in [`crate::lowpass::Lowpass::new`]. Every `every`-th comes out.
    pub fn new(cutoff_hz: f64, step_s: f64, every: usize) -> Self {
        let half = design(cutoff_hz, 1.0 / step_s);
        let reach = SECOND_DIFFERENCE.len() - 1;
        let at = |k: isize| half.get(k.unsigned_abs()).copied().unwrap_or(0.0);
        let kernel: Vec<[f64; 2]> = (0..(half.len() + reach) as isize)
            .map(|k| {
                let curved = (1..=reach as isize).map(|n| SECOND_DIFFERENCE[n as usize] * (at(k - n) + at(k + n)));
                [at(k), (SECOND_DIFFERENCE[0] * at(k) + curved.sum::<f64>()) / (step_s * step_s)]
            })
            .collect();
        let length = 2 * kernel.len() - 1;
        Self {
            step_s,
            kernel,
            rows: vec![[0.0; CHANNELS]; length],
            rates: vec![[[0.0; 3]; 2]; length],
            next: 0,
            filled: 0,
            every: every.max(1),
            wait: 0,
            orientation: [UnitQuaternion::identity(); 2],
            latest: [[0.0; 12]; 4],
            seen: 0,
        }
    }

    /// By how many samples the output is late.
    pub fn delay_samples(&self) -> usize {
        self.kernel.len() - 1 + 1
    }

    /// Forgets what it holds: nothing is filtered across a break.
    pub fn reset(&mut self) {
        (self.next, self.filled, self.wait, self.seen) = (0, 0, 0, 0);
    }

    /// Takes one sample and gives both sides as of [`Self::delay_samples`] ago, once the window is full.
    pub fn push(&mut self, sample: &PairSample) -> Option<[Side; 2]> {
        self.latest.copy_within(1..4, 0);
        self.latest[3] = *sample;
        self.seen = (self.seen + 1).min(4);
        match self.seen {
            1 => {
                self.orientation = [UnitQuaternion::identity(); 2];
                None
            }
            // The first step knows nothing before it, and begins the window with the first sample.
            2 => {
                self.enter(2);
                None
            }
            _ => {
                self.turn();
                self.enter(2)
            }
        }
    }

    /// Integrates the rates over the step that ends at `latest[2]`: Simpson, with the cubic through four samples in its middle.
    fn turn(&mut self) {
        let [before, from, to, after] = &self.latest;
        for (sensor, orientation) in self.orientation.iter_mut().enumerate() {
            let rate = |s: &PairSample| Vector3::new(s[6 * sensor], s[6 * sensor + 1], s[6 * sensor + 2]);
            let (w0, w1) = (rate(from), rate(to));
            let mean = if self.seen < 4 {
                (w0 + w1) * 0.5
            } else {
                let middle = ((w0 + w1) * 9.0 - rate(before) - rate(after)) / 16.0;
                (w0 + middle * 4.0 + w1) / 6.0
            };
            *orientation *= UnitQuaternion::from_scaled_axis(mean * self.step_s);
            orientation.renormalize_fast();
        }
    }

    /// Puts the sample `latest[k]` into the window, whose orientation is the present one.
    fn enter(&mut self, k: usize) -> Option<[Side; 2]> {
        let sample = self.latest[k];
        let length = self.rows.len();
        let row = &mut self.rows[self.next];
        for sensor in 0..2 {
            let turned = self.orientation[sensor].to_rotation_matrix();
            let s = &sample[6 * sensor..];
            let force = turned * Vector3::new(s[3], s[4], s[5]);
            let values = turned.matrix().iter().chain(force.iter());
            row[12 * sensor..12 * sensor + 12].iter_mut().zip(values).for_each(|(slot, value)| *slot = *value);
            self.rates[self.next][sensor] = [s[0], s[1], s[2]];
        }
        self.next = if self.next + 1 == length { 0 } else { self.next + 1 };
        self.filled = (self.filled + 1).min(length);
        if self.filled < length {
            return None;
        }
        let due = self.wait == 0;
        self.wait = if due { self.every - 1 } else { self.wait - 1 };
        due.then(|| self.output())
    }

    fn output(&self) -> [Side; 2] {
        let reach = self.kernel.len() - 1;
        let middle = (self.next + reach) % self.rows.len();
        let (smooth, curved) = filter(&self.rows, &self.kernel, self.next);
        [0, 1].map(|sensor| {
            let channels =
                |row: &Row, from: usize| Vector3::from_column_slice(&row[12 * sensor + from..12 * sensor + from + 3]);
            let matrix = |row: &Row| Matrix3::from_columns(&[channels(row, 0), channels(row, 3), channels(row, 6)]);
            let back = matrix(&self.rows[middle]).transpose();
            Side {
                a: back * channels(&smooth, 9),
                b: back * matrix(&smooth),
                c: back * matrix(&curved),
                gyr: self.rates[middle][sensor].into(),
            }
        })
    }

    /// Whether this, read back, can go on where `fresh` would begin.
    pub(crate) fn fits(&self, fresh: &Self) -> bool {
        let length = fresh.rows.len();
        self.step_s == fresh.step_s
            && self.kernel == fresh.kernel
            && self.every == fresh.every
            && self.rows.len() == length
            && self.rates.len() == length
            && self.next < length
            && self.filled <= length
            && self.wait < self.every
            && self.seen <= 4
    }
}

wide! {
    /// All channels by both kernels; `oldest` is where the ring of rows begins.
    fn filter(rows: &[Row], kernel: &[[f64; 2]], oldest: usize) -> (Row, Row) = filter_rows;
}

#[inline(always)]
fn filter_rows(rows: &[Row], kernel: &[[f64; 2]], oldest: usize) -> (Row, Row) {
    let (length, middle) = (rows.len(), kernel.len() - 1);
    let at = |offset: usize| {
        let place = oldest + offset;
        &rows[if place >= length { place - length } else { place }]
    };
    let [h, curve] = kernel[0];
    let (mut smooth, mut curved) = (at(middle).map(|x| x * h), at(middle).map(|x| x * curve));
    for (k, [h, curve]) in kernel.iter().enumerate().skip(1) {
        let (before, after) = (at(middle - k), at(middle + k));
        for c in 0..CHANNELS {
            let both = before[c] + after[c];
            smooth[c] += h * both;
            curved[c] += curve * both;
        }
    }
    (smooth, curved)
}
