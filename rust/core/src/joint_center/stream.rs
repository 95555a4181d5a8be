//! The joint centre from an endless stream, in bounded memory: conditioned signals, their angular accelerations, and of these
//! moments the most exciting.

use alloc::vec::Vec;
use nalgebra::ComplexField;
use serde::{Deserialize, Serialize};

use super::{
    moments::{Moments, Side},
    observability::PIECE_S,
    smooth::InertialLowpass,
};
use crate::{
    PairSample, Xyz,
    condition::{BREAK_STEPS, Conditioner},
    rest::Rest,
    rigid_body::{Differentiator, Moment, Stencil},
};

/// What a stream needs to know from the start.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StreamSettings {
    /// Nominal rate of the samples, Hz.
    pub rate_hz: f64,
    /// Cut-off of the low-pass, Hz; 0: none.
    pub lowpass_hz: f64,
    /// How rates are differentiated where there is no low-pass.
    pub stencil: Stencil,
    /// Instants at which neither sensor turns faster than this are passed over, rad/s.
    pub least_rate: f64,
    /// Most instants that an estimate rests on.
    pub max_samples: usize,
    /// Gyroscope biases that are known, rad/s.
    pub gyr_bias: Option<[Xyz; 2]>,
    /// Whether rest, when there is any, shows those that are not.
    pub bias_from_rest: bool,
}

/// Of the smoothed samples so many are kept in a period of the cut-off.
const KEPT: f64 = 4.0;
/// Rest is looked for in means over this long, s.
const REST_MEAN_S: f64 = 0.1;

impl StreamSettings {
    fn every(&self) -> usize {
        if self.lowpass_hz > 0.0 { ((self.rate_hz / (KEPT * self.lowpass_hz)) as usize).max(1) } else { 1 }
    }

    /// Neighbours of which so many tell as much as one alone: smoothed, those of a second; raw, as published, none.
    pub fn correlated(&self) -> f64 {
        if self.lowpass_hz > 0.0 { (PIECE_S * self.rate_hz / self.every() as f64).max(1.0) } else { 1.0 }
    }

    /// Whether the low-pass needs no more memory than a wearable has.
    pub fn windows_are_bounded(&self) -> bool {
        self.lowpass_hz <= 0.0 || self.rate_hz / self.lowpass_hz <= 1e5
    }
}

/// Moments are told apart by how strongly a lever arm of a metre would show in them, m/s² a sensor: below the first of these,
/// between them, above the last.
const LEVELS: [f64; 3] = [1.0, 4.0, 16.0];

/// The stream.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct CenterStream {
    settings: StreamSettings,
    conditioner: Conditioner,
    ready: Vec<(f64, PairSample)>,
    smooth: InertialLowpass,
    differentiator: Differentiator,
    /// Time of the latest conditioned sample, s.
    latest_s: f64,
    kept: Moments,
    /// Level of each.
    levels: Vec<u8>,
    /// Of each level one in so many is kept (0: none), and how many came so far.
    strides: [u64; LEVELS.len() + 1],
    offered: [u64; LEVELS.len() + 1],
    rest: [Rest; 2],
    /// Sum of the latest samples, and how many.
    mean: (PairSample, u32),
    bias: [Option<Xyz>; 2],
}

impl CenterStream {
    /// An empty stream.
    pub fn new(settings: StreamSettings) -> Self {
        let step_s = 1.0 / settings.rate_hz;
        Self {
            settings,
            conditioner: Conditioner::new(0.0, settings.rate_hz, 1),
            ready: Vec::new(),
            smooth: InertialLowpass::new(settings.lowpass_hz, step_s, settings.every()),
            differentiator: Differentiator::new(settings.stencil, step_s),
            latest_s: f64::NEG_INFINITY,
            kept: Moments::default(),
            levels: Vec::new(),
            strides: [1; LEVELS.len() + 1],
            offered: [0; LEVELS.len() + 1],
            rest: Default::default(),
            mean: ([0.0; 12], 0),
            bias: settings.gyr_bias.map_or([None; 2], |bias| bias.map(Some)),
        }
    }

    /// What it was made with.
    pub fn settings(&self) -> &StreamSettings {
        &self.settings
    }

    fn is_smooth(&self) -> bool {
        self.settings.lowpass_hz > 0.0
    }

    /// By how much the instants are late, s.
    pub fn delay_s(&self) -> f64 {
        let samples = if self.is_smooth() { self.smooth.delay_samples() } else { self.settings.stencil.reach() };
        samples as f64 / self.settings.rate_hz
    }

    /// Takes one raw sample at `time_s`, later than all before.
    pub fn push(&mut self, time_s: f64, sample: &PairSample) {
        let mut ready = core::mem::take(&mut self.ready);
        self.conditioner.push(time_s, sample, &mut ready);
        for (time, sample) in ready.drain(..) {
            self.take(time, sample);
        }
        self.ready = ready;
    }

    fn take(&mut self, time: f64, mut sample: PairSample) {
        if time - self.latest_s > BREAK_STEPS / self.settings.rate_hz {
            self.smooth.reset();
            self.differentiator.reset();
            self.rest.iter_mut().for_each(Rest::reset);
            self.mean = ([0.0; 12], 0);
        }
        self.latest_s = time;
        if self.settings.bias_from_rest && self.settings.gyr_bias.is_none() {
            self.look_for_rest(&sample);
        }
        for (sensor, bias) in self.bias.iter().enumerate() {
            let Some(bias) = bias else { continue };
            (0..3).for_each(|k| sample[6 * sensor + k] -= bias[k]);
        }
        if self.is_smooth() {
            if let Some(sides) = self.smooth.push(&sample) {
                self.offer_smooth(time - self.delay_s(), &sides);
            }
        } else if let Some(moment) = self.differentiator.push(time, &sample) {
            self.offer(&moment);
        }
    }

