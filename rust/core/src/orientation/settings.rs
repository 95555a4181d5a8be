//! What every filter needs to know.

use serde::{Deserialize, Serialize};

use super::{
    method::{SCALE_NOISE, Tuning},
    ring::stencil_step,
    state::{Joint, Noise},
};
use crate::Xyz;

/// How a filter is set up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Nominal rate of the samples, Hz.
    pub rate_hz: f64,
    /// The joint as calibrated.
    pub joint: Joint,
    /// White noise of a sample.
    pub noise: Noise,
    /// See [`Tuning::scale_noise`].
    pub scale_noise: f64,
    /// Whether the turn between two samples is the mean of their rates; else the later rate holds since the last sample, as
    /// published.
    pub midpoint: bool,
    /// Orientation at the first sample and its standard deviation, rad (root of the trace); None: the closed form finds it.
    pub given: Option<([f64; 4], f64)>,
    /// The closed form ends when it knows the orientation to this, rad.
    pub start_std: f64,
    /// Its oldest instants fade with this time constant, s.
    pub start_fade_s: f64,
    /// After a longer gap the filter starts anew, s.
    pub max_gap_s: f64,
    /// Whether it starts anew after such a gap and when it finds that it follows a wrong heading.
    pub restart: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            rate_hz: 100.0,
            joint: Joint::default(),
            noise: Noise::default(),
            scale_noise: SCALE_NOISE,
            midpoint: true,
            given: None,
            start_std: 0.035,
            start_fade_s: 10.0,
            max_gap_s: 0.5,
            restart: true,
        }
    }
}

impl Settings {
    /// Whether these can be worked with.
    pub fn are_sound(&self) -> bool {
        let small = |v: &Xyz| v.iter().all(|x| x.abs() < 1e6);
        let Joint { r1, r2, gyr_bias, acc_bias, relative_bias_std } = &self.joint;
        let positive = [self.rate_hz, self.start_std, self.start_fade_s];
        let least_zero = [self.noise.gyr_std, self.noise.acc_std, self.scale_noise, self.max_gap_s, *relative_bias_std];
        positive.iter().all(|x| *x > 0.0 && *x < 1e9)
            && least_zero.iter().all(|x| *x >= 0.0 && *x < 1e9)
            && [r1, r2].into_iter().chain(gyr_bias).chain(acc_bias).all(small)
            && self.given.is_none_or(|(q, std)| {
                let size: f64 = q.iter().map(|x| x * x).sum();
                (0.99..1.01).contains(&size) && std > 0.0 && std < 10.0
            })
    }

    pub(super) fn tuning(&self) -> Tuning<f64> {
        let stencil_s = stencil_step(self.rate_hz) as f64 / self.rate_hz;
        Tuning::new(&self.noise, &self.joint, stencil_s, self.scale_noise)
    }
}
