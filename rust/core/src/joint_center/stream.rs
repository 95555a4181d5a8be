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
    rigid_body::{Differentiator, RUN, Stencil},
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
    conditioner: Conditioner,
    intake: Intake,
}

/// What comes after even time.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Intake {
    settings: StreamSettings,
    smooth: InertialLowpass,
    differentiator: Differentiator,
    /// Time of the latest conditioned sample, s.
    latest_s: f64,
    kept: Moments,
    /// Level of each.
    levels: Vec<u8>,
    /// Of each level one in so many is kept, and how many came so far.
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
        let conditioner = Conditioner::new(0.0, settings.rate_hz, 1);
        Self { conditioner, intake: Intake::new(settings) }
    }

    /// What it was made with.
    pub fn settings(&self) -> &StreamSettings {
        &self.intake.settings
    }

    /// By how much the instants are late, s.
    pub fn delay_s(&self) -> f64 {
        self.intake.delay_s()
    }

    /// Takes raw samples with their times, each later than all before.
    pub fn push(&mut self, samples: impl IntoIterator<Item = (f64, PairSample)>) {
        let Self { conditioner, intake } = self;
        for (time_s, sample) in samples {
            conditioner.pass(time_s, &sample, &mut |time, sample| intake.take(time, sample));
        }
        intake.offer_run();
    }

    /// The most exciting instants in the order of time, at most as many as the settings say.
    pub fn moments(&self) -> &Moments {
        &self.intake.kept
    }

    /// The gyroscope bias of each sensor, rad/s, where it is known or rest has shown it.
    pub fn gyr_bias(&self) -> [Option<Xyz>; 2] {
        self.intake.bias
    }

    /// Everything it knows, as bytes: a version, a checksum, the state.
    pub fn to_bytes(&self) -> Vec<u8> {
        crate::state::to_bytes(STATE_VERSION, self)
    }

    /// The stream that [`Self::to_bytes`] wrote; None where the bytes are of another version, damaged or not from there.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let stream: Self = crate::state::from_bytes(STATE_VERSION, bytes)?;
        let settings = *stream.settings();
        let sound = settings.rate_hz > 0.0
            && settings.rate_hz < 1e9
            && settings.lowpass_hz >= 0.0
            && settings.max_samples >= LEAST_SAMPLES
            && settings.windows_are_bounded();
        let fresh = sound.then(|| Self::new(settings))?;
        (stream.conditioner.fits(&fresh.conditioner) && stream.intake.fits(&fresh.intake)).then_some(stream)
    }
}

