//! Lever arms and accelerometer biases from what needs no orientation: both sensors must see the acceleration of the joint
//! centre equally long (SS of Olsson & Halvorsen 2017, eqs 15–16, on the averages of the keys).

use nalgebra::{ComplexField, SMatrix, SVector};

use super::{
    assemble::Prior,
    keys::Key,
    residual::{ACC_BIASES, Constants, LEVERS, joint_acc},
};

/// How many of the constants move a length: all but the gyroscope biases.
const MOVING: usize = 12;
const ITERATIONS: usize = 15;
/// Robust weights `1/(1 + (e/scale)²)`, as of the Cauchy distribution, on this many median absolute residuals.
const SCALE: f64 = 2.0;

/// The constants that bring the lengths together, beginning with the prior's mean and held by the prior.
pub fn fit_lengths(keys: &[Key], prior: &Prior) -> Constants {
    let mut x = prior.mean;
    let mut residuals: alloc::vec::Vec<f64> = alloc::vec::Vec::with_capacity(keys.len());
    let mut damping = 1e-3;
    let mut best = f64::INFINITY;
    let mut kept = x;
    let mut scale = f64::NAN;
    for _ in 0..ITERATIONS {
        residuals.clear();
        residuals.extend(linked(keys).map(|key| ComplexField::abs(length_difference(key, &x))));
        if residuals.len() < MOVING || residuals.iter().any(|e| !e.is_finite()) {
            return prior.mean;
        }
        if scale.is_nan() {
            let middle = residuals.len() / 2;
            residuals.select_nth_unstable_by(middle, f64::total_cmp);
            scale = (SCALE * residuals[middle]).max(1e-3);
        }
        let off = x - prior.mean;
        let cost = residuals.iter().map(|e| ComplexField::ln_1p(e * e / (scale * scale))).sum::<f64>()
            + off.dot(&(prior.precision * off));
        if cost < best {
            (best, kept) = (cost, x);
            damping *= 0.3;
        } else {
            x = kept;
            damping *= 10.0;
        }
        let Some(step) = length_step(keys, &x, prior, scale, damping) else { break };
        x.fixed_rows_mut::<MOVING>(0).zip_apply(&step, |x, step| *x += step);
        if step.norm() < 1e-5 {
            break;
        }
    }
    kept
}

fn linked(keys: &[Key]) -> impl Iterator<Item = &Key> {
    keys.iter().filter(|key| key.share > 0.0)
}

fn length_difference(key: &Key, x: &Constants) -> f64 {
    let [f1, f2] = joint_acc(key, x);
    f1.norm() - f2.norm()
}

/// One damped Gauss–Newton step of twelve constants.
fn length_step(keys: &[Key], x: &Constants, prior: &Prior, scale: f64, damping: f64) -> Option<SVector<f64, MOVING>> {
    let precision = prior.precision.fixed_view::<MOVING, MOVING>(0, 0).into_owned();
    let mut hessian: SMatrix<f64, MOVING, MOVING> = precision;
    let mut gradient = precision * (x - prior.mean).fixed_rows::<MOVING>(0);
    for key in linked(keys) {
        let [f1, f2] = joint_acc(key, x);
        let (Some(n1), Some(n2)) = (f1.try_normalize(1e-6), f2.try_normalize(1e-6)) else { continue };
        let mut row = SVector::<f64, MOVING>::zeros();
        for (i, (view, n)) in key.view.iter().zip([-n1, n2]).enumerate() {
            row.fixed_rows_mut::<3>(LEVERS + 3 * i).copy_from(&view.lever.tr_mul(&n));
            row.fixed_rows_mut::<3>(ACC_BIASES + 3 * i).copy_from(&view.bias.tr_mul(&n));
        }
        let e = f1.norm() - f2.norm();
        let weight = 1.0 / (scale * scale + e * e);
        hessian += row * row.transpose() * weight;
        gradient += row * (e * weight);
    }
    (0..MOVING).for_each(|i| hessian[(i, i)] *= 1.0 + damping);
    hessian.cholesky().map(|h| -h.solve(&gradient))
}
