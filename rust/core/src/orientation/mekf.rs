//! The multiplicative extended Kalman filter on the link constraint (Weygers & Kok 2020, eq. 4 of Remmerswaal et al. 2021),
//! written for the relative orientation alone.
//!
//! The two orientations of the published filter enter the measurement only through `R = R1ᵀ R2`, its noise is the same about all
//! axes, and so its relative part is a filter of its own with a 3×3 covariance, an eighth of the work: the same estimates as
//! long as both sensors' accelerations nearly agree (the published H takes each sensor's own; this one that of sensor 2). In
//! frame 2, with `R = R̂ exp[η×]`: innovation `e = R̂ᵀa1 − a2 = −[a2×]η + noise`. It says nothing of η along a2, so S has two
//! dimensions, not three.

use serde::{Deserialize, Serialize};

use super::{
    algebra::{
        Sym3, Vec3, add, add_diagonal, congruence, cross, dot, exp, mul, nearly_unit, normalize, rows_back, scale, sub,
        sym_times,
    },
    lane::{Lane, Real},
    method::{Method, Tuning},
    state::{Moment, State, Up, expected, share, turned},
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
/// Below this square of an acceleration, (m/s²)², nothing is shown.
const LEAST_LEVEL: f64 = 1e-12;

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
        let [size, past] = s.memory_size;
        let slow = share(dt, SIZE_S);
        s.memory_size = [size + (dot(eta, eta) - size) * slow, past + (dot(second, second) - past) * slow];
        let scale_of = (s.memory_size[0] * s.memory_size[1] * dt * L::splat(1.0 / USUAL_STEP_S)).sqrt();
        let relation = dot(eta, second) / scale_of.at_least(L::splat(1e-30));
        let relation = relation.at_most(one).at_least(-one);
        let step = (dt * L::splat(DRIFT_RATE)).at_most(L::splat(0.5));
        s.drift = (s.drift + s.drift * step * relation).at_most(L::splat(MOST_DRIFT)).at_least(L::splat(LEAST_DRIFT));
        let quick = share(dt, MEMORY_S);
        let first = add(first, scale(sub(eta, first), quick));
        s.memory = [first, add(second, scale(sub(first, second), quick))];
    }
}

/// xx, xy, yy.
type Sym2<L> = [L; 3];

/// Two unit vectors at right angles to `a` and to each other, of its reciprocal length (Duff et al. 2017).
#[inline(always)]
fn plane_across<L: Lane>(a: Vec3<L>, per_length: L) -> [Vec3<L>; 2] {
    let one = L::splat(1.0);
    let [x, y, z] = scale(a, per_length);
    let sign = z.where_above(L::splat(0.0), one, -one);
    let k = -(one / (sign + z));
    let xy = x * y * k;
    [[one + sign * (x * x * k), sign * xy, -(sign * x)], [xy, sign + y * y * k, -y]]
}

#[inline(always)]
fn with_noise<L: Lane>(m: &Sym2<L>, variance: L) -> Sym2<L> {
    [m[0] + variance, m[1], m[2] + variance]
}

/// `xᵀ M⁻¹ x`.
#[inline(always)]
fn square_over<L: Lane>(m: &Sym2<L>, [x, y]: [L; 2]) -> L {
    let xy = m[1] * (x * y);
    (m[2] * (x * x) - (xy + xy) + m[0] * (y * y)) / (m[0] * m[2] - m[1] * m[1])
}

#[inline(always)]
fn inverse2<L: Lane>(m: &Sym2<L>) -> Sym2<L> {
    let scale = L::splat(1.0) / (m[0] * m[2] - m[1] * m[1]);
    [m[2] * scale, -(m[1] * scale), m[0] * scale]
}