impl Intake {
    fn new(settings: StreamSettings) -> Self {
        let step_s = 1.0 / settings.rate_hz;
        Self {
            settings,
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

    fn is_smooth(&self) -> bool {
        self.settings.lowpass_hz > 0.0
    }

    fn delay_s(&self) -> f64 {
        let samples = if self.is_smooth() { self.smooth.delay_samples() } else { self.settings.stencil.reach() };
        samples as f64 / self.settings.rate_hz
    }

    #[inline]
    fn take(&mut self, time: f64, sample: &PairSample) {
        if time - self.latest_s > BREAK_STEPS / self.settings.rate_hz {
            self.offer_run();
            self.smooth.reset();
            self.differentiator.reset();
            self.rest.iter_mut().for_each(Rest::reset);
            self.mean = ([0.0; 12], 0);
        }
        self.latest_s = time;
        if self.settings.bias_from_rest && self.settings.gyr_bias.is_none() {
            self.look_for_rest(sample);
        }
        match self.bias {
            [None, None] => self.convert(time, sample),
            bias => {
                let mut unbiased = *sample;
                for (sensor, bias) in bias.iter().enumerate() {
                    let bias = bias.unwrap_or_default();
                    (0..3).for_each(|k| unbiased[6 * sensor + k] -= bias[k]);
                }
                self.convert(time, &unbiased);
            }
        }
    }

    /// From samples to instants.
    #[inline]
    fn convert(&mut self, time: f64, sample: &PairSample) {
        if self.is_smooth() {
            if let Some(sides) = self.smooth.push(sample) {
                self.offer_smooth(time - self.delay_s(), &sides);
            }
        } else if self.differentiator.push(time, sample) {
            self.offer_run();
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

    /// Offers the raw instants that are ready.
    fn offer_run(&mut self) {
        let Some(run) = self.differentiator.drain() else { return };
        let [x1, y1, z1, u1, v1, w1, _, _, _, x2, y2, z2, u2, v2, w2, _, _, _] = &run.channels;
        let (mut rate, mut excitement) = ([0.0; RUN], [0.0; RUN]);
        for k in 0..RUN {
            let square = |x: &[f64; RUN], y: &[f64; RUN], z: &[f64; RUN]| x[k] * x[k] + y[k] * y[k] + z[k] * z[k];
            let rates = [square(x1, y1, z1), square(x2, y2, z2)];
            let dots = square(u1, v1, w1) + square(u2, v2, w2);
            rate[k] = if rates[0] > rates[1] { rates[0] } else { rates[1] };
            excitement[k] = rates[0] + rates[1] + ComplexField::sqrt(dots);
        }
        if self.keeps_all(run.count) {
            for excitement in &excitement[..run.count] {
                let level = level_of(*excitement);
                self.offered[level] = self.offered[level].wrapping_add(1);
                self.levels.push(level as u8);
            }
            self.kept.push_run(&run);
            return;
        }
        for k in 0..run.count {
            if self.makes_room(rate[k], excitement[k]) {
                self.kept.push_values(run.time_s[k], &run.channels.map(|channel| channel[k]));
            }
        }
    }

    /// Whether the next `count` are kept whatever they are, as almost always.
    fn keeps_all(&self, count: usize) -> bool {
        let room = self.settings.max_samples - self.kept.len();
        self.settings.least_rate <= 0.0 && room >= count && self.strides.iter().all(|&stride| stride == 1)
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
        let level = level_of(excitement);
        let offered = self.offered[level];
        self.offered[level] = offered.wrapping_add(1);
        let wanted = |strides: &[u64]| offered.is_multiple_of(strides[level]);
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

    /// Whether this, read back, can go on where `fresh` would begin.
    fn fits(&self, fresh: &Self) -> bool {
        self.differentiator.fits(&fresh.differentiator)
            && self.smooth.fits(&fresh.smooth)
            && self.kept.is_sound()
            && self.kept.len() <= self.settings.max_samples
            && self.levels.len() == self.kept.len()
            && self.levels.iter().all(|&level| usize::from(level) <= LEVELS.len())
    }

    /// Gives up the least exciting: every second of the lowest level that has a fair share, so that no level ever falls silent.
    fn make_room(&mut self) {
        let most = self.settings.max_samples;
        while self.levels.len() > most * 3 / 4 {
            let share = |level: u8| self.levels.iter().filter(|&&l| l == level).count();
            let Some(lowest) = (0..=LEVELS.len() as u8).find(|&level| share(level) > (most / 16).max(1)) else { return };
            let stride = &mut self.strides[usize::from(lowest)];
            *stride = stride.saturating_mul(2);
            let mut position = 0;
            let stays: Vec<bool> = self
                .levels
                .iter()
                .map(|&level| {
                    position += usize::from(level == lowest);
                    level != lowest || position % 2 == 1
                })
                .collect();
            self.kept = self.kept.picked((0..stays.len()).filter(|&k| stays[k]));
            let mut stays = stays.into_iter();
            self.levels.retain(|_| stays.next().unwrap_or(false));
        }
    }
}

fn level_of(excitement: f64) -> usize {
    LEVELS.iter().filter(|&&limit| excitement >= 2.0 * limit).count()
}

/// Fewer moments cannot be thinned.
pub const LEAST_SAMPLES: usize = 20;
/// First bytes of a saved stream; the last is the version of the layout.
const STATE_VERSION: [u8; 8] = *b"imuctr\0\x02";