    fn look_for_rest(&mut self, sample: &PairSample) {
        let (sum, count) = &mut self.mean;
        (0..12).for_each(|k| sum[k] += sample[k]);
        *count += 1;
        if f64::from(*count) >= REST_MEAN_S * self.settings.rate_hz {
            let mean = sum.map(|s| s / f64::from(*count));
            let rate = self.settings.rate_hz / f64::from(*count);
            self.mean = ([0.0; 12], 0);
            for (sensor, rest) in self.rest.iter_mut().enumerate() {
                rest.push(&mean, 6 * sensor, rate);
            }
            self.bias = self.rest.each_ref().map(Rest::bias);
        }
    }

    fn offer(&mut self, moment: &Moment) {
        let square = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
        let rates = [square(&moment.sample[0..3]), square(&moment.sample[6..9])];
        let dots = [square(&moment.gyr_dot1), square(&moment.gyr_dot2)];
        let excitement = rates[0] + rates[1] + ComplexField::sqrt(dots[0]) + ComplexField::sqrt(dots[1]);
        if self.makes_room(rates[0].max(rates[1]), excitement) {
            self.kept.push(moment);
        }
    }

    fn offer_smooth(&mut self, time_s: f64, sides: &[Side; 2]) {
        let rate = sides[0].gyr.norm_squared().max(sides[1].gyr.norm_squared());
        if self.makes_room(rate, sides[0].c.norm() + sides[1].c.norm()) {
            self.kept.push_smooth(time_s, sides);
        }
    }

    /// Whether an instant at which the faster sensor's rate squared is `rate` (rad²/s²) and a metre of lever arm would show
    /// with `excitement` (m/s²) is kept; its level is then noted and there is room for it.
    fn makes_room(&mut self, rate: f64, excitement: f64) -> bool {
        let least = self.settings.least_rate;
        if rate < least * least {
            return false;
        }
        let level = LEVELS.iter().filter(|&&limit| excitement >= 2.0 * limit).count();
        let offered = self.offered[level];
        self.offered[level] += 1;
        let wanted = |strides: &[u64]| strides[level] > 0 && offered.is_multiple_of(strides[level]);
        if !wanted(&self.strides) {
            return false;
        }
        if self.kept.len() == self.settings.max_samples {
            self.make_room();
        }
        let kept = wanted(&self.strides);
        if kept {
            self.levels.push(level as u8);
        }
        kept
    }

    /// Gives up the least exciting moments: of the lowest level every second, or all once they are few.
    fn make_room(&mut self) {
        let wanted = self.settings.max_samples * 3 / 4;
        while self.levels.len() > wanted {
            let Some(&lowest) = self.levels.iter().min() else { return };
            let count = self.levels.iter().filter(|&&level| level == lowest).count();
            let others = count < self.levels.len();
            let stride = &mut self.strides[usize::from(lowest)];
            *stride = if others && count < self.settings.max_samples / 4 { 0 } else { *stride * 2 };
            let (closed, mut position) = (*stride == 0, 0);
            let stays: Vec<bool> = self
                .levels
                .iter()
                .map(|&level| {
                    position += usize::from(level == lowest);
                    level != lowest || (!closed && position % 2 == 1)
                })
                .collect();
            self.kept = self.kept.picked((0..stays.len()).filter(|&k| stays[k]));
            let mut stays = stays.into_iter();
            self.levels.retain(|_| stays.next().unwrap_or(false));
        }
    }

    /// Time of the latest conditioned sample, s.
    pub fn latest_s(&self) -> f64 {
        self.latest_s
    }

    /// The most exciting moments in the order of time, at most as many as the settings say.
    pub fn moments(&self) -> &Moments {
        &self.kept
    }

    /// The gyroscope bias of each sensor, rad/s, where it is known or rest has shown it.
    pub fn gyr_bias(&self) -> [Option<Xyz>; 2] {
        self.bias
    }

    /// Everything it knows, as bytes: a version, a checksum, the state.
    pub fn to_bytes(&self) -> Vec<u8> {
        crate::state::to_bytes(STATE_VERSION, self)
    }

    /// The stream that [`Self::to_bytes`] wrote; None where the bytes are of another version, damaged or not from there.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let stream: Self = crate::state::from_bytes(STATE_VERSION, bytes)?;
        let settings = stream.settings;
        let sound = settings.rate_hz > 0.0
            && settings.rate_hz < 1e9
            && settings.lowpass_hz >= 0.0
            && settings.max_samples >= LEAST_SAMPLES
            && settings.windows_are_bounded();
        let fresh = sound.then(|| Self::new(settings))?;
        let fits = stream.conditioner.fits(&fresh.conditioner)
            && stream.differentiator.fits(&fresh.differentiator)
            && stream.smooth.fits(&fresh.smooth)
            && stream.kept.is_sound()
            && stream.kept.len() <= settings.max_samples
            && stream.levels.len() == stream.kept.len()
            && stream.levels.iter().all(|&level| usize::from(level) <= LEVELS.len());
        fits.then_some(stream)
    }
}

/// Fewer moments cannot be thinned.
pub const LEAST_SAMPLES: usize = 20;
/// First bytes of a saved stream; the last is the version of the layout.
const STATE_VERSION: [u8; 8] = *b"imuctr\0\x01";
