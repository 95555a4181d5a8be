//! What a filter knows of one joint, and what one instant tells it.

use serde::{Deserialize, Serialize};

use super::{
    algebra::{Quat, Sym3, Vec3, add, cross, dot, exp, inverted, mul, rotate_back, scale, sub, trace},
    lane::Lane,
    leaning::Leaning,
    method::LEAST_LINK_VAR,
};
use crate::Xyz;

/// What calibration knows of the joint and of its two sensors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Joint {
    /// From the joint centre to sensor 1 in its frame, m.
    pub r1: Xyz,
    /// From the joint centre to sensor 2 in its frame, m.
    pub r2: Xyz,
    /// Gyroscope biases, rad/s.
    pub gyr_bias: [Xyz; 2],
    /// What they leave uncertain of each channel of the relative rate, one standard deviation, rad/s.
    pub relative_bias_std: f64,
    /// Accelerometer biases, m/s².
    pub acc_bias: [Xyz; 2],
}

/// White noise of one sample of one channel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Noise {
    /// Gyroscopes, rad/s.
    pub gyr_std: f64,
    /// Accelerometers, m/s².
    pub acc_std: f64,
}

impl Default for Noise {
    fn default() -> Self {
        Self { gyr_std: 0.004, acc_std: 0.05 }
    }
}

/// One instant: how both sensors have turned since the last one, and the acceleration of the joint centre. Nothing of it depends
/// on what a filter knows, so many instants can be worked out side by side.
#[derive(Clone, Copy, Debug, Default)]
pub struct Moment<L> {
    /// Time since the last instant, s.
    pub dt: L,
    /// Its reciprocal, 1/s.
    pub per_dt: L,
    /// Rotation vector of sensor 1 over `dt`, in its frame, rad.
    pub turn1: Vec3<L>,
    /// The same of sensor 2.
    pub turn2: Vec3<L>,
    /// `exp(turn/2)` of both (eq. 5a).
    pub step: [Quat<L>; 2],
    /// Specific force at the joint centre in the frame of sensor 1, m/s².
    pub acc1: Vec3<L>,
    /// The same in the frame of sensor 2.
    pub acc2: Vec3<L>,
    /// Squares: of both turns together, rad², and of the two accelerations, (m/s²)².
    pub turned2: L,
    /// See there.
    pub level: [L; 2],
}

impl<L: Lane> Moment<L> {
    /// From pace (dt, per_dt), turns of both sensors and the accelerations that they see.
    #[inline(always)]
    pub fn new([dt, per_dt]: [L; 2], [turn1, turn2]: [Vec3<L>; 2], [acc1, acc2]: [Vec3<L>; 2]) -> Self {
        let step = [exp(turn1), exp(turn2)];
        let turned2 = dot(turn1, turn1) + dot(turn2, turn2);
        Self { dt, per_dt, turn1, turn2, step, acc1, acc2, turned2, level: [dot(acc1, acc1), dot(acc2, acc2)] }
    }
}

impl<L> Moment<L> {
    /// Every number through `f`.
    #[inline(always)]
    pub(crate) fn each<K>(&self, f: impl Fn(&L) -> K) -> Moment<K> {
        let vector = |[x, y, z]: &Vec3<L>| [f(x), f(y), f(z)];
        let [[a, b, c, d], [w, x, y, z]] = &self.step;
        Moment {
            dt: f(&self.dt),
            per_dt: f(&self.per_dt),
            turn1: vector(&self.turn1),
            turn2: vector(&self.turn2),
            step: [[f(a), f(b), f(c), f(d)], [f(w), f(x), f(y), f(z)]],
            acc1: vector(&self.acc1),
            acc2: vector(&self.acc2),
            turned2: f(&self.turned2),
            level: [f(&self.level[0]), f(&self.level[1])],
        }
    }

