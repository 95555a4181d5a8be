//! From samples to keys: what the link and the gyroscopes say at, and between, a few moments a second.
//!
//! Each sensor's own gyroscope turns its samples into a frame that would stand still but for the gyroscope's errors, its
//! *drift frame*: `Q_i(t)` takes sensor i to it. There averages over a window mean what they say, and the unknown
//! `W = Q_1 R_12 Q_2ᵀ`, from drift frame 2 to drift frame 1, changes no faster than the gyroscopes err. At a key, averaged
//! with the weights h of [`super::kernel`],
//!
//! `Σ h Q_i (acc − b_a − K(ω, ω̇) r) = A_i − B_i b_a − C_i r`, with `A = Σ h Q acc`, `B = Σ h Q`, `C = Σ ḧ Q`,
//!
//! is the acceleration of the joint centre as sensor i sees it: what the two must agree on, up to W.

use alloc::vec::Vec;
use nalgebra::{ComplexField, Matrix3, UnitQuaternion, Vector3};

use super::{kernel::Kernel, kernel::LEAST_REACH};
use crate::{Xyz, held::Filled};

/// What one sensor says at a key.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// `A`, m/s².
    pub acc: Vector3<f64>,
    /// `B`.
    pub bias: Matrix3<f64>,
    /// `C`, 1/s².
    pub lever: Matrix3<f64>,
    /// `∫Q dt` from this key to the next: how a gyroscope bias turns the drift frame, s.
    pub turned: Matrix3<f64>,
}

/// One moment.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// Index of its sample.
    pub sample: usize,
    /// What the two sensors say.
    pub view: [View; 2],
    /// Weight of its link against that of a whole window of fresh samples; 0: no link.
    pub share: f64,
    /// From here to the next key, s; 0 where a break or the end follows: nothing is known of what happens there.
    pub span_s: f64,
    /// Variance of each component of the turn to the next key beyond that of the gyroscopes' noise: lost samples, rad².
    pub lost_variance: f64,
}

/// Both sensors' samples, time, and where keys are to be.
pub struct Samples<'a> {
    /// Strictly increasing, s.
    pub time_s: &'a [f64],
    /// Without lost rows.
    pub sensors: [Filled; 2],
    /// Nominal step, s.
    pub step_s: f64,
    /// The longest gap that is bridged, s.
    pub bridge_s: f64,
    /// Root mean square angular acceleration, rad/s².
    pub gyr_dot_rms: f64,
    /// Places of the keys and the reach of their windows; both ends of every stretch are keys.
    pub places: Vec<(usize, usize)>,
}

/// A step longer than this many nominal ones is a gap: no window crosses it.
const GAP_STEPS: f64 = crate::condition::BREAK_STEPS;

/// Steps that differ by a smaller share are even.
const EVEN: f64 = 0.02;

impl<'a> Samples<'a> {
    /// Places keys `key_steps` samples apart.
    pub fn new(time_s: &'a [f64], sensors: [Filled; 2], step_s: f64, bridge_s: f64, key_steps: usize, reach: usize) -> Self {
        let count = time_s.len();
        let mut places = Vec::with_capacity(count / key_steps + 2);
        let mut start = 0;
        for end in 1..=count {
            if end < count && time_s[end] - time_s[end - 1] <= GAP_STEPS * step_s {
                continue;
            }
            let reach = |k: usize| reach.min(k - start).min(end - 1 - k);
            places.extend((start..end - 1).step_by(key_steps).map(|k| (k, reach(k))));
            places.push((end - 1, 0));
            start = end;
        }
        let (mut squares, mut steps) = (0.0, 0_u32);
        for gyr in sensors.iter().map(|s| &s.gyr) {
            for (pair, t) in gyr.windows(2).zip(time_s.windows(2)) {
                let dt = t[1] - t[0];
                if dt <= GAP_STEPS * step_s {
                    squares += (vector(&pair[1]) - vector(&pair[0])).norm_squared() / (dt * dt);
                    steps += 1;
                }
            }
        }
        let gyr_dot_rms = ComplexField::sqrt(squares / f64::from(steps.max(1)));
        Self { time_s, sensors, step_s, bridge_s, gyr_dot_rms, places }
    }

    /// Whether all samples are numbers.
    pub fn is_finite(&self) -> bool {
        self.sensors.iter().all(|s| s.gyr.iter().chain(&s.acc).all(|row| row.iter().all(|v| v.is_finite())))
    }

    /// `Q_i` at every sample, from the rates less `bias`.
    pub fn turn(&self, sensor: usize, bias: &Vector3<f64>) -> Vec<UnitQuaternion<f64>> {
        let gyr = &self.sensors[sensor].gyr;
        let mut q = UnitQuaternion::identity();
        let mut turns = Vec::with_capacity(gyr.len());
        turns.push(q);
        for k in 1..gyr.len() {
            q *= UnitQuaternion::from_scaled_axis(self.step(gyr, k, bias));
            q.renormalize_fast();
            turns.push(q);
        }
        turns
    }

