//! The complementary filter: Algorithm 1 of Remmerswaal et al. 2021, written in one sensor's frame.
//!
//! Only the relative orientation enters the cost (eq. 10). With `u = a1 × R a2` in frame 1 the gradient (eq. 13) is
//! `(−u, Rᵀu)`, its norm `√2·‖u‖`, and eqs 5, 8, 9 and 12 become one quaternion product: half the work of the literal form, and
//! the same numbers.

use serde::{Deserialize, Serialize};

use super::{
    algebra::{Quat, Sym3, Vec3, add, add_diagonal, first_order, inverted, mul, nearly_unit, normalize, rotate_back, scale},
    eight::{EIGHT, Eight},
    interleaved,
    lane::{Lane, Real},
    method::{Method, Tuning, follow_in_turn},
    stages::{Ahead, Correction, Seen},
    state::{Moment, State, Up, expected, share, turned},
};

/// How the complementary filter works.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Complementary {
    /// β of eq. 12, rad/s: the speed of the correction.
    pub beta: f64,
    /// β is larger by this after a start, rad/s...
    pub beta_extra: f64,
    /// ...fading with this time constant, s.
    pub settle_s: f64,
    /// The gradient's part about the vertical counts so many times: tilt is seen at every instant, heading only where the
    /// joint accelerates sideways. 1: as published.
    pub heading_gain: f64,
    /// Angle between the two accelerations at which the normalised step has 0.7 of its size, rad: below it noise rules. 0: as
    /// published.
    pub soft_angle: f64,
    /// The correction is at most as fast as √3 standard deviations of the drift that it undoes (eq. 12 has √3 σ of the
    /// gyroscopes), where what grows with motion counts so many times: where there is hardly any drift, noise would turn it
    /// about. 0: as fast as β says, as published.
    pub drift_limit: f64,
    /// Feedback of the correction to the gyroscope biases, 1/s. 0: none.
    pub bias_gain: f64,
    /// The literal Algorithm 1: the gradient at the previous orientation, and the first-order step of eq. 5b.
    pub literal: bool,
}

impl Default for Complementary {
    fn default() -> Self {
        Self {
            beta: 0.1,
            beta_extra: 0.0,
            settle_s: 5.0,
            heading_gain: 8.0,
            soft_angle: 0.01,
            drift_limit: DRIFT_LIMIT,
            bias_gain: 0.0,
            literal: false,
        }
    }
}

/// Default of [`Complementary::drift_limit`].
const DRIFT_LIMIT: f64 = 1.5;

impl Complementary {
    /// Whether all but the correction can be worked out without the orientation.
    #[inline(always)]
    fn looks_ahead(&self) -> bool {
        !self.literal && self.bias_gain == 0.0
    }

    /// Both halves of eq. 8 in their frames: what is taken from ω1 and from ω2.
    #[inline(always)]
    fn halves<L: Lane>(q: Quat<L>, rate: Vec3<L>) -> [Vec3<L>; 2] {
        let half = scale(rate, L::splat(0.5));
        [rotate_back(inverted(q), half), scale(half, L::splat(-1.0))]
    }
}

impl Method for Complementary {
    const FULL_COVARIANCE: bool = false;