    /// The same with a pace that is known beforehand.
    #[inline(always)]
    pub(crate) fn at_pace(self, [dt, per_dt]: [L; 2]) -> Self {
        Self { dt, per_dt, ..self }
    }
}

/// Which way is up, and what one instant's accelerations have across it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Up<L> {
    /// [`State::up`], its square and the reciprocal of that.
    pub up: Vec3<L>,
    pub square: L,
    pub per_square: L,
    /// Square of the horizontal acceleration that sensor 2 sees, (m/s²)².
    pub flat: L,
}

impl<L: Lane> Up<L> {
    /// Where nothing has looked up.
    #[inline(always)]
    pub fn nowhere() -> Self {
        let zero = L::splat(0.0);
        Self { up: [zero; 3], square: zero, per_square: zero, flat: zero }
    }

    /// Of this direction, and of what sensor 2 sees.
    #[inline(always)]
    pub fn of(up: Vec3<L>, m: &Moment<L>) -> Self {
        let square = dot(up, up).at_least(L::splat(1e-12));
        let mut up = Self { up, square, per_square: L::splat(1.0) / square, flat: L::splat(0.0) };
        up.flat = up.horizontal(m.level[1], m.acc2);
        up
    }

    /// Squares of the link residual and of the horizontal accelerations of both sensors, weighed and bounded, so that one impact
    /// counts like any other instant; `seen` is [`expected`].
    #[inline(always)]
    pub fn watched(&self, m: &Moment<L>, seen: Vec3<L>, error2: L) -> [L; 2] {
        let flat = self.horizontal(m.level[0], seen) + self.flat;
        let weight = L::splat(1.0) / (flat + L::splat(WATCH_POWER));
        [error2.at_most(flat + flat) * weight, flat * weight]
    }

    /// Square of what of `a`, whose own is `level`, is horizontal.
    #[inline(always)]
    fn horizontal(&self, level: L, a: Vec3<L>) -> L {
        let upwards = dot(a, self.up);
        (level - upwards * upwards * self.per_square).at_least(L::splat(0.0))
    }
}

/// `a − ω×(ω×r) − ω̇×r` (eqs 3–4 of Olsson & Halvorsen 2017), of bias-free readings.
#[inline(always)]
pub fn at_joint_center<L: Lane>(acc: Vec3<L>, gyr: Vec3<L>, gyr_dot: Vec3<L>, r: Vec3<L>) -> Vec3<L> {
    sub(acc, add(cross(gyr, cross(gyr, r)), cross(gyr_dot, r)))
}

/// `exp(−turn1/2) ⊙ q ⊙ exp(turn2/2)`: eq. 5a of both sensors, seen from sensor 1.
#[inline(always)]
pub(crate) fn turned<L: Lane>(q: Quat<L>, m: &Moment<L>) -> Quat<L> {
    let [step1, step2] = m.step;
    mul(mul(inverted(step1), q), step2)
}

/// The acceleration of sensor 1 as sensor 2 should see it.
#[inline(always)]
pub(crate) fn expected<L: Lane>(q: Quat<L>, m: &Moment<L>) -> Vec3<L> {
    rotate_back(q, m.acc1)
}

