//! The hinge axis from an endless stream, in bounded memory: conditioned signals, the samples that tell most (Algorithms 2 and
//! 3), and small memories for the questions that selection cannot answer: is it a hinge, which pairing, has a strap slipped.

use alloc::{collections::VecDeque, vec::Vec};
use nalgebra::ComplexField;
use serde::{Deserialize, Serialize};

use super::{
    axes::AxisPair,
    cost::{HingeCost, Weights},
    record::{Record, Witness, witness},
    scores::{ScoreWindow, window_samples},
    select::{AccSelection, Candidate, GyrSelection},
    sign::{PAIRING_DECIDED, Stretch, pairing_evidence},
    solve::{Minimum, Solution, SolveOptions, deterministic_starts, refine, same_axes, solve},
};
use crate::{
    PairSample, Xyz,
    condition::{BREAK_STEPS, Conditioner},
    reservoir::Reservoir,
    rest::Rest,
};

/// What a stream needs to know from the start.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StreamSettings {
    /// Nominal rate of the samples, Hz.
    pub rate_hz: f64,
    /// Cut-off of the low-pass, Hz; 0: none.
    pub lowpass_hz: f64,
    /// Window of the scores, s.
    pub window_s: f64,
    /// `N_max` for each kind of sample.
    pub max_samples: usize,
    /// `E_th`, rad²/s².
    pub energy_threshold: f64,
    /// See [`AccSelection::new`].
    pub always_quiet: bool,
    /// Whether the motion in the plane of the hinge may settle the sign pairing.
    pub settle_pairing: bool,
    /// Whether rest, when there is any, corrects the gyroscopes.
    pub bias_from_rest: bool,
    /// Gauss–Newton iterations of one descent.
    pub max_iterations: usize,
    /// Weights of the residuals.
    pub weights: Weights,
}

impl StreamSettings {
    /// Of the low-passed samples only so many are worth keeping: six a period of the cut-off.
    fn every(&self) -> usize {
        if self.lowpass_hz > 0.0 { ((self.rate_hz / (6.0 * self.lowpass_hz)) as usize).max(1) } else { 1 }
    }

    /// Whether the low-pass and the scores need no more memory than a wearable has.
    pub fn windows_are_bounded(&self) -> bool {
        const MOST_SAMPLES: f64 = 1e6;
        let kernel = if self.lowpass_hz > 0.0 { self.rate_hz / self.lowpass_hz } else { 0.0 };
        kernel <= MOST_SAMPLES && self.window_s >= 0.0 && self.window_s * self.conditioned_hz() <= MOST_SAMPLES
    }

    /// Rate of the conditioned samples, Hz.
    fn conditioned_hz(&self) -> f64 {
        self.rate_hz / self.every() as f64
    }

    /// Low-passed neighbours tell nearly the same: one in so many conditioned samples, three a period of the cut-off, is
    /// offered to the selections; without a low-pass all.
    fn selection_stride(&self) -> u64 {
        if self.lowpass_hz > 0.0 { stride(self.conditioned_hz(), 3.125 * self.lowpass_hz) } else { 1 }
    }

    /// One in so many conditioned samples is offered to the memory of motion.
    fn memory_stride(&self) -> u64 {
        stride(self.conditioned_hz(), MOVING_HZ)
    }

    /// Rate at which samples are offered to the memory of motion, Hz.
    pub fn memory_hz(&self) -> f64 {
        self.conditioned_hz() / self.memory_stride() as f64
    }
}

fn stride(rate_hz: f64, wanted_hz: f64) -> u64 {
    ComplexField::round(rate_hz / wanted_hz).max(1.0) as u64
}

