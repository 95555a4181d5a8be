//! A filter of one joint, fed sample by sample: differentiation with its delay, the start, gaps, restarts, saved state.

use nalgebra::ComplexField;
use serde::{Deserialize, Serialize};

use super::{
    algebra::{Quat, Vec3, inverted, mul, normalize},
    lane::{Lane, Real},
    leaning::Leaning,
    method::{Method, Tuning},
    ring::{LENGTH, Ring, is_even, stencil_step},
    settings::Settings,
    start::Start,
    state::{Joint, Moment, State, at_joint_center},
    turns::{Step, gap_variance},
};
use crate::{PairSample, Xyz, condition::BREAK_STEPS};

/// How far an estimate can be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u8)]
pub enum Status {
    /// The motion so far does not determine the orientation.
    Starting = 0,
    /// All is well.
    Tracking = 1,
    /// Known once, but too long ago or too vaguely: `std` says how vaguely.
    Coasting = 2,
}

impl Status {
    /// After the start.
    #[inline(always)]
    pub(super) fn of(std: f64) -> Self {
        if std > VAGUE_STD { Self::Coasting } else { Self::Tracking }
    }
}

/// Above this, rad, an estimate counts as vague.
const VAGUE_STD: f64 = 0.0873;

/// An estimate of one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Sensor 2 to sensor 1.
    pub q: Quat<f64>,
    /// Root of the trace of the covariance of the rotation error, rad.
    pub std: f64,
    /// How far to trust it.
    pub status: Status,
}

/// A heading is wrong when the horizontal accelerations of the two sensors disagree by this part of their power...
const WRONG: f64 = 0.7;
/// ...that motion has shown in at least this part of the time...
const WRONG_POWER: f64 = 0.2;
/// ...this long after the start, s.
const WRONG_AFTER_S: f64 = 5.0;
/// No sound number of a filter is as large.
const ENDLESS: f64 = 1e30;

/// Whether a sample holds numbers only.
#[inline(always)]
pub(super) fn is_finite(s: &PairSample) -> bool {
    let sum = ((s[0] + s[1]) + (s[2] + s[3])) + ((s[4] + s[5]) + (s[6] + s[7])) + ((s[8] + s[9]) + (s[10] + s[11]));
    sum.is_finite()
}

/// Root of the trace of the covariance, rad.
#[inline(always)]
pub(super) fn spread<L: Lane>(variance: L) -> L {
    variance.at_least(L::splat(0.0)).sqrt().at_most(L::splat(LARGEST_STD))
}

/// Whether, in some lane, the heading looks wrong or there are no numbers any more: by [`State::watch`] and a part of `q`.
#[inline(always)]
pub(super) fn alarm<L: Lane>([error, power]: [L; 2], q: L) -> bool {
    let wrong = power.where_above(L::splat(WRONG_POWER), error - power * L::splat(WRONG), L::splat(-1.0));
    let sum = error + q;
    L::splat(ENDLESS).where_above(sum.at_least(-sum), wrong, L::splat(1.0)).any_above(L::splat(0.0))
}

/// The filter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "T: Real, M: Method")]
pub struct Filter<T, M> {
    pub(super) settings: Settings,
    pub(super) method: M,
    pub(super) tuning: Tuning<f64>,
    pub(super) step: u64,
    /// Nominal step, s, and what differences are multiplied with to be derivatives, 1/s.
    pub(super) step_s: f64,
    pub(super) per: f64,
    pub(super) state: State<T>,
    /// While it is there, the filter has not started.
    pub(super) start: Option<Start>,
    /// How many restarts there were, and how long the filter has been tracking since, s.
    restarts: u32,
    pub(super) tracking_s: f64,
    pub(super) ring: Ring<T>,
    /// Samples so far; how many of them are worked in; where the present stretch without a gap begins; where the present
    /// stretch of even time begins.
    pub(super) count: u64,
    pub(super) done: u64,
    pub(super) stretch: u64,
    pub(super) even: u64,
    /// Latest rows of each sensor that are copies of the one before: packets that were lost. Before this sample there are
    /// copies that could not be repaired any more.
    pub(super) lost: [u64; 2],
    pub(super) unrepaired: u64,
}