/// A filter's estimate. Perturbations act on the right, so errors and covariance are in the frame of sensor 2.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct State<L> {
    /// Sensor 2 to sensor 1.
    pub q: Quat<L>,
    /// Covariance of the rotation error, rad². The complementary filter keeps `[tilt variance, heading variance]` in the
    /// first two places.
    pub p: Sym3<L>,
    /// Recent mean acceleration in the frame of sensor 2: upwards, m/s².
    pub up: Vec3<L>,
    /// Mean square of the link residual beyond what the orientation explains, per axis, (m/s²)².
    pub link_var: L,
    /// The link residual smoothed over a short while, m/s².
    pub link_mean: Vec3<L>,
    /// Its mean square as that of independent samples, per axis, (m/s²)²: what is left of the noise of a sample in the mean
    /// of many. Neighbours may err alike, or against each other.
    pub link_slow_var: L,
    /// Mean square of the horizontal acceleration over the recent past, (m/s²)²: what heading is seen by. It is the smallest
    /// eigenvalue of the mean of `[a×]ᵀ[a×]` where `up` is the mean direction.
    pub heading_power: L,
    /// Mean of the squared link residual and of the squared horizontal accelerations over the last seconds, weighed alike:
    /// their ratio is near 0 for a good heading and near 1 for an arbitrary one; the second is below 1.
    pub watch: [L; 2],
    /// Factor on the drift noise, found from the innovations.
    pub drift: L,
    /// Once and twice smoothed corrections, rad.
    pub memory: [Vec3<L>; 2],
    /// Mean squares of a correction and of the twice smoothed ones, rad².
    pub memory_size: [L; 2],
    /// What drift adds about an axis, on average over the last second, rad²/s.
    pub diffusion: L,
    /// What is left of the larger gain after a start, rad/s.
    pub boost: L,
    /// Gyroscope biases beyond the calibrated, fed back by the complementary filter, rad/s.
    pub gyr_bias: [Vec3<L>; 2],
    /// What gyroscope biases that nobody knows do to it.
    pub leaning: Leaning<L>,
}

impl<L: Lane> State<L> {
    /// A filter that starts at `q` with the covariance `p`.
    pub fn new(q: [f64; 4], p: [f64; 6], up: Xyz, link_var: f64) -> Self {
        let zero = L::splat(0.0);
        Self {
            q: q.map(L::splat),
            p: p.map(L::splat),
            up: up.map(L::splat),
            link_var: L::splat(link_var),
            link_mean: [zero; 3],
            link_slow_var: L::splat(link_var),
            heading_power: zero,
            watch: [zero; 2],
            drift: L::splat(1.0),
            memory: [[zero; 3]; 2],
            memory_size: [zero; 2],
            diffusion: L::splat(USUAL_DIFFUSION),
            boost: zero,
            gyr_bias: [[zero; 3]; 2],
            leaning: Leaning::after(0.0, 0.0),
        }
    }

    /// Every number through `f`, together with its counterpart in `other`.
    #[inline(always)]
    pub(crate) fn zip_with<K: Lane>(&mut self, other: &mut State<K>, mut f: impl FnMut(&mut L, &mut K)) {
        let mut go = |a: &mut [L], b: &mut [K]| a.iter_mut().zip(b).for_each(|(a, b)| f(a, b));
        go(&mut self.q, &mut other.q);
        go(&mut self.p, &mut other.p);
        go(&mut self.up, &mut other.up);
        go(&mut self.link_mean, &mut other.link_mean);
        go(&mut self.watch, &mut other.watch);
        go(self.memory.as_flattened_mut(), other.memory.as_flattened_mut());
        go(&mut self.memory_size, &mut other.memory_size);
        go(self.gyr_bias.as_flattened_mut(), other.gyr_bias.as_flattened_mut());
        go(self.leaning.rows.as_flattened_mut(), other.leaning.rows.as_flattened_mut());
        go(&mut self.leaning.turn, &mut other.leaning.turn);
        f(&mut self.link_var, &mut other.link_var);
        f(&mut self.link_slow_var, &mut other.link_slow_var);
        f(&mut self.heading_power, &mut other.heading_power);
        f(&mut self.drift, &mut other.drift);
        f(&mut self.diffusion, &mut other.diffusion);
        f(&mut self.boost, &mut other.boost);
        f(&mut self.leaning.since, &mut other.leaning.since);
        f(&mut self.leaning.variance, &mut other.leaning.variance);
    }

    /// What is up turns with sensor 2.
    #[inline(always)]
    pub(crate) fn turn_up(&mut self, turn2: Vec3<L>) {
        self.up = sub(self.up, cross(turn2, self.up));
    }

