//! The complementary filter: Algorithm 1 of Remmerswaal et al. 2021, written in one sensor's frame.
//!
//! Only the relative orientation enters the cost (eq. 10). With `u = a1 × R a2` in frame 1 the gradient (eq. 13) is
//! `(−u, Rᵀu)`, its norm `√2·‖u‖`, and eqs 5, 8, 9 and 12 become one quaternion product: half the work of the literal form, and
//! the same numbers.

use serde::{Deserialize, Serialize};

use super::{
    algebra::{
        Quat, Sym3, Vec3, add, add_diagonal, cross, dot, first_order, inverted, mul, nearly_unit, normalize, rotate_back,
        scale, sub,
    },
    filter::alarm,
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
/// Time constant of the drift that the limit is taken from, s.
const DIFFUSION_S: f64 = 1.0;
/// m/s².
const GRAVITY: f64 = 9.81;
/// Below this square of a cross product of accelerations, g⁴, there is no direction to correct in.
const TINY: f64 = 1e-12;

/// What is known of a sample before its orientation.
#[derive(Clone, Copy)]
struct Ahead<L> {
    /// Variance that drift adds about every axis, rad².
    spread: L,
    /// Square of the correction's full speed, (rad/s)².
    speed2: L,
    up: Up<L>,
    /// [`Complementary::heading_excess`].
    excess: L,
}

/// What a correction shows: the acceleration of sensor 1 as sensor 2 should see it, and the size of the step.
#[derive(Clone, Copy)]
struct Seen<L> {
    seen: Vec3<L>,
    step: L,
}

/// A correction: by how fast sensor 2 turns against sensor 1, `√(speed2·plain/((plain + level)·square))·direction` in frame 2,
/// rad/s.
struct Correction<L> {
    /// Along the gradient, g².
    direction: Vec3<L>,
    /// Its square, g⁴.
    square: L,
    /// Square of the gradient, and that at which the step has 0.7 of its size, g⁴.
    plain: L,
    level: L,
    /// Square of the full speed, (rad/s)².
    speed2: L,
}

impl<L: Lane> Correction<L> {
    /// The same with a gradient whose part about the vertical counts `excess` times more.
    #[inline(always)]
    fn about(mut self, up: &Up<L>, excess: L) -> Self {
        let (upwards, vertical) = (dot(self.direction, up.up), excess * up.per_square);
        self.direction = add(self.direction, scale(up.up, upwards * vertical));
        self.square = (self.square + upwards * upwards * (vertical * (excess + L::splat(2.0)))).at_least(L::splat(TINY));
        self
    }

    #[inline(always)]
    fn rate(&self) -> Vec3<L> {
        scale(self.direction, (self.speed2 * self.plain / ((self.plain + self.level) * self.square)).sqrt())
    }

    /// Its first-order step (eq. 5b), `(1, rate·dt/2)`, brought to length one: one division, and two roots beside it. And the step
    /// by itself, in directions.
    #[inline(always)]
    fn step(&self, dt: L) -> (Quat<L>, L) {
        let over = self.speed2 * (dt * dt * L::splat(0.25)) * self.plain;
        let under = self.plain + self.level;
        let whole = under + over;
        let both = self.square * whole;
        let per_both = L::splat(1.0) / both;
        let half = (over * both).sqrt() * per_both;
        let [x, y, z] = scale(self.direction, half);
        ([(under * whole).sqrt() * (self.square * per_both), x, y, z], (half + half) * L::splat(1.0 / (GRAVITY * GRAVITY)))
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

    /// Variance that a step adds about every axis, and the square of the correction's full speed (eq. 12): as fast as β says, and
    /// no faster than the drift asks for.
    #[inline(always)]
    fn drifts<L: Lane>(&self, t: &Tuning<L>, s: &mut State<L>, m: &Moment<L>) -> [L; 2] {
        // White noise is known, and counts as in eq. 12; of what grows with motion the limit allows for more.
        let allowed = t.process(L::splat(self.drift_limit), m);
        s.diffusion = s.diffusion + (allowed * m.per_dt - s.diffusion) * share(m.dt, DIFFUSION_S);
        // Each sensor takes β/√2; together they turn by √2·β.
        let beta = L::splat(self.beta);
        let mut speed2 = beta * beta * L::splat(2.0);
        if self.drift_limit > 0.0 {
            let bias_var = t.bias_var * L::splat(self.drift_limit * self.drift_limit);
            speed2 = speed2.at_most((s.diffusion * m.per_dt + bias_var) * L::splat(3.0));
        }
        [t.process(L::splat(1.0), m), speed2 + s.boost * (beta + beta + s.boost) * L::splat(2.0)]
    }

    /// Eq. 13: along the gradient.
    #[inline(always)]
    fn correction<L: Lane>(&self, speed2: L, m: &Moment<L>, seen: Vec3<L>) -> Correction<L> {
        // −Rᵀu: turning sensor 2 this way brings its acceleration onto that of sensor 1.
        let direction = cross(scale(m.acc2, L::splat(1.0 / (GRAVITY * GRAVITY))), seen);
        let plain = dot(direction, direction).at_least(L::splat(TINY));
        let soft = self.soft_angle / (GRAVITY * GRAVITY);
        let level = m.level[0] * m.level[1] * L::splat(soft * soft);
        Correction { direction, square: plain, plain, level, speed2 }
    }

    /// All of a sample that needs no orientation.
    #[inline(always)]
    fn look_ahead<L: Lane>(&self, t: &Tuning<L>, s: &mut State<L>, m: &Moment<L>) -> Ahead<L> {
        let [spread, speed2] = self.drifts(t, s, m);
        s.boost = s.boost - s.boost * share(m.dt, self.settle_s);
        s.turn_up(m.turn2);
        let up = s.look_up(m);
        Ahead { spread, speed2, up, excess: self.heading_excess(&up) }
    }

    /// The orientation after the sample, from that before: what the next one waits for.
    #[inline(always)]
    fn corrected<L: Lane>(&self, q: Quat<L>, m: &Moment<L>, ahead: &Ahead<L>) -> (Quat<L>, Seen<L>) {
        let q = turned(q, m);
        let seen = expected(q, m);
        let (by, step) = self.correction(ahead.speed2, m, seen).about(&ahead.up, ahead.excess).step(m.dt);
        (mul(nearly_unit(q), by), Seen { seen, step })
    }

    /// What the sample teaches besides.
    #[inline(always)]
    fn learn<L: Lane>(&self, t: &Tuning<L>, s: &mut State<L>, m: &Moment<L>, ahead: &Ahead<L>, now: &Seen<L>) {
        let (Ahead { spread, up, excess, .. }, Seen { seen, step }) = (*ahead, *now);
        let error = sub(seen, m.acc2);
        let error2 = dot(error, error);
        s.observe(m, &up, seen, error2);
        // Tilt is seen by the whole acceleration, heading by its horizontal part; of the error η a correction takes `KHη`, with
        // `KH = step (I + (gain − 1) up alongᵀ)(a² I − a aᵀ)`, and it brings in noise: `(I − KH)P(I − KH)ᵀ + KRKᵀ`.
        let one = L::splat(1.0);
        let [tilt, heading] = [s.p[0] + spread, s.p[1] + spread];
        let level = m.level[1];
        s.follow_link(m, error, error2, tilt * level * L::splat(2.0 / 3.0));
        let turn = step * (one + excess);
        let (left, left_heading) = (one - (step * level).at_most(one), one - (turn * up.flat).at_most(one));
        s.p[0] = tilt * (left * left) + step * step * (level * s.link_slow_var);
        s.p[1] = heading * (left_heading * left_heading) + turn * turn * (up.flat * s.link_slow_var);
        if s.leaning.wait(m) {
            let a = m.acc2;
            let seen_along = scale(sub(scale(up.up, level), scale(a, dot(a, up.up))), excess * up.per_square);
            let mut pull = [a; 3];
            for (r, row) in pull.iter_mut().enumerate() {
                *row = sub(scale(seen_along, up.up[r]), scale(a, a[r]));
                row[r] = row[r] + level;
                *row = scale(*row, step);
            }
            s.leaning.update(m.per_dt, &pull, t.bias_var);
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
            let ahead = self.look_ahead(t, s, m);
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
        let [spread, speed2] = self.drifts(t, s, &m);
        let mut step = L::splat(0.0);
        if self.literal {
            step = self.literal_step(speed2, s, &m, correct);
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
        let up = s.look_up(&m);
        let mut excess = L::splat(0.0);
        if !self.literal {
            excess = self.heading_excess(&up);
            let correction = self.correction(speed2, &m, seen).about(&up, excess);
            if self.bias_gain > 0.0 {
                self.feed_back(s, correction.rate(), m.dt);
            }
            let turned;
            (turned, step) = correction.step(m.dt);
            s.q = mul(nearly_unit(s.q), turned);
            s.boost = s.boost - s.boost * share(m.dt, self.settle_s);
        }
        self.learn(t, s, &m, &Ahead { spread, speed2, up, excess }, &Seen { seen, step });
    }

    #[inline(always)]
    fn follow<T: Real>(
        &self,
        t: &Tuning<T>,
        state: &mut State<T>,
        moment: impl Fn(usize) -> Moment<T>,
        all_q: &mut [Quat<T>],
        variances: &mut [T],
    ) -> Option<usize> {
        if !self.looks_ahead() || all_q.is_empty() {
            return follow_in_turn(self, t, state, moment, all_q, variances);
        }
        // What a sample teaches is worked out while the correction of the next one waits for its roots.
        let before = *state;
        let last = all_q.len() - 1;
        let variances = &mut variances[..=last];
        let mut ahead = self.look_ahead(t, state, &moment(0));
        let (mut q, mut seen) = self.corrected(state.q, &moment(0), &ahead);
        let mut alarmed = false;
        for row in 0..=last {
            all_q[row] = q;
            let (now, known, w) = (seen, ahead, q[0]);
            if row < last {
                ahead = self.look_ahead(t, state, &moment(row + 1));
                (q, seen) = self.corrected(q, &moment(row + 1), &ahead);
            }
            self.learn(t, state, &moment(row), &known, &now);
            variances[row] = self.variance(state);
            alarmed |= alarm(state.watch, w);
        }
        state.q = q;
        if !alarmed {
            return None;
        }
        *state = before;
        follow_in_turn(self, t, state, moment, all_q, variances)
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
    fn literal_step<L: Lane>(&self, speed2: L, s: &mut State<L>, m: &Moment<L>, correct: bool) -> L {
        let (mut turn1, mut turn2) = (m.turn1, m.turn2);
        let mut step = L::splat(0.0);
        if correct {
            let correction = self.correction(speed2, m, expected(s.q, m));
            step = correction.step(m.dt).1;
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
