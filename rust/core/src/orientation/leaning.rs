//! What gyroscope biases that calibration does not know do to the orientation: the "considered" constants of a Schmidt–Kalman
//! filter (Schmidt 1966), which are not estimated but counted.
//!
//! The error of a filter follows `η ← (I − KH)(Eᵀη + b dt)`, `E` being the turn of sensor 2 and `b` the relative bias in its
//! frame. With `S = ∂η/∂b` its covariance is that of the filter and `S cov(b) Sᵀ`. `S` changes slowly and is brought up to date
//! a few times a second: `S ← (I + n KH)⁻¹(Eᵀ S + T I)` over `n` samples in `T` seconds. (A bias of sensor 1 turns against frame
//! 2 while the joint moves; taking it as one that does not errs on the careful side.)

use serde::{Deserialize, Serialize};

use super::{
    algebra::{Vec3, add, cross, dot, exp, rows_back, scale},
    lane::Lane,
    state::Moment,
};

/// How a filter leans with a bias.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Leaning<L> {
    /// Rows of `S`, s.
    pub rows: [Vec3<L>; 3],
    /// Turn of sensor 2 since then, rad.
    pub turn: Vec3<L>,
    /// Time since then, s.
    pub since: L,
    /// Trace of `S cov(b) Sᵀ`, rad².
    pub variance: L,
}

/// Time between two updates, s; no multiple of usual steps, lest rounding decides.
const STEP_S: f64 = 0.1951;

impl<L: Lane> Leaning<L> {
    /// Of an orientation to which biases have added up for so many seconds.
    pub fn after(seconds: f64, bias_var: f64) -> Self {
        let (zero, lean) = (L::splat(0.0), L::splat(seconds));
        let rows = [[lean, zero, zero], [zero, lean, zero], [zero, zero, lean]];
        Self { rows, turn: [zero; 3], since: zero, variance: L::splat(3.0 * seconds * seconds * bias_var) }
    }

    /// Counts one more sample; says whether an update is due.
    #[inline(always)]
    pub(crate) fn wait(&mut self, m: &Moment<L>) -> bool {
        self.turn = add(self.turn, m.turn2);
        self.since = self.since + m.dt;
        self.since.any_above(L::splat(STEP_S))
    }

    /// Brings itself up to date where that is due; `pull` are the rows of KH of one sample. Where none corrects it waits.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(crate) fn update(&mut self, per_dt: L, pull: &[Vec3<L>; 3], bias_var: L) {
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        let [a, b, c] = rows_back(exp(self.turn));
        let [a, b, c] = [combined(&self.rows, a), combined(&self.rows, b), combined(&self.rows, c)];
        let t = self.since;
        let leant = [[a[0] + t, a[1], a[2]], [b[0], b[1] + t, b[2]], [c[0], c[1], c[2] + t]];
        // (I + n KH)⁻¹ by cofactors; its determinant is at least one.
        let n = t.at_most(L::splat(2.0 * STEP_S)) * per_dt;
        let [x, y, z] = [scale(pull[0], n), scale(pull[1], n), scale(pull[2], n)];
        let (x, y, z) = ([x[0] + one, x[1], x[2]], [y[0], y[1] + one, y[2]], [z[0], z[1], z[2] + one]);
        let cofactors = [cross(y, z), cross(z, x), cross(x, y)];
        let scaled = one / dot(x, cofactors[0]);
        let due = t - L::splat(STEP_S);
        let mut size = zero;
        for (k, row) in self.rows.iter_mut().enumerate() {
            let new = combined(&leant, scale([cofactors[0][k], cofactors[1][k], cofactors[2][k]], scaled));
            for (old, new) in row.iter_mut().zip(new) {
                *old = due.where_above(zero, new, *old);
                size = size + *old * *old;
            }
        }
        self.variance = due.where_above(zero, size * bias_var, self.variance);
        for x in &mut self.turn {
            *x = due.where_above(zero, zero, *x);
        }
        self.since = due.where_above(zero, zero, t);
    }
}

/// `Σ by[i] rows[i]`.
#[inline(always)]
fn combined<L: Lane>(rows: &[Vec3<L>; 3], by: Vec3<L>) -> Vec3<L> {
    add(add(scale(rows[0], by[0]), scale(rows[1], by[1])), scale(rows[2], by[2]))
}
