//! The multiplicative extended Kalman filter on the link constraint (Weygers & Kok 2020, eq. 4 of Remmerswaal et al. 2021),
//! written for the relative orientation alone.
//!
//! The two orientations of the published filter enter the measurement only through `R = R1ᵀ R2`, its noise is the same about all
//! axes, and so its relative part is a filter of its own with a 3×3 covariance, an eighth of the work: the same estimates as
//! long as both sensors' accelerations nearly agree (the published H takes each sensor's own; this one that of sensor 2). In
//! frame 2, with `R = R̂ exp[η×]`: innovation `e = R̂ᵀa1 − a2 = −[a2×]η + noise`.

use serde::{Deserialize, Serialize};

use super::{
    algebra::{
        Sym3, Vec3, add, add_diagonal, congruence, cross, dot, exp, inverse, mul, normalize, rows_back, scale, sub, sym_times,
        trace,
    },
    lane::Lane,
    method::{Method, Tuning},
    state::{Moment, State},
};

/// What happens to an innovation that is larger than expected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Outliers {
    /// Nothing.
    Keep,
    /// The sample is skipped, as published.
    Reject,
    /// The sample counts less, the farther it is off.
    Downweight,
}

/// How the Kalman filter works.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mekf {
    /// What to do with outliers.
    pub outliers: Outliers,
    /// Squared normalised innovation (χ² of three degrees of freedom) from which on an innovation is an outlier.
    pub limit: f64,
    /// Whether the innovations set the measurement noise and the drift; else both stay as given, as published.
    pub adapt: bool,
}

impl Default for Mekf {
    fn default() -> Self {
        Self { outliers: Outliers::Downweight, limit: 5.0, adapt: true }
    }
}

/// Time constant of the memory that corrections are compared with, s.
const MEMORY_S: f64 = 0.1;
/// Time constant of their sizes, s.
const SIZE_S: f64 = 2.0;
/// How fast the drift follows, 1/s.
const DRIFT_RATE: f64 = 2.0;
/// Step at which that is so, s: with shorter steps noise hides more of the relation between two corrections.
const USUAL_STEP_S: f64 = 0.02;
/// Bounds of the factor on the drift.
const LEAST_DRIFT: f64 = 0.02;
const MOST_DRIFT: f64 = 4.5;
/// Variance of a sample that does not count, in variances of one that does.
const NOTHING: f64 = 1e9;

impl Mekf {
    /// By how much the variance of a sample grows that is `m2` off, squared and normalised.
    #[inline(always)]
    fn dilution<L: Lane>(&self, m2: L) -> L {
        let (limit, one) = (L::splat(self.limit), L::splat(1.0));
        match self.outliers {
            Outliers::Keep => one,
            Outliers::Reject => m2.where_above(limit, L::splat(NOTHING), one),
            Outliers::Downweight => (m2 * L::splat(1.0 / self.limit)).at_least(one),
        }
    }

    /// The corrections of a well-tuned filter are uncorrelated. Where one goes on in the direction of those before it, the
    /// orientation drifts more than assumed; where it undoes them, less (after Mehra 1970).
    #[inline(always)]
    fn follow_drift<L: Lane>(s: &mut State<L>, eta: Vec3<L>, dt: L) {
        let one = L::splat(1.0);
        let [first, second] = s.memory;
        let share = |seconds: f64| (dt * L::splat(1.0 / seconds)).at_most(one);
        let [size, past] = s.memory_size;
        s.memory_size = [size + (dot(eta, eta) - size) * share(SIZE_S), past + (dot(second, second) - past) * share(SIZE_S)];
        let scale_of = (s.memory_size[0] * s.memory_size[1] * dt * L::splat(1.0 / USUAL_STEP_S)).sqrt();
        let relation = dot(eta, second) / scale_of.at_least(L::splat(1e-30));
        let relation = relation.at_most(one).at_least(-one);
        let step = (dt * L::splat(DRIFT_RATE)).at_most(L::splat(0.5));
        s.drift = (s.drift + s.drift * step * relation).at_most(L::splat(MOST_DRIFT)).at_least(L::splat(LEAST_DRIFT));
        let first = add(first, scale(sub(eta, first), share(MEMORY_S)));
        s.memory = [first, add(second, scale(sub(first, second), share(MEMORY_S)))];
    }
}

/// `[a×] P [a×]ᵀ`.
#[inline(always)]
fn seen_by<L: Lane>(a: Vec3<L>, p: &Sym3<L>) -> Sym3<L> {
    let zero = L::splat(0.0);
    congruence(&[[zero, -a[2], a[1]], [a[2], zero, -a[0]], [-a[1], a[0], zero]], p)
}

impl Method for Mekf {
    const FULL_COVARIANCE: bool = true;

    #[inline(always)]
    fn begin<L: Lane>(&self, _: &mut State<L>) {}

    #[inline(always)]
    fn step<L: Lane>(&self, t: &Tuning<L>, s: &mut State<L>, m: &Moment<L>, correct: bool) {
        // Time update: the error turns with sensor 2.
        let step2 = s.turn(m.turn1, m.turn2);
        s.p = add_diagonal(&congruence(&rows_back(step2), &s.p), t.process(s.drift, m));
        if !correct {
            s.q = normalize(s.q);
            return;
        }
        // Innovation and its covariance S = H P Hᵀ + R with H = −[a2×].
        let seen = s.expected(m);
        let e = sub(seen, m.acc2);
        let error2 = dot(e, e);
        let known = seen_by(m.acc2, &s.p);
        let m2 = dot(e, sym_times(&inverse(&add_diagonal(&known, s.link_var)), e));
        let information = inverse(&add_diagonal(&known, s.link_slow_var * self.dilution(m2)));
        // η = P Hᵀ S⁻¹ e, with Hᵀ x = a2 × x.
        let eta = sym_times(&s.p, cross(m.acc2, sym_times(&information, e)));
        // P ← P − P Hᵀ S⁻¹ H P.
        let gain = congruence(&seen_rows(m.acc2, &s.p), &information);
        s.p = [s.p[0] - gain[0], s.p[1] - gain[1], s.p[2] - gain[2], s.p[3] - gain[3], s.p[4] - gain[4], s.p[5] - gain[5]];
        s.q = normalize(mul(s.q, exp(eta)));
        s.observe(m, seen, error2);
        if self.adapt {
            s.follow_link(m, e, error2, trace(&known) * L::splat(1.0 / 3.0));
            Self::follow_drift(s, eta, m.dt);
        }
    }

    #[inline(always)]
    fn variance<L: Lane>(&self, s: &State<L>) -> L {
        s.variance()
    }

    fn widen<L: Lane>(&self, s: &mut State<L>, variance: L) {
        s.p = add_diagonal(&s.p, variance);
    }
}

/// Rows of `P Hᵀ = P [a×]`: row i is `p_i × a`.
#[inline(always)]
fn seen_rows<L: Lane>(a: Vec3<L>, p: &Sym3<L>) -> [Vec3<L>; 3] {
    [cross([p[0], p[1], p[2]], a), cross([p[1], p[3], p[4]], a), cross([p[2], p[4], p[5]], a)]
}