    /// Follows the direction of gravity.
    #[inline(always)]
    pub(crate) fn follow_up(&mut self, m: &Moment<L>) {
        self.up = add(self.up, scale(sub(m.acc2, self.up), share(m.dt, UP_S)));
    }

    /// Follows what drift adds, rad²/s.
    #[inline(always)]
    pub(crate) fn follow_drift(&mut self, m: &Moment<L>, now: L) {
        self.diffusion = self.diffusion + (now - self.diffusion) * share(m.dt, DIFFUSION_S);
    }

    /// Follows what tells whether heading is seen and right: [`Up::flat`] and [`Up::watched`].
    #[inline(always)]
    pub(crate) fn observe(&mut self, m: &Moment<L>, flat: L, watched: [L; 2]) {
        self.heading_power = self.heading_power + (flat - self.heading_power) * share(m.dt, POWER_S);
        let (share, [error, power]) = (share(m.dt, WATCH_S), self.watch);
        self.watch = [error + (watched[0] - error) * share, power + (watched[1] - power) * share];
    }

    /// Follows the scatter of the link residual `error`; the product of both in `explained` is the part per axis that
    /// the orientation's own uncertainty explains. Bad samples count as [`LINK_JUMP`] times the present value at most.
    #[inline(always)]
    pub(crate) fn follow_link(&mut self, m: &Moment<L>, error: Vec3<L>, error2: L, [variance, share_of]: [L; 2]) {
        let one = L::splat(1.0);
        self.link_var = followed(self.link_var, error2, variance * share_of, m.dt).at_least(L::splat(LEAST_LINK_VAR));
        self.link_mean = add(self.link_mean, scale(sub(error, self.link_mean), share(m.dt, LINK_MEAN_S)));
        let as_one = L::splat(2.0) * (m.per_dt * L::splat(LINK_MEAN_S)).at_least(one) - one; // (2 − s)/s
        let slow = dot(self.link_mean, self.link_mean) * as_one;
        let slow_var = followed(self.link_slow_var, slow, variance * (share_of * as_one), m.dt);
        self.link_slow_var = slow_var.at_least(L::splat(LEAST_LINK_VAR * LEAST_SLOW));
    }

    /// Trace of the covariance of a full 3×3 `p`.
    pub fn variance(&self) -> L {
        trace(&self.p)
    }
}

/// What a mean over `seconds` takes of one sample.
#[inline(always)]
pub(crate) fn share<L: Lane>(dt: L, seconds: f64) -> L {
    (dt * L::splat(1.0 / seconds)).at_most(L::splat(1.0))
}

/// A variance per axis after one more `square` of three axes.
#[inline(always)]
fn followed<L: Lane>(var: L, square: L, explained: L, dt: L) -> L {
    let third = square * L::splat(1.0 / 3.0);
    let now = (third - explained.at_most(third * L::splat(0.5))).at_most(var * L::splat(LINK_JUMP));
    var + (now - var) * share(dt, LINK_S)
}

/// What drift adds while limbs move, rad²/s: to begin with.
const USUAL_DIFFUSION: f64 = 1e-4;
/// Time constants, s: of the direction upwards, of the drift that corrections are held against, of the horizontal power, of the watch on the heading, of the link residual.
const UP_S: f64 = 1.0;
const DIFFUSION_S: f64 = 1.0;
const POWER_S: f64 = 10.0;
const WATCH_S: f64 = 4.0;
/// Horizontal power that counts half in the watch, (m/s²)².
const WATCH_POWER: f64 = 1.0;
const LINK_S: f64 = 4.0;
/// The link residual is smoothed over so long, s.
const LINK_MEAN_S: f64 = 0.05;
/// Smoothing takes at most all but this part of the variance.
const LEAST_SLOW: f64 = 0.1;
/// One sample may claim at most this many times the present variance of the link.
const LINK_JUMP: f64 = 9.0;