/// Motion is remembered at about this rate, Hz.
const MOVING_HZ: f64 = 12.5;
/// An instant moves when the faster sensor turns faster than this, rad/s...
const MOVING_RATE: f64 = 0.3;
/// ...and the two sensors' rates differ by more than this, rad/s.
const MOVING_DIFFERENCE: f64 = 0.1;
/// Moving instants that stand for all of the past.
const PAST_MOVING: usize = 2048;
/// Moving instants that stand for the recent past: about a minute of motion.
const RECENT_MOVING: usize = 750;
/// The recent past is judged once this much of it is there.
const RECENT_ENOUGH: usize = 125;
/// Moving instants that stand for right now, about ten seconds of motion: has a strap slipped?
pub const PRESENT_MOVING: usize = 125;
/// Length of the stretches that tell the sign pairing, s, and how many of the liveliest are kept.
const STRETCH_S: f64 = 4.0;
const STRETCHES: usize = 6;

/// The stream.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct HingeStream {
    settings: StreamSettings,
    conditioner: Conditioner,
    ready: Vec<(f64, PairSample)>,
    /// Conditioned samples so far, and the time of the latest.
    count: u64,
    latest_s: f64,
    window: ScoreWindow,
    gyr: GyrSelection,
    acc: AccSelection,
    /// Samples that joined the selection since the last estimate, and since the last search of the whole landscape.
    changes: u64,
    unsearched: u64,
    moving: Reservoir<[Xyz; 2]>,
    recent: VecDeque<[Xyz; 2]>,
    rest: [Rest; 2],
    stretch: Stretch,
    liveliest: Vec<Stretch>,
    minima: Vec<Minimum>,
}

impl HingeStream {
    /// An empty stream.
    pub fn new(settings: StreamSettings) -> Self {
        let rate = settings.conditioned_hz();
        Self {
            settings,
            conditioner: Conditioner::new(settings.lowpass_hz, settings.rate_hz, settings.every()),
            ready: Vec::new(),
            count: 0,
            latest_s: f64::NEG_INFINITY,
            window: ScoreWindow::new(window_samples(settings.window_s, rate)),
            gyr: GyrSelection::new(settings.max_samples),
            acc: AccSelection::new(settings.max_samples, settings.energy_threshold, settings.always_quiet),
            changes: 0,
            unsearched: 0,
            moving: Reservoir::new(PAST_MOVING),
            recent: VecDeque::new(),
            rest: Default::default(),
            stretch: Stretch { step_s: 1.0 / rate, samples: Vec::new() },
            liveliest: Vec::new(),
            minima: Vec::new(),
        }
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
        if time - self.latest_s > BREAK_STEPS / self.settings.conditioned_hz() {
            self.window.reset();
            self.stretch.samples.clear();
            self.rest.iter_mut().for_each(Rest::reset);
        }
        self.latest_s = time;
        for (sensor, rest) in self.rest.iter_mut().enumerate() {
            rest.push(sample, 6 * sensor, self.settings.conditioned_hz());
        }
        let selectable = self.count.is_multiple_of(self.settings.selection_stride());
        let memorable = self.count.is_multiple_of(self.settings.memory_stride());
        self.count += 1;
        let scored = self.window.push(time, sample);
        if let Some(scored) = scored.filter(|_| selectable) {
            let gyr = self.gyr.push(Candidate::gyr(self.count, scored.time, &scored.sample, scored.gyr_score));
            let acc = self.acc.push(Candidate::acc(self.count, scored.time, &scored.sample, scored.acc_score));
            self.changes += u64::from(gyr) + u64::from(acc);
            // Bounded memory also where nobody asks for an estimate.
            if self.acc.chosen().len() >= 2 * self.settings.max_samples.max(1024) {
                self.acc.settle();
            }
        }
        if memorable {
            self.remember_motion(sample);
        }
        self.stretch.samples.push(*sample);
        if self.stretch.samples.len() as f64 * self.stretch.step_s >= STRETCH_S {
            self.keep_if_lively();
        }
    }

