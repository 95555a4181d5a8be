//! Where a filter starts: the closed form over the first seconds.
//!
//! Each gyroscope alone carries its sensor's orientation from the first instant on. What is missing is one constant rotation
//! between the two, and it solves Wahba's problem: the joint centre's acceleration, seen by both sensors, is the same vector. The
//! largest eigenvector of a 4×4 matrix gives it (Horn 1987), without a first guess. How long the window must be is told by
//! the data: the curvature of `Σ w xᵀ R y` is small in a direction that the motion has not shown yet. Noise adds nothing to it,
//! for that of the two sensors has nothing in common; `Σ [y×]ᵀ[y×]` would take noise for motion.

use nalgebra::{ComplexField, Matrix3, Matrix4, SymmetricEigen, Vector3};
use serde::{Deserialize, Serialize};

use super::algebra::{Quat, Sym3, Vec3, add_diagonal, congruence, exp, mul, normalize, rotate_back, rows_back, trace};

/// An orientation and the covariance of its error, rad², in the frame of sensor 2.
pub type Oriented = (Quat<f64>, Sym3<f64>);

/// The sums of one window.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Start {
    /// Orientation of each sensor now against its own at the beginning.
    turned: [Quat<f64>; 2],
    /// `Σ w x yᵀ` of the accelerations in the frames of the beginning; a sample weighs its `dt`, or less.
    products: [Vec3<f64>; 3],
    /// `Σ w (x² + y²)`, `Σ w` and `Σ w age`.
    power: f64,
    weight: f64,
    aged: f64,
    /// What the gyroscopes have drifted apart meanwhile, rad².
    drift: f64,
    /// Length of the window so far, s, and since its sums were last looked at.
    elapsed_s: f64,
    unseen_s: f64,
    /// Old instants fade with this time constant, s: the drift makes them worthless.
    fade_s: f64,
    /// Variance of the bias of the relative rate, one axis, (rad/s)².
    bias_var: f64,
}

/// Noise of the link residual in a start, (m/s²)²·s: 0.45 m/s² at 50 Hz, generous, as neighbours err alike.
const NOISE_DENSITY: f64 = 0.004;
/// What is left of the residual counts as alike over so long, s.
const ALIKE_S: f64 = 0.025;
/// So many standard deviations of what noise feigns are taken off.
const FEIGNED: f64 = 3.0;
/// Knowing nothing, a rotation angle about one axis has this variance: uniform in ±π.
const NOTHING_KNOWN: f64 = core::f64::consts::PI * core::f64::consts::PI / 3.0;
/// Where the two accelerations differ in length by this, m/s², no rotation explains it and the instant counts half.
const MISFIT: f64 = 1.0;
/// A start may end with this many times the wanted variance when waiting does not help.
const NEARLY: f64 = 9.0;
/// What a bound keeps of itself for rounding.
const NEARLY_ALL: f64 = 0.99;
/// Weight, against the data, of leaving undetermined directions as the shortest rotation leaves them.
const PREFERENCE: f64 = 1e-9;
/// The sums are looked at so often, s; no multiple of usual steps, lest rounding decides.
const LOOK_S: f64 = 0.0451;

impl Start {
    /// A window that begins now.
    pub fn new(fade_s: f64, bias_var: f64) -> Self {
        let one = [1.0, 0.0, 0.0, 0.0];
        Self {
            turned: [one; 2],
            products: [[0.0; 3]; 3],
            power: 0.0,
            weight: 0.0,
            aged: 0.0,
            drift: 0.0,
            elapsed_s: 0.0,
            unseen_s: 0.0,
            fade_s,
            bias_var,
        }
    }

    /// Turns on by one step (rotation vectors of both sensors); `drift` is the variance that this adds, rad².
    pub fn turn(&mut self, turn1: Vec3<f64>, turn2: Vec3<f64>, dt: f64, drift: f64) {
        let [q1, q2] = self.turned;
        self.turned = [normalize(mul(q1, exp(turn1))), normalize(mul(q2, exp(turn2)))];
        self.elapsed_s += dt;
        self.unseen_s += dt;
        self.aged += self.weight * dt;
        let keep = (1.0 - dt / self.fade_s).max(0.0);
        let sums = [&mut self.power, &mut self.weight, &mut self.aged];
        self.products.as_flattened_mut().iter_mut().chain(sums).for_each(|x| *x *= keep);
        // Of a steadily growing drift the window's mean has half.
        self.drift = (self.drift + 0.5 * drift) * keep;
    }

