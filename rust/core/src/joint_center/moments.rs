//! The samples that a joint centre is estimated from. Of both sensors at one instant they say `p = A − B b − C r`, the specific
//! force at the joint centre, in the frame of the sensor: raw samples with `A = a, B = I, C = K(ω, ω̇)` (eqs 3–4), smoothed
//! ones as the module `smooth` makes them.

use alloc::vec::Vec;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::loss::{CHUNK, Chunk};
use crate::rigid_body::{MOMENT, Moment, Run, lever_matrix};

/// Channels of one sensor, raw: gyr, gyr_dot, acc.
pub(crate) const RAW: usize = MOMENT / 2;
/// Channels of one sensor, smoothed: A, the columns of B and of C, gyr.
pub(crate) const SMOOTH: usize = 24;

/// One sensor at one instant.
#[derive(Clone, Copy, Debug)]
pub struct Side {
    /// Specific force, m/s².
    pub a: Vector3<f64>,
    /// What a bias of the accelerometer adds to it.
    pub b: Matrix3<f64>,
    /// What a lever arm adds to it, 1/s².
    pub c: Matrix3<f64>,
    /// Angular rate, rad/s.
    pub gyr: Vector3<f64>,
}

/// Many instants of both sensors, all raw or all smoothed, laid out so that [`CHUNK`] of them go through the arithmetic side
/// by side.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Moments {
    time_s: Vec<f64>,
    /// Blocks of one chunk a channel, sensor 1 first. The last block is filled up with zeros.
    chunks: Vec<Chunk>,
    /// Channels of both sensors.
    channels: usize,
}

impl Moments {
    /// Adds a raw instant.
    pub fn push(&mut self, m: &Moment) {
        let ([a, b, c, d, e, f, g, h, i, j, k, l], [p, q, r], [s, t, u]) = (m.sample, m.gyr_dot1, m.gyr_dot2);
        self.push_values(m.time_s, &[a, b, c, p, q, r, d, e, f, g, h, i, s, t, u, j, k, l]);
    }

    /// Adds a smoothed instant.
    pub fn push_smooth(&mut self, time_s: f64, sides: &[Side; 2]) {
        let mut values = [0.0; 2 * SMOOTH];
        for (values, side) in values.as_chunks_mut::<SMOOTH>().0.iter_mut().zip(sides) {
            let all = side.a.iter().chain(side.b.iter()).chain(side.c.iter()).chain(side.gyr.iter());
            values.iter_mut().zip(all).for_each(|(slot, value)| *slot = *value);
        }
        self.push_values(time_s, &values);
    }

    /// Adds an instant by its channels.
    #[inline]
    pub(super) fn push_values(&mut self, time_s: f64, values: &[f64]) {
        debug_assert!(self.is_empty() || self.channels == values.len(), "raw and smoothed instants do not mix");
        self.channels = values.len();
        let place = self.time_s.len() % CHUNK;
        if place == 0 {
            self.chunks.resize(self.chunks.len() + values.len(), [0.0; CHUNK]);
        }
        self.time_s.push(time_s);
        let start = self.chunks.len() - values.len();
        for (chunk, value) in self.chunks[start..].iter_mut().zip(values) {
            chunk[place] = *value;
        }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.time_s.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }

    /// Their times, s.
    pub fn time_s(&self) -> &[f64] {
        &self.time_s
    }

    /// Channels of [`CHUNK`] instants at a time, and how many of these count.
    pub(crate) fn blocks(&self) -> impl Iterator<Item = (&[Chunk], usize)> {
        let count = self.len();
        let blocks = self.chunks.chunks_exact(self.channels.max(1));
        blocks.enumerate().map(move |(n, block)| (block, (count - n * CHUNK).min(CHUNK)))
    }

    /// Both sensors at one instant.
    pub fn at(&self, k: usize) -> [Side; 2] {
        let start = k / CHUNK * self.channels;
        let block = &self.chunks[start..start + self.channels];
        [0, self.channels / 2].map(|from| {
            let vector = |c: usize| {
                let c = from + c;
                Vector3::new(block[c][k % CHUNK], block[c + 1][k % CHUNK], block[c + 2][k % CHUNK])
            };
            let matrix = |c: usize| Matrix3::from_columns(&[vector(c), vector(c + 3), vector(c + 6)]);
            if self.channels == 2 * RAW {
                let (gyr, gyr_dot) = (vector(0), vector(3));
                Side { a: vector(6), b: Matrix3::identity(), c: lever_matrix(&gyr, &gyr_dot), gyr }
            } else {
                Side { a: vector(0), b: matrix(3), c: matrix(12), gyr: vector(21) }
            }
        })
    }

    /// Adds all raw instants of a run.
    pub(crate) fn push_run(&mut self, run: &Run) {
        debug_assert!(self.is_empty() || self.channels == MOMENT, "raw and smoothed instants do not mix");
        self.channels = MOMENT;
        let place = self.time_s.len() % CHUNK;
        self.time_s.extend_from_slice(&run.time_s[..run.count]);
        let first = run.count.min(CHUNK - place);
        let mut from = 0;
        for (to, count) in [(place, first), (0, run.count - first)] {
            if count == 0 {
                continue;
            }
            if to == 0 {
                self.chunks.resize(self.chunks.len() + MOMENT, [0.0; CHUNK]);
            }
            let start = self.chunks.len() - MOMENT;
            for (chunk, channel) in self.chunks[start..].iter_mut().zip(&run.channels) {
                chunk[to..to + count].copy_from_slice(&channel[from..from + count]);
            }
            from += count;
        }
    }

    /// Those at the given places.
    pub(super) fn picked(&self, places: impl Iterator<Item = usize>) -> Self {
        let mut picked = Self::default();
        let mut values = [0.0; 2 * SMOOTH];
        for k in places {
            let start = k / CHUNK * self.channels;
            let chunks = &self.chunks[start..start + self.channels];
            values.iter_mut().zip(chunks).for_each(|(value, chunk)| *value = chunk[k % CHUNK]);
            picked.push_values(self.time_s[k], &values[..self.channels]);
        }
        picked
    }

    /// About `count` of them, evenly spread.
    pub fn thinned(&self, count: usize) -> Self {
        self.picked((0..self.len()).step_by((self.len() / count.max(1)).max(1)))
    }

    /// Every `every`-th run of [`CHUNK`] of them, as it is.
    pub(super) fn runs(&self, every: usize) -> Self {
        let mut some = Self { channels: self.channels, ..Self::default() };
        let blocks = self.chunks.chunks_exact(self.channels.max(1)).zip(self.time_s.chunks(CHUNK));
        for (block, times) in blocks.step_by(every).filter(|(_, times)| times.len() == CHUNK) {
            some.chunks.extend_from_slice(block);
            some.time_s.extend_from_slice(times);
        }
        some
    }

    /// Whether this, read back, hangs together.
    pub(super) fn is_sound(&self) -> bool {
        [0, 2 * RAW, 2 * SMOOTH].contains(&self.channels)
            && (self.channels > 0 || self.is_empty())
            && self.chunks.len() == self.len().div_ceil(CHUNK) * self.channels
    }
}