    fn remember_motion(&mut self, sample: &PairSample) {
        let pair = [[sample[0], sample[1], sample[2]], [sample[6], sample[7], sample[8]]];
        let [rate1, rate2] = pair.map(|g| ComplexField::sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]));
        if rate1.max(rate2) > MOVING_RATE && ComplexField::abs(rate1 - rate2) > MOVING_DIFFERENCE {
            self.moving.push(pair);
            if self.recent.len() == RECENT_MOVING {
                self.recent.pop_front();
            }
            self.recent.push_back(pair);
        }
    }

    fn keep_if_lively(&mut self) {
        let samples = core::mem::take(&mut self.stretch.samples);
        self.liveliest.push(Stretch { step_s: self.stretch.step_s, samples });
        if self.liveliest.len() > STRETCHES {
            let liveliness: Vec<f64> = self.liveliest.iter().map(Stretch::liveliness).collect();
            let dullest = (0..liveliness.len()).min_by(|&a, &b| liveliness[a].total_cmp(&liveliness[b]));
            self.liveliest.remove(dullest.unwrap_or(0));
        }
    }

    /// Time of the latest conditioned sample, s.
    pub fn latest_s(&self) -> f64 {
        self.latest_s
    }

    /// How many samples joined the selection since the last estimate.
    pub fn changes(&self) -> u64 {
        self.changes
    }

    /// How many samples are selected.
    pub fn selected(&self) -> usize {
        self.gyr.len() + self.acc.chosen().len()
    }

    /// Moving instants so far.
    pub fn moving_seen(&self) -> u64 {
        self.moving.seen()
    }

    /// What the memories of motion say about `axes`.
    pub fn witness(&self, axes: &AxisPair) -> Witness {
        witness(
            self.moving.entries().iter(),
            (self.recent.len() >= RECENT_ENOUGH).then(|| self.recent.iter()),
            self.moving.seen() as f64 / self.settings.memory_hz(),
            axes,
        )
    }

    /// The latest moving instants, [`PRESENT_MOVING`] of them once there are so many.
    pub fn present(&self) -> impl Iterator<Item = &[Xyz; 2]> + Clone {
        self.recent.iter().skip(self.recent.len().saturating_sub(PRESENT_MOVING))
    }

    /// The chosen samples of both kinds, in the order they came.
    pub fn chosen(&mut self) -> (Vec<Candidate>, &[Candidate]) {
        self.acc.settle();
        (self.gyr.chosen(), self.acc.chosen())
    }

    /// Everything that the samples so far say about the hinge; None while there are too few to say anything. Given `starts` are
    /// each followed on all samples, as published; else the landscape is searched from the deterministic ones.
    pub fn estimate(&mut self, starts: Option<&[AxisPair]>) -> Option<Record> {
        self.acc.settle();
        self.unsearched += core::mem::take(&mut self.changes);
        if self.gyr.len() < LEAST_SAMPLES {
            return None;
        }
        let gyr = self.unbiased(self.gyr.chosen());
        let cost = HingeCost::new(
            self.settings.weights,
            gyr.iter().map(|c| (c.time, &c.values[0], &c.values[1])),
            self.acc.chosen().iter().map(|c| (c.time, &c.values[0], &c.values[1])),
        );
        // A step's result need not be finer than a ten-thousandth of its bound.
        let options = SolveOptions {
            step_tolerance: 1e-5,
            gain_tolerance: 1e-9,
            max_iterations: self.settings.max_iterations,
            ..SolveOptions::default()
        };
        // The landscape is searched anew once a tenth of the samples is new; until then its valleys are followed.
        let search = self.minima.is_empty() || self.unsearched as usize * 10 >= self.selected();
        let known: Vec<AxisPair> = self.minima.iter().map(|m| m.axes).collect();
        let mut solution = if let Some(starts) = starts {
            solve(&cost, starts, &SolveOptions { coarse_first: false, ..options }, &mut || true)
        } else if search {
            self.unsearched = 0;
            let starts: Vec<AxisPair> = known.into_iter().take(1).chain(deterministic_starts(&cost)).collect();
            solve(&cost, &starts, &options, &mut || true)
        } else {
            refine(&cost, &known, &options)
        };
        let pairing = self.settle_pairing(&cost, &mut solution, &options);
        self.minima = solution.minima;
        Some(Record::new(self.latest_s, &cost, &self.minima, pairing, self.witness(&self.minima[0].axes)))
    }

    /// Everything it knows, as bytes: a version, a checksum, the state.
    pub fn to_bytes(&self) -> Vec<u8> {
        crate::state::to_bytes(STATE_VERSION, self)
    }

    /// The stream that [`Self::to_bytes`] wrote; None where the bytes are of another version, damaged or not from there.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let stream: Self = crate::state::from_bytes(STATE_VERSION, bytes)?;
        let settings = stream.settings;
        let sound =
            settings.rate_hz > 0.0 && settings.rate_hz < 1e9 && settings.lowpass_hz >= 0.0 && settings.windows_are_bounded();
        let fresh = sound.then(|| Self::new(settings))?;
        let fits = stream.conditioner.fits(&fresh.conditioner)
            && stream.window.fits(&fresh.window)
            && stream.gyr.fits(&fresh.gyr)
            && stream.acc.fits(&fresh.acc)
            && stream.moving.fits(&fresh.moving)
            && stream.recent.len() <= RECENT_MOVING
            && stream.liveliest.len() <= STRETCHES
            && stream.stretch.step_s == fresh.stretch.step_s;
        fits.then_some(stream)
    }

    /// Without what rest showed to be bias.
    fn unbiased(&self, mut gyr: Vec<Candidate>) -> Vec<Candidate> {
        for (sensor, rest) in self.rest.iter().enumerate() {
            if let Some(bias) = rest.bias().filter(|_| self.settings.bias_from_rest) {
                for candidate in &mut gyr {
                    (0..3).for_each(|k| candidate.values[sensor][k] -= bias[k]);
                }
            }
        }
        gyr
    }

    /// A stretch without what rest showed to be bias.
    fn corrected(&self, stretch: &Stretch) -> Stretch {
        let mut corrected = stretch.clone();
        for (sensor, rest) in self.rest.iter().enumerate() {
            if let Some(bias) = rest.bias().filter(|_| self.settings.bias_from_rest) {
                for sample in &mut corrected.samples {
                    (0..3).for_each(|k| sample[6 * sensor + k] -= bias[k]);
                }
            }
        }
        corrected
    }

    /// The gyroscope bias of each sensor, rad/s, where rest has shown it.
    pub fn gyr_bias(&self) -> [Option<Xyz>; 2] {
        self.rest.each_ref().map(Rest::bias)
    }

    /// What was learnt belongs to another mounting: forgets all of it but the biases, which belong to the sensors.
    pub fn restart(&mut self) {
        let rest = self.rest;
        *self = Self::new(self.settings);
        self.rest = rest;
    }

    /// Puts the minimum first whose pairing the planar motion supports, and says how strongly it does.
    fn settle_pairing(&self, cost: &HingeCost, solution: &mut Solution, options: &SolveOptions) -> f64 {
        let best = solution.best().axes;
        let stretches: Vec<Stretch> =
            self.liveliest.iter().filter(|s| s.liveliness() > LIVELY).map(|s| self.corrected(s)).collect();
        let evidence = pairing_evidence(&best, stretches.iter());
        if !self.settings.settle_pairing || evidence > -PAIRING_DECIDED {
            return evidence;
        }
        let other = *refine(cost, &[best.other_sign_pair()], options).best();
        if same_axes(&other.axes, &best, SAME_VALLEY) {
            return evidence; // the other pairing has no valley of its own
        }
        solution.minima.retain(|m| !same_axes(&m.axes, &other.axes, options.distinct_angle));
        solution.minima.insert(0, other);
        pairing_evidence(&other.axes, stretches.iter())
    }
}

/// First bytes of a saved stream; the last is the version of the layout.
const STATE_VERSION: [u8; 8] = *b"imuhng\0\x01";
/// Stretches in which one segment hardly turns (mean squared rate, rad²/s²) do not tell the pairing.
const LIVELY: f64 = 0.2;
/// Fewer gyroscope samples than this say nothing.
const LEAST_SAMPLES: usize = 20;
/// Two pairs within this are in one valley, rad.
const SAME_VALLEY: f64 = 0.26;