    /// Adds the joint centre's acceleration as both sensors see it now, which stands for `dt`.
    pub fn add(&mut self, acc1: Vec3<f64>, acc2: Vec3<f64>, dt: f64) {
        let square = |a: Vec3<f64>| Vector3::from(a).norm_squared();
        let misfit = (ComplexField::sqrt(square(acc1)) - ComplexField::sqrt(square(acc2))) / MISFIT;
        let weight = dt / (1.0 + misfit * misfit);
        let [x, y] = [(self.turned[0], acc1), (self.turned[1], acc2)].map(|([w, i, j, k], a)| rotate_back([w, -i, -j, -k], a));
        for (row, x) in self.products.iter_mut().zip(x) {
            for (sum, y) in row.iter_mut().zip(y) {
                *sum += weight * x * y;
            }
        }
        self.power += weight * (square(acc1) + square(acc2));
        self.weight += weight;
    }

    /// From now on everything before is uncertain by this variance more, rad²: a window that knows to the variance `k` is worth
    /// `k/(k + variance)` of itself.
    pub fn doubt(&mut self, variance: f64) {
        let known = trace(&self.shown(self.between())) / 3.0;
        let keep = known / (known + variance);
        let sums = [&mut self.power, &mut self.weight, &mut self.aged, &mut self.drift];
        self.products.as_flattened_mut().iter_mut().chain(sums).for_each(|x| *x *= keep);
        self.unseen_s = LOOK_S;
    }

    /// Looks at the sums where it is time to; whether the orientation is known to `std`, rad, the root of the trace, biases
    /// apart, which waiting does not help against; or nearly so when all that fades has faded.
    pub fn is_known_to(&mut self, std: f64) -> bool {
        if self.unseen_s < LOOK_S {
            return false;
        }
        self.unseen_s = 0.0;
        let wanted = std * std * if self.elapsed_s > self.fade_s { NEARLY } else { 1.0 };
        !self.is_surely_above(wanted) && trace(&self.shown(self.between())) + 3.0 * self.drift < wanted
    }

    /// Whether some direction is surely less known than to this variance: spares most looks their eigenvectors. The curvature
    /// in the least known one is the sum of the two smaller singular values of the sums (one may count negative), and of their
    /// squares nothing is left but what the sums have across any vector.
    fn is_surely_above(&self, variance: f64) -> bool {
        let products = Matrix3::from_fn(|r, c| self.products[r][c]);
        let along = (1..3)
            .map(|k| products.row(k))
            .fold(products.row(0), |a, b| if b.norm_squared() > a.norm_squared() { b } else { a });
        let across = products.norm_squared() - (products * along.transpose()).norm_squared() / along.norm_squared();
        let needed = NEARLY_ALL * NOISE_DENSITY * (1.0 / variance - 1.0 / NOTHING_KNOWN);
        needed > 0.0 && 2.0 * across < needed * needed
    }

    /// For how long gyroscope biases have acted on what this finds: the mean age of what it rests on, s.
    pub fn lean_s(&self) -> f64 {
        if self.weight > 0.0 { self.aged / self.weight } else { 0.0 }
    }

    /// Trace of what biases add to the covariance, rad².
    pub fn leaning_variance(&self) -> f64 {
        3.0 * self.bias_var * self.lean_s() * self.lean_s()
    }

    /// The constant rotation between the frames of the beginning.
    fn between(&self) -> Quat<f64> {
        let products = Matrix3::from_fn(|r, c| self.products[r][c]);
        best_rotation(&(products + Matrix3::identity() * (PREFERENCE * (1e-6 + products.norm()))))
    }