impl<T: Real, M: Method> Filter<T, M> {
    /// A filter before its first sample.
    pub fn new(settings: Settings, method: M) -> Self {
        let tuning = settings.tuning();
        let step = stencil_step(settings.rate_hz);
        let (q, std) = settings.given.unwrap_or(([1.0, 0.0, 0.0, 0.0], 1.0));
        let var = std * std / 3.0;
        let mut state = State::new(normalize(q), [var, 0.0, 0.0, var, 0.0, var], [0.0; 3], tuning.link_var);
        method.begin(&mut state);
        Self {
            settings,
            method,
            tuning,
            step,
            step_s: 1.0 / settings.rate_hz,
            per: settings.rate_hz / (12.0 * step as f64),
            state,
            start: settings.given.is_none().then(|| Start::new(settings.start_fade_s, tuning.bias_var)),
            restarts: 0,
            tracking_s: 0.0,
            ring: Ring::new(),
            count: 0,
            done: 0,
            stretch: 0,
            even: 0,
            lost: [0; 2],
            unrepaired: 0,
        }
    }

    /// The accelerations of a sample are used so many samples later, when its neighbours are there; [`Self::latest`] bridges
    /// them with the gyroscopes.
    pub fn delay_samples(&self) -> u64 {
        2 * self.step
    }

    /// Takes one sample at `time_s`, later than all before; what is not finite or not later is passed over.
    pub fn push(&mut self, time_s: f64, sample: &PairSample) {
        self.push_into(time_s, sample, &mut |_, _| {});
    }

    /// The same, and hands over every estimate when its accelerations have been used, with the number of its sample. While the
    /// filter is starting, these hold nothing.
    #[inline(always)]
    pub(super) fn push_into(&mut self, time_s: f64, sample: &PairSample, sink: &mut impl FnMut(u64, Estimate)) {
        if !(time_s.is_finite() && is_finite(sample)) {
            return;
        }
        let number = self.count;
        if let Some(last) = number.checked_sub(1) {
            let steps = (time_s - self.ring.time(last)) * self.settings.rate_hz;
            if steps <= 0.0 {
                return;
            }
            if steps > BREAK_STEPS {
                self.flush(sink);
                self.stretch = number;
            }
            if !is_even(steps) {
                self.even = number;
            }
        }
        let sample = self.unbiased(sample);
        self.ring.put(number, time_s, &sample);
        self.mend(number, &sample);
        self.count += 1;
        let delay = self.delay_samples();
        while self.done + delay < self.count {
            let number = self.done;
            let correct = self.may_correct(number);
            let estimate = self.advance(correct);
            sink(number, estimate);
        }
    }

    /// Whether the accelerations of a sample whose neighbours are there can be used: no gap and no lost packet is among these.
    #[inline(always)]
    fn may_correct(&self, number: u64) -> bool {
        number >= self.stretch.max(self.unrepaired) + self.delay_samples() && self.lost == [0; 2]
    }

    /// Receivers repeat the last row for packets that were lost. Once the next fresh row is here, the copies that still wait to
    /// be worked in become the straight line to it.
    #[inline(always)]
    fn mend(&mut self, number: u64, sample: &[T; 12]) {
        let Some(last) = number.checked_sub(1) else { return };
        for sensor in 0..2 {
            if self.ring.has(last, sensor, sample) {
                self.lost[sensor] += 1;
                // So long a standstill is believed.
                if self.lost[sensor] as f64 > (LONGEST_LOSS_S * self.settings.rate_hz).min(LENGTH as f64 / 2.0) {
                    self.lost[sensor] = 0;
                }
            } else if self.lost[sensor] > 0 {
                let fresh = last - self.lost[sensor];
                for k in (fresh + 1).max(self.done)..number {
                    self.ring.bridge(k, fresh, number, sensor);
                }
                if fresh + 1 < self.done {
                    self.unrepaired = self.done;
                }
                self.lost[sensor] = 0;
            }
        }
    }

    /// Works in the samples that wait for neighbours that will not come, by the gyroscopes alone.
    pub(super) fn flush(&mut self, sink: &mut impl FnMut(u64, Estimate)) {
        while self.done < self.count {
            let number = self.done;
            let estimate = self.advance(false);
            sink(number, estimate);
        }
    }