    /// The turn from sample k−1 to k as a rotation vector: the integral of the cubic through four even samples, else of the
    /// straight line between two, and `ω_k−1 × ω_k dt²/12` for an axis that moves meanwhile.
    fn step(&self, gyr: &[Xyz], k: usize, bias: &Vector3<f64>) -> Vector3<f64> {
        let dt = self.time_s[k] - self.time_s[k - 1];
        let [from, to] = [k - 1, k].map(|j| vector(&gyr[j]) - bias);
        let mut mean = 0.5 * (from + to);
        let even = |j: usize| ComplexField::abs(self.time_s[j] - self.time_s[j - 1] - dt) < EVEN * dt;
        if k >= 2 && k + 1 < gyr.len() && even(k - 1) && even(k + 1) {
            let outer = vector(&gyr[k - 2]) + vector(&gyr[k + 1]) - 2.0 * bias;
            mean = (13.0 * (from + to) - outer) / 24.0;
        }
        mean * dt + from.cross(&to) * (dt * dt / 12.0)
    }

    /// The keys, with the drift frames of `turns`.
    pub fn keys(&self, turns: &[Vec<UnitQuaternion<f64>>; 2], kernel: &Kernel) -> Vec<Key> {
        let mut matrices: Vec<[Matrix3<f64>; 2]> = Vec::new();
        let mut from = 0;
        let mut keys = Vec::with_capacity(self.places.len());
        let longest_s = self.bridge_s.max(self.longest_span());
        for (n, &(k, reach)) in self.places.iter().enumerate() {
            let next = self.places.get(n + 1).map_or(k, |p| p.0);
            // Rotation matrices of the samples around this key, made once.
            let (first, last) = (k - reach, next.max(k + reach));
            matrices.drain(..(first - from).min(matrices.len()));
            from = first;
            let missing = from + matrices.len()..=last;
            matrices.extend(missing.map(|j| [0, 1].map(|i: usize| turns[i][j].to_rotation_matrix().into_inner())));
            let mut view = [0, 1].map(|i| {
                let at = matrices[k - from][i];
                View { acc: at * vector(&self.sensors[i].acc[k]), bias: at, lever: Matrix3::zeros(), turned: Matrix3::zeros() }
            });
            let mut share = 0.0;
            if reach >= LEAST_REACH {
                let window = kernel.window(&self.time_s[k - reach..=k + reach]);
                let scale = reach as f64 / kernel.reach() as f64;
                let mut fresh = 0.0;
                for (i, view) in view.iter_mut().enumerate() {
                    *view = View { acc: Vector3::zeros(), bias: Matrix3::zeros(), ..*view };
                    for (j, (h, c)) in window.average.iter().zip(&window.curvature).enumerate() {
                        let (sample, q) = (k - reach + j, &matrices[k - reach + j - from][i]);
                        view.acc += q * (vector(&self.sensors[i].acc[sample]) * *h);
                        view.bias += q * *h;
                        view.lever += q * *c;
                        fresh += if self.sensors[i].held[sample] { 0.0 } else { 0.5 * h };
                    }
                }
                share = scale * scale * scale * fresh * fresh;
            }
            let (mut span_s, mut lost_variance) = (0.0, 0.0);
            if next > k && self.time_s[next] - self.time_s[k] <= longest_s {
                span_s = self.time_s[next] - self.time_s[k];
                lost_variance = self.lost(k, next);
                for (i, view) in view.iter_mut().enumerate() {
                    for j in k..next {
                        let ends = matrices[j - from][i] + matrices[j + 1 - from][i];
                        view.turned += ends * (0.5 * (self.time_s[j + 1] - self.time_s[j]));
                    }
                }
            }
            keys.push(Key { sample: k, view, share, span_s, lost_variance });
        }
        keys
    }

    /// No span within a stretch is longer.
    fn longest_span(&self) -> f64 {
        let widest = self.places.windows(2).map(|p| p[1].0 - p[0].0).max().unwrap_or(0);
        GAP_STEPS * self.step_s * widest as f64
    }

    /// Variance by which the turn from sample k to `next` is uncertain because samples between them were lost: over a time T
    /// without samples a straight line misses the true rate by `ω̇T/8` or so at its worst.
    fn lost(&self, k: usize, next: usize) -> f64 {
        let without = |from: f64, to: f64| {
            let miss = self.gyr_dot_rms * (to - from) * (to - from) / 8.0;
            miss * miss / 3.0
        };
        let mut variance = 0.0;
        for sensor in &self.sensors {
            let mut seen = self.time_s[k];
            for j in k + 1..=next {
                let lost = sensor.held[j];
                if !lost || j == next {
                    let gap = self.time_s[j] - seen;
                    if gap > 1.5 * self.step_s {
                        variance += without(seen, self.time_s[j]);
                    }
                    seen = self.time_s[j];
                }
            }
        }
        variance
    }
}

/// A row as a vector.
pub fn vector(row: &Xyz) -> Vector3<f64> {
    Vector3::from(*row)
}
