//! The complementary filter: Algorithm 1 of Remmerswaal et al. 2021, written in one sensor's frame.
//!
//! Only the relative orientation enters the cost (eq. 10). With `u = a1 × R a2` in frame 1 the gradient (eq. 13) is
//! `(−u, Rᵀu)`, its norm `√2·‖u‖`, and eqs 5, 8, 9 and 12 become one quaternion product: half the work of the literal form, and
//! the same numbers.

use serde::{Deserialize, Serialize};

use super::{
    algebra::{
        Quat, Sym3, Vec3, add, add_diagonal, cross, dot, first_order, inverted, mul, mul_vector, nearly_unit, normalize,
        rotate_back, scale, sub,
    },
    eight::{EIGHT, Eight},
    interleaved,
    lane::{Lane, Real},
    method::{Method, Tuning, follow_in_turn},
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
/// m/s².
const GRAVITY: f64 = 9.81;
/// Below this square of a cross product of accelerations, g⁴, there is no direction to correct in.
const TINY: f64 = 1e-12;

/// Means as they are at a sample: up, what drift adds, what is left of the larger gain.
#[derive(Clone, Copy)]
pub(super) struct Trail<L> {
    up: Vec3<L>,
    diffusion: L,
    boost: L,
}

/// What is known of a sample before its orientation.
#[derive(Clone, Copy)]
pub(super) struct Ahead<L> {
    /// Variance that drift adds about every axis, rad².
    spread: L,
    up: Up<L>,
    /// So many times more the gradient's part about the vertical counts, and that per square of [`Up::up`].
    excess: L,
    vertical: L,
    /// What that adds to the gradient's square, for the square of its part along [`Up::up`].
    stretch: L,
    /// Acceleration of sensor 2 per square of gravity, and `up ×` that.
    toward: Vec3<L>,
    sideways: Vec3<L>,
    /// Square of the gradient at which the step has 0.7 of its size, g⁴.
    soft: L,
    /// Square of the full speed, (rad/s)².
    speed2: L,
}

/// What a correction shows: the acceleration of sensor 1 as sensor 2 should see it, and the size of the step.
#[derive(Clone, Copy)]
pub(super) struct Seen<L> {
    seen: Vec3<L>,
    step: L,
}

/// What that teaches, with nothing of earlier samples in it.
#[derive(Clone, Copy)]
pub(super) struct Lesson<L> {
    /// The link residual and its square.
    error: Vec3<L>,
    error2: L,
    /// Squares of the acceleration of sensor 2, and of its horizontal part.
    level: L,
    flat: L,
    /// [`Up::watched`].
    watched: [L; 2],
    /// Variance that is new, and of tilt and heading: which part of it stays, and what comes per variance of the link.
    spread: L,
    left: [L; 2],
    noise: [L; 2],
}

impl<L: Copy> Trail<L> {
    #[inline(always)]
    pub fn numbers(&self) -> [L; 5] {
        let Self { up: [x, y, z], diffusion, boost } = *self;
        [x, y, z, diffusion, boost]
    }

    #[inline(always)]
    pub fn from_numbers([x, y, z, diffusion, boost]: [L; 5]) -> Self {
        Self { up: [x, y, z], diffusion, boost }
    }
}

impl<L: Copy> Ahead<L> {
    #[inline(always)]
    pub fn numbers(&self) -> [L; 18] {
        let Self { spread, up: u, excess, vertical, stretch, toward: [a, b, c], sideways: [d, e, f], soft, speed2 } = *self;
        let Up { up: [x, y, z], square, per_square, flat } = u;
        [spread, x, y, z, square, per_square, flat, excess, vertical, stretch, a, b, c, d, e, f, soft, speed2]
    }

    #[inline(always)]
    pub fn from_numbers(numbers: [L; 18]) -> Self {
        let [spread, x, y, z, square, per_square, flat, excess, vertical, stretch, a, b, c, d, e, f, soft, speed2] = numbers;
        let up = Up { up: [x, y, z], square, per_square, flat };
        Self { spread, up, excess, vertical, stretch, toward: [a, b, c], sideways: [d, e, f], soft, speed2 }
    }
}

impl<L: Copy> Seen<L> {
    #[inline(always)]
    pub fn numbers(&self) -> [L; 4] {
        let Self { seen: [x, y, z], step } = *self;
        [x, y, z, step]
    }

    #[inline(always)]
    pub fn from_numbers([x, y, z, step]: [L; 4]) -> Self {
        Self { seen: [x, y, z], step }
    }
}

impl<L: Copy> Lesson<L> {
    #[inline(always)]
    pub fn numbers(&self) -> [L; 13] {
        let Self { error: [x, y, z], error2, level, flat, watched: [a, b], spread, left: [c, d], noise: [e, f] } = *self;
        [x, y, z, error2, level, flat, a, b, spread, c, d, e, f]
    }

    #[inline(always)]
    pub fn from_numbers([x, y, z, error2, level, flat, a, b, spread, c, d, e, f]: [L; 13]) -> Self {
        Self { error: [x, y, z], error2, level, flat, watched: [a, b], spread, left: [c, d], noise: [e, f] }
    }
}

/// A correction: by how fast sensor 2 turns against sensor 1, `√(speed2·plain/((plain + soft)·square))·direction` in frame 2,
/// rad/s.
struct Correction<L> {
    /// Along the gradient, g².
    direction: Vec3<L>,
    /// Its square, g⁴.
    square: L,
    /// Square of the gradient whose part about the vertical does not count more, g⁴.
    plain: L,
    soft: L,
    speed2: L,
}

impl<L: Lane> Correction<L> {
    /// Eq. 13: along the gradient.
    #[inline(always)]
    fn toward(seen: Vec3<L>, ahead: &Ahead<L>) -> Self {
        let Ahead { up, vertical, stretch, toward, sideways, soft, speed2, .. } = *ahead;
        // −Rᵀu: turning sensor 2 this way brings its acceleration onto that of sensor 1.
        let gradient = cross(toward, seen);
        let upwards = dot(seen, sideways);
        let plain = dot(gradient, gradient).at_least(L::splat(TINY));
        let square = (plain + upwards * upwards * stretch).at_least(L::splat(TINY));
        Self { direction: add(gradient, scale(up.up, upwards * vertical)), square, plain, soft, speed2 }
    }

    #[inline(always)]
    fn rate(&self) -> Vec3<L> {
        scale(self.direction, (self.speed2 * self.plain / ((self.plain + self.soft) * self.square)).sqrt())
    }

    /// `q` after its first-order step (eq. 5b), `(1, rate·dt/2)`, brought to length one: one division, and two roots beside it.
    /// And the step by itself, in directions.
    #[inline(always)]
    fn step(&self, q: Quat<L>, dt: L) -> (Quat<L>, L) {
        let over = self.speed2 * (dt * dt * L::splat(0.25)) * self.plain;
        let under = self.plain + self.soft;
        let whole = under + over;
        let both = self.square * whole;
        let per_both = L::splat(1.0) / both;
        let half = (over * both).sqrt() * per_both;
        let kept = (under * whole).sqrt() * (self.square * per_both);
        // The product is there before the roots are.
        let turn = mul_vector(q, self.direction);
        let step = (half + half) * L::splat(1.0 / (GRAVITY * GRAVITY));
        let new = |k: usize| q[k] * kept + turn[k] * half;
        ([new(0), new(1), new(2), new(3)], step)
    }
}

impl Complementary {
    /// How many times more the gradient's part about the vertical counts; where accelerations have no common direction, not at
    /// all.
    #[inline(always)]
    fn heading_excess<L: Lane>(&self, up: &Up<L>) -> L {
        (up.square * L::splat(1.0 / (GRAVITY * GRAVITY))).at_most(L::splat(1.0)) * L::splat(self.heading_gain - 1.0)
    }

    /// Whether all but the correction can be worked out without the orientation.
    #[inline(always)]
    fn looks_ahead(&self) -> bool {
        !self.literal && self.bias_gain == 0.0
    }

    /// Variance that a step adds about every axis, and what the limit allows for, rad²/s: white noise is known, and counts as in
    /// eq. 12; what grows with motion may be more.
    #[inline(always)]
    pub(super) fn drift<L: Lane>(&self, t: &Tuning<L>, m: &Moment<L>) -> [L; 2] {
        [t.process(L::splat(1.0), m), t.process(L::splat(self.drift_limit), m) * m.per_dt]
    }

    /// Square of the correction's full speed (eq. 12): as fast as β says, and no faster than the drift asks for.
    #[inline(always)]
    fn speed2<L: Lane>(&self, t: &Tuning<L>, m: &Moment<L>, diffusion: L, boost: L) -> L {
        // Each sensor takes β/√2; together they turn by √2·β.
        let beta = L::splat(self.beta);
        let mut speed2 = beta * beta * L::splat(2.0);
        if self.drift_limit > 0.0 {
            let bias_var = t.bias_var * L::splat(self.drift_limit * self.drift_limit);
            speed2 = speed2.at_most((diffusion * m.per_dt + bias_var) * L::splat(3.0));
        }
        speed2 + boost * (beta + beta + boost) * L::splat(2.0)
    }

    /// What a correction needs.
    #[inline(always)]
    fn prepared<L: Lane>(&self, m: &Moment<L>, [spread, speed2]: [L; 2], up: Up<L>, excess: L) -> Ahead<L> {
        let toward = scale(m.acc2, L::splat(1.0 / (GRAVITY * GRAVITY)));
        let vertical = excess * up.per_square;
        let soft = self.soft_angle / (GRAVITY * GRAVITY);
        Ahead {
            spread,
            up,
            excess,
            vertical,
            stretch: vertical * (excess + L::splat(2.0)),
            toward,
            sideways: cross(up.up, toward),
            soft: m.level[0] * m.level[1] * L::splat(soft * soft),
            speed2,
        }
    }

    /// Brings the means that need no orientation to the sample.
    #[inline(always)]
    pub(super) fn trail<L: Lane>(&self, s: &mut State<L>, m: &Moment<L>, allowed: L) -> Trail<L> {
        s.follow_drift(m, allowed);
        let boost = s.boost;
        s.boost = boost - boost * share(m.dt, self.settle_s);
        s.turn_up(m.turn2);
        s.follow_up(m);
        Trail { up: s.up, diffusion: s.diffusion, boost }
    }

    /// All of a sample that needs no orientation.
    #[inline(always)]
    pub(super) fn ahead<L: Lane>(&self, t: &Tuning<L>, m: &Moment<L>, [spread, _]: [L; 2], trail: &Trail<L>) -> Ahead<L> {
        let up = Up::of(trail.up, m);
        self.prepared(m, [spread, self.speed2(t, m, trail.diffusion, trail.boost)], up, self.heading_excess(&up))
    }

    /// The orientation after the sample, from that before: what the next one waits for.
    #[inline(always)]
    pub(super) fn corrected<L: Lane>(&self, q: Quat<L>, m: &Moment<L>, ahead: &Ahead<L>) -> (Quat<L>, Seen<L>) {
        let q = turned(q, m);
        let seen = expected(q, m);
        let (q, step) = Correction::toward(seen, ahead).step(nearly_unit(q), m.dt);
        (q, Seen { seen, step })
    }

    /// What it teaches.
    #[inline(always)]
    pub(super) fn lesson<L: Lane>(&self, m: &Moment<L>, ahead: &Ahead<L>, now: &Seen<L>) -> Lesson<L> {
        let (Ahead { spread, up, excess, .. }, Seen { seen, step }) = (*ahead, *now);
        let error = sub(seen, m.acc2);
        let error2 = dot(error, error);
        // Tilt is seen by the whole acceleration, heading by its horizontal part; of the error η a correction takes `KHη`, with
        // `KH = step (I + (gain − 1) up alongᵀ)(a² I − a aᵀ)`, and it brings in noise: `(I − KH)P(I − KH)ᵀ + KRKᵀ`.
        let one = L::splat(1.0);
        let level = m.level[1];
        let turn = step * (one + excess);
        let left = [one - (step * level).at_most(one), one - (turn * up.flat).at_most(one)];
        Lesson {
            error,
            error2,
            level,
            flat: up.flat,
            watched: up.watched(m, seen, error2),
            spread,
            left: [left[0] * left[0], left[1] * left[1]],
            noise: [step * step * level, turn * turn * up.flat],
        }
    }

    /// Takes it in.
    #[inline(always)]
    pub(super) fn absorb<L: Lane>(&self, s: &mut State<L>, m: &Moment<L>, lesson: &Lesson<L>) {
        let Lesson { error, error2, level, flat, watched, spread, left, noise } = *lesson;
        s.observe(m, flat, watched);
        let [tilt, heading] = [s.p[0] + spread, s.p[1] + spread];
        s.follow_link(m, error, error2, [tilt, level * L::splat(2.0 / 3.0)]);
        s.p[0] = tilt * left[0] + noise[0] * s.link_slow_var;
        s.p[1] = heading * left[1] + noise[1] * s.link_slow_var;
    }

    /// Brings [`State::leaning`] up to date.
    #[inline(always)]
    pub(super) fn lean<L: Lane>(&self, t: &Tuning<L>, s: &mut State<L>, m: &Moment<L>, ahead: &Ahead<L>, now: &Seen<L>) {
        let (Ahead { up, excess, .. }, a, level) = (*ahead, m.acc2, m.level[1]);
        let seen_along = scale(sub(scale(up.up, level), scale(a, dot(a, up.up))), excess * up.per_square);
        let mut pull = [a; 3];
        for (r, row) in pull.iter_mut().enumerate() {
            *row = sub(scale(seen_along, up.up[r]), scale(a, a[r]));
            row[r] = row[r] + level;
            *row = scale(*row, now.step);
        }
        s.leaning.update(m.per_dt, &pull, t.bias_var);
    }

    #[inline(always)]
    fn learn<L: Lane>(&self, t: &Tuning<L>, s: &mut State<L>, m: &Moment<L>, ahead: &Ahead<L>, now: &Seen<L>) {
        self.absorb(s, m, &self.lesson(m, ahead, now));
        if s.leaning.wait(m) {
            self.lean(t, s, m, ahead, now);
        }
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

    #[inline(always)]
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