    #[inline(always)]
    fn begin<L: Lane>(&self, s: &mut State<L>) {
        s.boost = L::splat(self.beta_extra);
        let third = (s.p[0] + s.p[3] + s.p[5]) * L::splat(1.0 / 3.0);
        let zero = L::splat(0.0);
        s.p = [third, third, zero, zero, zero, zero];
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn step<L: Lane>(&self, t: &Tuning<L>, s: &mut State<L>, m: &Moment<L>, correct: bool) {
        if correct && self.looks_ahead() {
            let drift = self.drift(t, m);
            let trail = self.trail(s, m, drift[1]);
            let ahead = self.ahead(t, m, drift, &trail);
            let (q, seen) = self.corrected(s.q, m, &ahead);
            s.q = q;
            self.learn(t, s, m, &ahead, &seen);
            return;
        }
        let mut m = *m;
        if self.bias_gain > 0.0 {
            let turns = [add(m.turn1, scale(s.gyr_bias[0], -m.dt)), add(m.turn2, scale(s.gyr_bias[1], -m.dt))];
            m = Moment::new([m.dt, m.per_dt], turns, [m.acc1, m.acc2]);
        }
        let [spread, allowed] = self.drift(t, &m);
        s.follow_drift(&m, allowed);
        let drifts = [spread, self.speed2(t, &m, s.diffusion, s.boost)];
        let mut step = L::splat(0.0);
        if self.literal {
            // Of the gradient as it is, no part counts more.
            let ahead = self.prepared(&m, drifts, Up::nowhere(), step);
            step = self.literal_step(&ahead, s, &m, correct);
        } else {
            s.q = turned(s.q, &m);
            s.turn_up(m.turn2);
            if self.bias_gain > 0.0 {
                // Such a bias may be anything.
                s.q = normalize(s.q);
            }
        }
        if !correct {
            s.p[0] = s.p[0] + spread;
            s.p[1] = s.p[1] + spread;
            s.leaning.wait(&m);
            s.q = normalize(s.q);
            return;
        }
        let seen = expected(s.q, &m);
        s.follow_up(&m);
        let up = Up::of(s.up, &m);
        let excess = if self.literal { L::splat(0.0) } else { self.heading_excess(&up) };
        let ahead = self.prepared(&m, drifts, up, excess);
        if !self.literal {
            let correction = Correction::toward(seen, &ahead);
            if self.bias_gain > 0.0 {
                self.feed_back(s, correction.rate(), m.dt);
            }
            (s.q, step) = correction.step(nearly_unit(s.q), m.dt);
            s.boost = s.boost - s.boost * share(m.dt, self.settle_s);
        }
        self.learn(t, s, &m, &ahead, &Seen { seen, step });
    }

    #[inline(always)]
    fn follow<T: Real, V: Eight<T>>(
        &self,
        tuning: &Tuning<f64>,
        state: &mut State<T>,
        moments: &[Moment<[T; EIGHT]>],
        pace: [f64; 2],
        q: &mut [Quat<T>],
        variance: &mut [T],
    ) -> Option<usize> {
        let before = *state;
        if self.looks_ahead() {
            if !interleaved::follow::<T, V>(self, tuning, state, moments, pace, q, variance) {
                return None;
            }
            *state = before;
        }
        follow_in_turn(self, tuning, state, moments, pace, q, variance)
    }

    #[inline(always)]
    fn variance<L: Lane>(&self, s: &State<L>) -> L {
        s.p[0] + s.p[0] + s.p[1] + s.leaning.variance
    }

    fn covariance<T: Real>(&self, s: &State<T>) -> Sym3<f64> {
        let [x, y, z] = s.up.map(T::to_f64);
        let [tilt, heading] = [s.p[0].to_f64(), s.p[1].to_f64()];
        let along = (heading - tilt) / (x * x + y * y + z * z).max(1e-12);
        let whole = tilt + s.leaning.variance.to_f64() / 3.0;
        add_diagonal(&[along * x * x, along * x * y, along * x * z, along * y * y, along * y * z, along * z * z], whole)
    }

    fn widen<L: Lane>(&self, s: &mut State<L>, variance: L) {
        s.p[0] = s.p[0] + variance;
        s.p[1] = s.p[1] + variance;
    }
}

impl Complementary {
    /// Steps 1–4 of Algorithm 1 as printed: the gradient pairs this acceleration with the previous orientation, and eq. 5b adds
    /// corrected rates to first order.
    #[inline(always)]
    fn literal_step<L: Lane>(&self, ahead: &Ahead<L>, s: &mut State<L>, m: &Moment<L>, correct: bool) -> L {
        let (mut turn1, mut turn2) = (m.turn1, m.turn2);
        let mut step = L::splat(0.0);
        if correct {
            let correction = Correction::toward(expected(s.q, m), ahead);
            step = correction.step(s.q, m.dt).1;
            let [half1, half2] = Self::halves(s.q, correction.rate());
            turn1 = add(turn1, scale(half1, -m.dt));
            turn2 = add(turn2, scale(half2, -m.dt));
        }
        s.q = normalize(mul(mul(inverted(first_order(turn1)), s.q), first_order(turn2)));
        s.turn_up(turn2);
        step
    }

    /// The mean of a correction that persists is a bias of the gyroscopes: each takes its half.
    #[inline(always)]
    fn feed_back<L: Lane>(&self, s: &mut State<L>, rate: Vec3<L>, dt: L) {
        let [half1, half2] = Self::halves(s.q, rate);
        let gain = dt * L::splat(self.bias_gain);
        s.gyr_bias = [add(s.gyr_bias[0], scale(half1, gain)), add(s.gyr_bias[1], scale(half2, gain))];
    }
}
