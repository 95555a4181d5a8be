//! Gyroscope bias from rest, when there is rest.

use serde::{Deserialize, Serialize};

use crate::{PairSample, Xyz};

/// A window counts as rest when, over its length, the rates of the sensor scatter less than this, rad/s...
const GYR_STD: f64 = 0.01;
/// ...their mean is no more than a bias can be, rad/s...
const GYR_MEAN: f64 = 0.05;
/// ...and the direction of gravity turns less than this from its first to its second half, rad: slow turning looks like a bias.
const TILT: f64 = 0.0044;
/// Length of a window, s.
const WINDOW_S: f64 = 0.8;
/// The bias is the mean over at most so many windows, old ones fading: it drifts over hours.
const WINDOWS: f64 = 30.0;

/// Watches one sensor of a pair for rest.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Rest {
    /// Samples in the window so far; sums of the rates, their squares, and of the accelerations in each half.
    count: u32,
    sum: Xyz,
    squares: Xyz,
    acc: [Xyz; 2],
    bias: Xyz,
    windows: f64,
}

impl Rest {
    /// Forgets the window that has begun.
    pub fn reset(&mut self) {
        *self = Self { bias: self.bias, windows: self.windows, ..Self::default() };
    }

    /// Takes one sample of the pair; `from` is 0 for sensor 1, 6 for sensor 2. `rate_hz` is that of the samples.
    pub fn push(&mut self, sample: &PairSample, from: usize, rate_hz: f64) {
        let length = (WINDOW_S * rate_hz).max(4.0) as u32;
        let half = usize::from(self.count * 2 >= length);
        for k in 0..3 {
            let rate = sample[from + k];
            self.sum[k] += rate;
            self.squares[k] += rate * rate;
            self.acc[half][k] += sample[from + 3 + k];
        }
        self.count += 1;
        if self.count >= length {
            self.close();
        }
    }

    fn close(&mut self) {
        let n = f64::from(self.count);
        let mean = self.sum.map(|s| s / n);
        let variance: f64 = (0..3).map(|k| (self.squares[k] / n - mean[k] * mean[k]).max(0.0)).sum();
        let size: f64 = mean.iter().map(|m| m * m).sum();
        let [first, second] = self.acc.map(nalgebra::Vector3::from);
        let still = variance < GYR_STD * GYR_STD && size < GYR_MEAN * GYR_MEAN;
        if still && crate::so3::angle_between(&first, &second) < TILT {
            self.windows = (self.windows + 1.0).min(WINDOWS);
            for (bias, mean) in self.bias.iter_mut().zip(mean) {
                *bias += (mean - *bias) / self.windows;
            }
        }
        self.reset();
    }

    /// The bias, rad/s; None while there was no rest.
    pub fn bias(&self) -> Option<Xyz> {
        (self.windows > 0.0).then_some(self.bias)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn watch(rate: impl Fn(usize) -> f64, tilt_per_sample: f64) -> Option<Xyz> {
        let mut rest = Rest::default();
        for k in 0..200 {
            let mut sample = [0.0; 12];
            sample[6] = rate(k);
            let tilt = tilt_per_sample * k as f64;
            (sample[9], sample[11]) = (9.81 * tilt.sin(), 9.81 * tilt.cos());
            rest.push(&sample, 6, 25.0);
        }
        rest.bias()
    }

    #[test]
    fn the_mean_of_a_still_sensor_is_its_bias_and_motion_is_none() {
        let noise = |k: usize| 0.002 * ((k * k) as f64).sin();
        let bias = watch(|k| 0.01 + noise(k), 0.0).map_or(f64::NAN, |b| b[0]);
        assert!((bias - 0.01).abs() < 5e-4, "{bias}");
        assert_eq!(watch(|k| 0.3 * (k as f64 * 0.3).sin(), 0.0), None);
        assert_eq!(watch(|_| 0.02, 0.02 / 25.0), None, "slow turning shows in gravity");
    }
}
