//! A sample's way through the complementary filter: means that need no orientation, the correction, what it teaches.

use super::{
    algebra::{Quat, Vec3, add, cross, dot, mul_vector, nearly_unit, scale, sub},
    complementary::Complementary,
    lane::Lane,
    method::Tuning,
    state::{Moment, State, Up, expected, share, turned},
};

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
    pub seen: Vec3<L>,
    pub step: L,
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
pub(super) struct Correction<L> {
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
    pub fn toward(seen: Vec3<L>, ahead: &Ahead<L>) -> Self {
        let Ahead { up, vertical, stretch, toward, sideways, soft, speed2, .. } = *ahead;
        // −Rᵀu: turning sensor 2 this way brings its acceleration onto that of sensor 1.
        let gradient = cross(toward, seen);
        let upwards = dot(seen, sideways);
        let plain = dot(gradient, gradient).at_least(L::splat(TINY));
        let square = (plain + upwards * upwards * stretch).at_least(L::splat(TINY));
        Self { direction: add(gradient, scale(up.up, upwards * vertical)), square, plain, soft, speed2 }
    }

    #[inline(always)]
    pub fn rate(&self) -> Vec3<L> {
        scale(self.direction, (self.speed2 * self.plain / ((self.plain + self.soft) * self.square)).sqrt())
    }

    /// `q` after its first-order step (eq. 5b), `(1, rate·dt/2)`, brought to length one: one division, and two roots beside it.
    /// And the step by itself, in directions.
    #[inline(always)]
    pub fn step(&self, q: Quat<L>, dt: L) -> (Quat<L>, L) {
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
    pub(super) fn heading_excess<L: Lane>(&self, up: &Up<L>) -> L {
        (up.square * L::splat(1.0 / (GRAVITY * GRAVITY))).at_most(L::splat(1.0)) * L::splat(self.heading_gain - 1.0)
    }

    /// Variance that a step adds about every axis, and what the limit allows for, rad²/s: white noise is known, and counts as in
    /// eq. 12; what grows with motion may be more.
    #[inline(always)]
    pub(super) fn drift<L: Lane>(&self, t: &Tuning<L>, m: &Moment<L>) -> [L; 2] {
        [t.process(L::splat(1.0), m), t.process(L::splat(self.drift_limit), m) * m.per_dt]
    }

    /// Square of the correction's full speed (eq. 12): as fast as β says, and no faster than the drift asks for.
    #[inline(always)]
    pub(super) fn speed2<L: Lane>(&self, t: &Tuning<L>, m: &Moment<L>, diffusion: L, boost: L) -> L {
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
    pub(super) fn prepared<L: Lane>(&self, m: &Moment<L>, [spread, speed2]: [L; 2], up: Up<L>, excess: L) -> Ahead<L> {
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
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn ahead<L: Lane>(&self, t: &Tuning<L>, m: &Moment<L>, [spread, _]: [L; 2], trail: &Trail<L>) -> Ahead<L> {
        let up = Up::of(trail.up, m);
        self.prepared(m, [spread, self.speed2(t, m, trail.diffusion, trail.boost)], up, self.heading_excess(&up))
    }

    /// The orientation after the sample, from that before: what the next one waits for.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn corrected<L: Lane>(&self, q: Quat<L>, m: &Moment<L>, ahead: &Ahead<L>) -> (Quat<L>, Seen<L>) {
        let q = turned(q, m);
        let seen = expected(q, m);
        let (q, step) = Correction::toward(seen, ahead).step(nearly_unit(q), m.dt);
        (q, Seen { seen, step })
    }

    /// What it teaches.
    #[cfg_attr(not(debug_assertions), inline(always))]
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
    pub(super) fn learn<L: Lane>(&self, t: &Tuning<L>, s: &mut State<L>, m: &Moment<L>, ahead: &Ahead<L>, now: &Seen<L>) {
        self.absorb(s, m, &self.lesson(m, ahead, now));
        if s.leaning.wait(m) {
            self.lean(t, s, m, ahead, now);
        }
    }
}
