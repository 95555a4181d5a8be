//! Where a filter starts: the closed form over the first seconds.
//!
//! Each gyroscope alone carries its sensor's orientation from the first instant on. What is missing is one constant rotation
//! between the two, and it solves Wahba's problem: the joint centre's acceleration, seen by both sensors, is the same vector. The
//! largest eigenvector of a 4×4 matrix gives it (Horn 1987), without a first guess. How long the window must be is told by
//! the data: `Σ [a×]ᵀ[a×]` is small in a direction that the motion has not shown yet.

use nalgebra::{Matrix3, Matrix4, SymmetricEigen, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    algebra::{Quat, Sym3, Vec3, congruence, cross, inverse, mul, normalize, rotate_back, rows_back, trace},
    algebra::{add_diagonal, exp},
};

/// An orientation and the covariance of its error, rad², in the frame of sensor 2.
pub type Oriented = (Quat<f64>, Sym3<f64>);

/// The sums of one window.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Start {
    /// Orientation of each sensor now against its own at the beginning.
    turned: [Quat<f64>; 2],
    /// `Σ w x yᵀ dt` of the accelerations in the frames of the beginning.
    products: [Vec3<f64>; 3],
    /// `Σ w [y×]ᵀ[y×] dt`.
    information: Sym3<f64>,
    /// What the gyroscopes have drifted apart meanwhile, rad².
    drift: f64,
    /// Length of the window so far, s.
    elapsed_s: f64,
    /// Old instants fade with this time constant, s: the drift makes them worthless.
    fade_s: f64,
}

/// Noise of the link residual in a start, (m/s²)²·s: 0.45 m/s² at 50 Hz, generous, as neighbours err alike.
const NOISE_DENSITY: f64 = 0.004;
/// Knowing nothing, a rotation angle about one axis has this variance: uniform in ±π.
const NOTHING_KNOWN: f64 = core::f64::consts::PI * core::f64::consts::PI / 3.0;
/// Where the two accelerations differ in length by this, m/s², no rotation explains it and the instant counts half.
const MISFIT: f64 = 1.0;
/// A start may end with this many times the wanted variance when waiting does not help.
const NEARLY: f64 = 9.0;
/// Weight, against the data, of leaving undetermined directions as the shortest rotation leaves them.
const PREFERENCE: f64 = 1e-9;

impl Start {
    /// A window that begins now.
    pub fn new(fade_s: f64) -> Self {
        let one = [1.0, 0.0, 0.0, 0.0];
        Self { turned: [one; 2], products: [[0.0; 3]; 3], information: [0.0; 6], drift: 0.0, elapsed_s: 0.0, fade_s }
    }

    /// Turns on by one step (rotation vectors of both sensors); `drift` is the variance that this adds, rad².
    pub fn turn(&mut self, turn1: Vec3<f64>, turn2: Vec3<f64>, dt: f64, drift: f64) {
        let [q1, q2] = self.turned;
        self.turned = [normalize(mul(q1, exp(turn1))), normalize(mul(q2, exp(turn2)))];
        self.elapsed_s += dt;
        let keep = (1.0 - dt / self.fade_s).max(0.0);
        self.products.as_flattened_mut().iter_mut().chain(&mut self.information).for_each(|x| *x *= keep);
        // Of a steadily growing drift the window's mean has half.
        self.drift = (self.drift + 0.5 * drift) * keep;
    }

    /// Adds the joint centre's acceleration as both sensors see it now, which stands for `dt`.
    pub fn add(&mut self, acc1: Vec3<f64>, acc2: Vec3<f64>, dt: f64) {
        let size = |a: Vec3<f64>| Vector3::from(a).norm();
        let misfit = (size(acc1) - size(acc2)) / MISFIT;
        let weight = dt / (1.0 + misfit * misfit);
        let [x, y] = [(self.turned[0], acc1), (self.turned[1], acc2)].map(|([w, i, j, k], a)| rotate_back([w, -i, -j, -k], a));
        for (row, x) in self.products.iter_mut().zip(x) {
            for (sum, y) in row.iter_mut().zip(y) {
                *sum += weight * x * y;
            }
        }
        let rows = [cross([1.0, 0.0, 0.0], y), cross([0.0, 1.0, 0.0], y), cross([0.0, 0.0, 1.0], y)];
        for (sum, part) in self.information.iter_mut().zip(congruence(&rows, &[1.0, 0.0, 0.0, 1.0, 0.0, 1.0])) {
            *sum += weight * part;
        }
    }

    /// Covariance now, rad²; never more than knowing nothing.
    pub fn covariance(&self) -> Sym3<f64> {
        let known = add_diagonal(&self.information.map(|i| i / NOISE_DENSITY), 1.0 / NOTHING_KNOWN);
        add_diagonal(&congruence(&rows_back(self.turned[1]), &inverse(&known)), self.drift)
    }

    /// Whether the orientation is known to `std`, rad, the root of the trace; or nearly so when all that fades has faded and
    /// waiting does not help.
    pub fn is_known_to(&self, std: f64) -> bool {
        let variance = trace(&self.covariance());
        variance < std * std || (self.elapsed_s > self.fade_s && variance < NEARLY * std * std)
    }

    /// The orientation now: sensor 2 to sensor 1.
    pub fn orientation(&self) -> Quat<f64> {
        let products = Matrix3::from_fn(|r, c| self.products[r][c]);
        let preference = PREFERENCE * (1e-6 + products.norm());
        let [q1, q2] = self.turned;
        let between = best_rotation(&(products + Matrix3::identity() * preference));
        let [w, x, y, z] = q1;
        normalize(mul(mul([w, -x, -y, -z], between), q2))
    }

    /// Orientation and covariance now.
    pub fn solve(&self) -> Oriented {
        (self.orientation(), self.covariance())
    }

    /// Whether it can go on.
    pub(crate) fn is_sound(&self) -> bool {
        let finite = |q: &Quat<f64>| q.iter().all(|x| x.is_finite());
        self.turned.iter().all(finite) && self.information.iter().all(|x| x.is_finite()) && self.fade_s > 0.0
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
    let mut start = Start::new(f64::INFINITY);
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