    /// Covariance of what the sums show of this rotation, rad², in the frame of sensor 2 at the beginning.
    fn shown(&self, between: Quat<f64>) -> Sym3<f64> {
        let back = rows_back(between);
        // Rᵀ Σ w x yᵀ; of η in R exp[η×] the sum Σ w xᵀ R y has the curvature tr(G) I − ½(G + Gᵀ).
        let g = Matrix3::from_fn(|r, c| (0..3).map(|k| back[r][k] * self.products[k][c]).sum::<f64>());
        let curvature = Matrix3::identity() * g.trace() - (g + g.transpose()) * 0.5;
        let weight = self.weight.max(1e-12);
        let residual = ((self.power - 2.0 * g.trace()) / (3.0 * weight)).max(0.0);
        let level = self.power / (2.0 * weight);
        // What chance finds in noise, and in gravity that wanders with drift, half alike by chance, and with biases, all alike.
        let wander = 0.5 * self.drift + self.bias_var * weight * weight / 6.0;
        let feigned = FEIGNED * residual * ComplexField::sqrt(weight * ALIKE_S) + level * weight * wander;
        let density = (residual * ALIKE_S).max(NOISE_DENSITY);
        let mut known = Matrix3::identity() * NOTHING_KNOWN;
        if curvature.iter().all(|x| x.is_finite()) {
            let eigen = SymmetricEigen::new(curvature);
            let variances = eigen.eigenvalues.map(|x| 1.0 / ((x - feigned).max(0.0) / density + 1.0 / NOTHING_KNOWN));
            known = eigen.eigenvectors * Matrix3::from_diagonal(&variances) * eigen.eigenvectors.transpose();
        }
        [known[(0, 0)], known[(0, 1)], known[(0, 2)], known[(1, 1)], known[(1, 2)], known[(2, 2)]]
    }

    /// Orientation and covariance now, biases apart.
    pub fn solve(&self) -> Oriented {
        let between = self.between();
        let [[w, x, y, z], q2] = self.turned;
        let q = normalize(mul(mul([w, -x, -y, -z], between), q2));
        (q, add_diagonal(&congruence(&rows_back(q2), &self.shown(between)), self.drift))
    }

    /// Whether it can go on.
    pub(crate) fn is_sound(&self) -> bool {
        let finite = |q: &Quat<f64>| q.iter().all(|x| x.is_finite());
        let sums = [self.power, self.weight, self.aged, self.drift, self.unseen_s, self.bias_var];
        self.turned.iter().all(finite)
            && sums.iter().chain(self.products.as_flattened()).all(|x| x.is_finite())
            && self.fade_s > 0.0
    }
}

/// The rotation R that maximises `Σ xᵀ R y`, from `Σ x yᵀ`, as a quaternion; identity where there is none.
fn best_rotation(products: &Matrix3<f64>) -> Quat<f64> {
    let s = products.transpose(); // Horn's S = Σ y xᵀ
    let twist = Vector3::new(s[(1, 2)] - s[(2, 1)], s[(2, 0)] - s[(0, 2)], s[(0, 1)] - s[(1, 0)]);
    let mut n = Matrix4::zeros();
    n[(0, 0)] = s.trace();
    n.fixed_view_mut::<3, 1>(1, 0).copy_from(&twist);
    n.fixed_view_mut::<1, 3>(0, 1).copy_from(&twist.transpose());
    n.fixed_view_mut::<3, 3>(1, 1).copy_from(&(s + s.transpose() - Matrix3::identity() * s.trace()));
    match SymmetricEigen::try_new(n, f64::EPSILON, 200) {
        Some(eigen) if eigen.eigenvalues.iter().all(|x| x.is_finite()) => {
            let best = eigen.eigenvectors.column(eigen.eigenvalues.imax());
            let q = normalize([best[0], best[1], best[2], best[3]]);
            if q[0] < 0.0 { q.map(|x| -x) } else { q }
        }
        _ => [1.0, 0.0, 0.0, 0.0],
    }
}

/// The start of a recording in one call: rotation vectors of both sensors from each sample to the next one (the first pair is not
/// used) and the joint centre's accelerations, all `step_s` apart. The orientation belongs to the first sample; its
/// covariance is in the frame of sensor 2.
pub fn start_of(turns: [&[Vec3<f64>]; 2], accelerations: [&[Vec3<f64>]; 2], step_s: f64) -> Oriented {
    let mut start = Start::new(f64::INFINITY, 0.0);
    let [turns1, turns2] = turns;
    let [acc1, acc2] = accelerations;
    for (k, (((t1, t2), a1), a2)) in turns1.iter().zip(turns2).zip(acc1).zip(acc2).enumerate() {
        if k > 0 {
            start.turn(*t1, *t2, step_s, 0.0);
        }
        start.add(*a1, *a2, step_s);
    }
    start.turned = [[1.0, 0.0, 0.0, 0.0]; 2];
    start.solve()
}
