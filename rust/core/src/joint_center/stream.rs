//! The joint centre from an endless stream, in bounded memory: conditioned signals, their angular accelerations, and of these
//! moments the most exciting.

use alloc::vec::Vec;
use nalgebra::ComplexField;
use serde::{Deserialize, Serialize};

use super::moments::Moments;
use crate::{
    PairSample, Xyz,
    condition::{BREAK_STEPS, Conditioner},
    rest::Rest,
    rigid_body::{Differentiator, Stencil},
};

/// What a stream needs to know from the start.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StreamSettings {
    /// Nominal rate of the samples, Hz.
    pub rate_hz: f64,
    /// Cut-off of the low-pass, Hz; 0: none.
    pub lowpass_hz: f64,
    /// How rates are differentiated.
    pub stencil: Stencil,
    /// Moments in which neither sensor turns faster than this are passed over, rad/s.
    pub least_rate: f64,
    /// Most moments that an estimate rests on.
    pub max_samples: usize,
    /// Whether rest, when there is any, corrects the gyroscopes.
    pub bias_from_rest: bool,
}

/// Low-passed samples a period of the cut-off: enough to differentiate...
const DIFFERENTIATED: f64 = 10.0;
/// ...and of these, neighbours telling nearly the same, so many are kept.
const KEPT: f64 = 5.0;

impl StreamSettings {
    fn every(&self) -> usize {
        if self.lowpass_hz > 0.0 { ((self.rate_hz / (DIFFERENTIATED * self.lowpass_hz)) as usize).max(1) } else { 1 }
    }

    fn conditioned_hz(&self) -> f64 {
        self.rate_hz / self.every() as f64
    }

    fn stride(&self) -> u64 {
        if self.lowpass_hz > 0.0 { (self.conditioned_hz() / (KEPT * self.lowpass_hz)).max(1.0) as u64 } else { 1 }
    }

    /// Neighbouring moments of which so many tell as much as one alone: the low-pass leaves two a period of its cut-off.
    pub fn correlated(&self) -> f64 {
        let kept_hz = self.conditioned_hz() / self.stride() as f64;
        if self.lowpass_hz > 0.0 { (kept_hz / (2.0 * self.lowpass_hz)).max(1.0) } else { 1.0 }
    }

    /// Whether the low-pass needs no more memory than a wearable has.
    pub fn windows_are_bounded(&self) -> bool {
        self.lowpass_hz <= 0.0 || self.rate_hz / self.lowpass_hz <= 1e6
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
    differentiator: Differentiator,
    ready: Vec<(f64, PairSample)>,
    /// Moments so far, and the time of the latest conditioned sample.
    count: u64,
    latest_s: f64,
    kept: Moments,
    /// Level of each.
    levels: Vec<u8>,
    /// Of each level one in so many moments is kept (0: none), and how many came so far.
    strides: [u64; LEVELS.len() + 1],
    offered: [u64; LEVELS.len() + 1],
    rest: [Rest; 2],
}

impl CenterStream {
    /// An empty stream.
    pub fn new(settings: StreamSettings) -> Self {
        Self {
            settings,
            conditioner: Conditioner::new(settings.lowpass_hz, settings.rate_hz, settings.every()),
            differentiator: Differentiator::new(settings.stencil, 1.0 / settings.conditioned_hz()),
            ready: Vec::new(),
            count: 0,
            latest_s: f64::NEG_INFINITY,
            kept: Moments::default(),
            levels: Vec::new(),
            strides: [1; LEVELS.len() + 1],
            offered: [0; LEVELS.len() + 1],
            rest: Default::default(),
        }
    }

    /// What it was made with.
    pub fn settings(&self) -> &StreamSettings {
        &self.settings
    }

    /// By how much the moments are late, s.
    pub fn delay_s(&self) -> f64 {
        self.conditioner.delay_s() + self.settings.stencil.reach() as f64 / self.settings.conditioned_hz()
    }

    /// Takes one raw sample at `time_s`, later than all before.
    pub fn push(&mut self, time_s: f64, sample: &PairSample) {
        let mut ready = core::mem::take(&mut self.ready);
        self.conditioner.push(time_s, sample, &mut ready);
        for (time, sample) in ready.drain(..) {
            self.take(time, &sample);
        }
        self.ready = ready;
    }

    fn take(&mut self, time: f64, sample: &PairSample) {
        let rate = self.settings.conditioned_hz();
        if time - self.latest_s > BREAK_STEPS / rate {
            self.differentiator.reset();
            self.rest.iter_mut().for_each(Rest::reset);
        }
        self.latest_s = time;
        if self.settings.bias_from_rest {
            for (sensor, rest) in self.rest.iter_mut().enumerate() {
                rest.push(sample, 6 * sensor, rate);
            }
            self.kept.set_gyr_bias(self.rest.each_ref().map(|rest| rest.bias().unwrap_or_default()));
        }
        let Some(moment) = self.differentiator.push(time, sample) else { return };
        self.count += 1;
        if !(self.count - 1).is_multiple_of(self.settings.stride()) {
            return;
        }
        let square = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
        let rates = [square(&moment.sample[0..3]), square(&moment.sample[6..9])];
        let least = self.settings.least_rate;
        if rates[0].max(rates[1]) < least * least {
            return;
        }
        let dots = [square(&moment.gyr_dot1), square(&moment.gyr_dot2)];
        let excitement = rates[0] + rates[1] + ComplexField::sqrt(dots[0]) + ComplexField::sqrt(dots[1]);
        let level = LEVELS.iter().filter(|&&limit| excitement >= 2.0 * limit).count();
        let (stride, offered) = (self.strides[level], self.offered[level]);
        self.offered[level] += 1;
        if stride > 0 && offered.is_multiple_of(stride) {
            if self.kept.len() == self.settings.max_samples {
                self.make_room();
            }
            if self.strides[level] > 0 && offered.is_multiple_of(self.strides[level]) {
                self.kept.push(&moment);
                self.levels.push(level as u8);
            }
        }
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

    /// Moments so far, used or not.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Time of the latest conditioned sample, s.
    pub fn latest_s(&self) -> f64 {
        self.latest_s
    }

    /// The most exciting moments in the order of time, at most as many as the settings say.
    pub fn moments(&self) -> &Moments {
        &self.kept
    }

    /// The gyroscope bias of each sensor, rad/s, where rest has shown it.
    pub fn gyr_bias(&self) -> [Option<Xyz>; 2] {
        self.rest.each_ref().map(Rest::bias)
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