/// `P − a bᵀ`, where that is symmetric or will be.
#[inline(always)]
fn less_product<L: Lane>(p: &Sym3<L>, a: Vec3<L>, b: Vec3<L>) -> Sym3<L> {
    [p[0] - a[0] * b[0], p[1] - a[0] * b[1], p[2] - a[0] * b[2], p[3] - a[1] * b[1], p[4] - a[1] * b[2], p[5] - a[2] * b[2]]
}

/// `Σ by[i] v[i]`.
#[inline(always)]
fn together<L: Lane>(v: &[Vec3<L>; 2], by: [L; 2]) -> Vec3<L> {
    add(scale(v[0], by[0]), scale(v[1], by[1]))
}

impl Method for Mekf {
    const FULL_COVARIANCE: bool = true;

    #[inline(always)]
    fn begin<L: Lane>(&self, _: &mut State<L>) {}

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn step<L: Lane>(&self, t: &Tuning<L>, s: &mut State<L>, m: &Moment<L>, correct: bool) {
        // Time update: the error turns with sensor 2.
        s.q = turned(s.q, m);
        s.turn_up(m.turn2);
        s.p = add_diagonal(&congruence(&rows_back(m.step[1]), &s.p), t.process(s.drift, m));
        let leans = s.leaning.wait(m);
        if !correct {
            s.q = normalize(s.q);
            return;
        }
        // Innovation: of η it shows the part across a2, a2 × e/a2², each of whose two components has the variance R/a2².
        let seen = expected(s.q, m);
        let e = sub(seen, m.acc2);
        let error2 = dot(e, e);
        let level = m.level[1].at_least(L::splat(LEAST_LEVEL));
        let per_level = L::splat(1.0) / level;
        let across = plane_across(m.acc2, level.sqrt() * per_level);
        let shown = scale(cross(m.acc2, e), per_level);
        let shown = [dot(across[0], shown), dot(across[1], shown)];
        // P Hᵀ and H P Hᵀ, where the rows of H are the two directions across a2.
        let ph = [sym_times(&s.p, across[0]), sym_times(&s.p, across[1])];
        let known = [dot(across[0], ph[0]), dot(across[0], ph[1]), dot(across[1], ph[1])];
        // How far off it is; no turn explains a difference in length.
        let length2 = (error2 - (shown[0] * shown[0] + shown[1] * shown[1]) * level).at_least(L::splat(0.0));
        let m2 = length2 / s.link_var + square_over(&with_noise(&known, s.link_var * per_level), shown);
        // K = P Hᵀ S⁻¹, η = K · shown, P ← P − K H P.
        let information = inverse2(&with_noise(&known, s.link_slow_var * self.dilution(m2) * per_level));
        let gain = [together(&ph, [information[0], information[1]]), together(&ph, [information[1], information[2]])];
        let eta = together(&gain, shown);
        s.p = less_product(&less_product(&s.p, gain[0], ph[0]), gain[1], ph[1]);
        s.q = mul(nearly_unit(s.q), exp(eta));
        if leans {
            let pull = [0, 1, 2].map(|r| together(&across, [gain[0][r], gain[1][r]]));
            s.leaning.update(m.per_dt, &pull, t.bias_var);
        }
        s.follow_up(m);
        let up = Up::of(s.up, m);
        s.observe(m, up.flat, up.watched(m, seen, error2));
        if self.adapt {
            s.follow_link(m, e, error2, [known[0] + known[2], level * L::splat(1.0 / 3.0)]);
            Self::follow_drift(s, eta, m.dt);
        }
    }

    #[inline(always)]
    fn variance<L: Lane>(&self, s: &State<L>) -> L {
        s.variance() + s.leaning.variance
    }

    fn covariance<T: Real>(&self, s: &State<T>) -> Sym3<f64> {
        add_diagonal(&s.p.map(T::to_f64), s.leaning.variance.to_f64() / 3.0)
    }

    fn widen<L: Lane>(&self, s: &mut State<L>, variance: L) {
        s.p = add_diagonal(&s.p, variance);
    }
}