    #[inline(always)]
    pub(super) fn unbiased(&self, sample: &PairSample) -> [T; 12] {
        let bias = self.bias();
        let mut unbiased = [T::default(); 12];
        for k in 0..12 {
            unbiased[k] = T::splat(sample[k] - bias[k]);
        }
        unbiased
    }

    /// What calibration takes from a sample.
    #[inline(always)]
    pub(super) fn bias(&self) -> PairSample {
        let Joint { gyr_bias: [[a, b, c], [g, h, i]], acc_bias: [[d, e, f], [j, k, l]], .. } = self.settings.joint;
        [a, b, c, d, e, f, g, h, i, j, k, l]
    }

    /// Acceleration of the joint centre at `number`, whose neighbours are there.
    #[inline(always)]
    fn accelerations(&self, number: u64) -> [Vec3<T>; 2] {
        let even = number >= self.even + 2 * self.step;
        let per = T::splat(self.per);
        let acceleration = |sensor: usize, [x, y, z]: Xyz| {
            let gyr_dot = if even {
                self.ring.gyr_dot(number, sensor, self.step, per)
            } else {
                self.ring.gyr_dot_uneven(number, sensor, self.step)
            };
            let r = [T::splat(x), T::splat(y), T::splat(z)];
            at_joint_center(self.ring.acc(number, sensor), self.ring.gyr(number, sensor), gyr_dot, r)
        };
        [acceleration(0, self.settings.joint.r1), acceleration(1, self.settings.joint.r2)]
    }

    /// What the instant of sample `number` tells.
    #[inline(always)]
    fn moment(&self, number: u64, step: &Step<T>, correct: bool) -> Moment<T> {
        let accelerations = if correct { self.accelerations(number) } else { [[T::default(); 3]; 2] };
        Moment::new([step.dt, step.per_dt].map(T::splat), step.turns, accelerations)
    }

    /// The instant of the sample that was worked in last, if its accelerations were used.
    pub(super) fn corrected_by(&self, number: u64) -> Option<Moment<T>> {
        (number + 1 == self.done && self.done + self.delay_samples() == self.count && self.may_correct(number))
            .then(|| self.moment(number, &self.step_to(number, true), true))
    }

    /// Whether an orientation was found.
    pub(super) fn has_started(&self) -> bool {
        self.start.is_none()
    }

    /// Works in the next sample.
    #[inline(always)]
    fn advance(&mut self, correct: bool) -> Estimate {
        let number = self.done;
        let step = self.step_to(number, correct);
        let gap = number > 0 && number == self.stretch;
        if gap {
            self.cross_gap(&step);
        }
        let moment = self.moment(number, &step, correct);
        self.done += 1;
        if self.start.is_some() {
            return self.prepare(&moment, step.dt, correct);
        }
        self.method.step(&self.tuning.cast(), &mut self.state, &moment, correct);
        self.tracked_for(1, step.dt);
        if correct {
            self.watch();
        }
        self.estimate()
    }

    /// Counts the seconds since the start, as long as they matter.
    #[inline(always)]
    pub(super) fn tracked_for(&mut self, steps: usize, dt: f64) {
        for _ in 0..steps {
            if self.tracking_s > WRONG_AFTER_S {
                break;
            }
            self.tracking_s += dt;
        }
    }

    /// One instant of the start.
    fn prepare(&mut self, m: &Moment<T>, dt: f64, correct: bool) -> Estimate {
        let [turn1, turn2, acc1, acc2] = [m.turn1, m.turn2, m.acc1, m.acc2].map(|v| v.map(T::to_f64));
        let drift = self.tuning.cast().process(T::splat(1.0), m).to_f64();
        if let Some(start) = &mut self.start {
            start.turn(turn1, turn2, dt, drift);
            if correct {
                start.add(acc1, acc2, dt);
            }
            if correct && start.is_known_to(self.settings.start_std) {
                let (q, p) = start.solve();
                self.state = State::new(q, p, acc2, self.tuning.link_var);
                self.state.leaning = Leaning::after(start.lean_s(), self.tuning.bias_var);
                self.method.begin(&mut self.state);
                self.start = None;
                self.tracking_s = 0.0;
            } else {
                return Estimate { q: [1.0, 0.0, 0.0, 0.0], std: LARGEST_STD, status: Status::Starting };
            }
        }
        self.estimate()
    }

    /// What is not seen in a gap: between two rates the joint may have moved otherwise than evenly.
    fn cross_gap(&mut self, step: &Step<T>) {
        let too_long = step.dt > self.settings.max_gap_s;
        if too_long && self.settings.restart {
            self.start_anew();
            return;
        }
        let variance = gap_variance(step);
        match &mut self.start {
            Some(start) => start.doubt(2.0 * variance),
            None => self.method.widen(&mut self.state, T::splat(variance)),
        }
    }

    /// Starts anew where the two sensors' horizontal accelerations say that the heading is wrong.
    #[inline(always)]
    pub(super) fn watch(&mut self) {
        if !alarm(self.state.watch, self.state.q[0]) {
            return;
        }
        let broken = !(self.state.watch[0] + self.state.q[0]).to_f64().is_finite();
        if broken || (self.settings.restart && self.tracking_s > WRONG_AFTER_S) {
            self.start_anew();
        }
    }

    fn start_anew(&mut self) {
        self.start = Some(Start::new(self.settings.start_fade_s, self.tuning.bias_var));
        self.restarts += 1;
    }

    #[inline(always)]
    pub(super) fn estimate(&self) -> Estimate {
        let [w, x, y, z] = self.state.q;
        let q = [w.to_f64(), x.to_f64(), y.to_f64(), z.to_f64()];
        let std = spread(self.method.variance(&self.state)).to_f64();
        Estimate { q, std, status: Status::of(std) }
    }

    /// The estimate at the latest sample: the accelerations of the last [`Self::delay_samples`] are not used yet, the
    /// gyroscopes are.
    pub fn latest(&self) -> Estimate {
        let (mut q, mut variance, starting) = match &self.start {
            Some(start) => {
                let (q, p) = start.solve();
                (q, p[0] + p[3] + p[5] + start.leaning_variance(), true)
            }
            None => {
                let e = self.estimate();
                (e.q, e.std * e.std, false)
            }
        };
        for number in self.done..self.count {
            let step = self.step_to(number, false);
            let m = Moment::new([step.dt, step.per_dt], step.turns.map(|v| v.map(T::to_f64)), [[0.0; 3]; 2]);
            q = mul(mul(inverted(m.step[0]), q), m.step[1]);
            variance += 3.0 * self.tuning.process(self.state.drift.to_f64(), &m);
            if number > 0 && number == self.stretch {
                variance += 3.0 * gap_variance(&step);
            }
        }
        let std = ComplexField::sqrt(variance).min(LARGEST_STD);
        Estimate { q: normalize(q), std, status: if starting { Status::Starting } else { Status::of(std) } }
    }

    /// Mean square of the horizontal acceleration of the joint over the last ten seconds, (m/s²)²: heading is seen by it.
    pub fn heading_power(&self) -> f64 {
        self.state.heading_power.to_f64()
    }

    /// How often the filter has started anew.
    pub fn restarts(&self) -> u32 {
        self.restarts
    }

    /// Samples so far.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Time of the latest sample, s.
    pub fn latest_s(&self) -> Option<f64> {
        self.count.checked_sub(1).map(|last| self.ring.time(last))
    }

    /// All that it estimates; before the start is over this is empty.
    pub fn state(&self) -> &State<T> {
        &self.state
    }

    /// The settings it was made with.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Whether a saved filter can go on.
    pub(super) fn is_sound(&self) -> bool {
        self.settings.are_sound()
            && self.step == stencil_step(self.settings.rate_hz)
            && self.step_s == 1.0 / self.settings.rate_hz
            && self.per == self.settings.rate_hz / (12.0 * self.step as f64)
            && self.tuning == self.settings.tuning()
            && self.done <= self.count
            && self.count - self.done <= self.delay_samples()
            && self.stretch <= self.count
            && self.even <= self.count
            && self.unrepaired <= self.count
            && self.lost.iter().all(|lost| *lost < self.count.max(1) && *lost <= LENGTH)
            && self.start.is_none_or(|s| s.is_sound())
    }
}

/// Copies over longer than this are no lost packets but a coarse sensor at rest, s.
const LONGEST_LOSS_S: f64 = 0.4;
/// Knowing nothing: uniform in ±π about three axes.
const LARGEST_STD: f64 = core::f64::consts::PI;
