//! W to start from, in closed form.

use alloc::vec::Vec;
use nalgebra::{ComplexField, Matrix3, Rotation3, UnitQuaternion};

use super::{
    keys::Key,
    residual::{Constants, joint_acc},
};

/// Links count the less the farther they are in time: by e after so many seconds.
const MEMORY_S: f64 = 6.0;
/// The second singular value over the first from which on the directions of the link span enough to believe the heading.
const LEAST_SPREAD: f64 = 0.02;

/// W at every key that turns the accelerations of the joint centre as sensor 2 sees them best onto those of sensor 1, over a
/// few seconds to either side (Wahba's problem by singular values); where they hardly change direction, that of the nearest
/// key where they do: drift frames hardly turn.
pub fn start(keys: &[Key], time_s: &[f64], x: &Constants) -> Vec<UnitQuaternion<f64>> {
    let outer: Vec<Matrix3<f64>> = keys
        .iter()
        .map(|key| {
            let [f1, f2] = joint_acc(key, x);
            f1 * f2.transpose() * key.share
        })
        .collect();
    let fade = |k: usize| if keys[k].span_s > 0.0 { ComplexField::exp(-keys[k].span_s / MEMORY_S) } else { 0.0 };
    let mut sum = outer.clone();
    for k in 1..keys.len() {
        let before = sum[k - 1];
        sum[k] += before * fade(k - 1);
    }
    let mut later = Matrix3::zeros();
    for k in (0..keys.len()).rev() {
        sum[k] += later;
        later = (later + outer[k]) * if k > 0 { fade(k - 1) } else { 0.0 };
    }
    let solved: Vec<(UnitQuaternion<f64>, f64)> = sum.iter().map(wahba).collect();
    let best = solved.iter().map(|s| s.1).fold(0.0, f64::max);
    let enough = LEAST_SPREAD.min(0.5 * best);
    let trusted: Vec<usize> = (0..keys.len()).filter(|&k| solved[k].1 >= enough).collect();
    let moment = |k: usize| time_s[keys[k].sample];
    let mut w = Vec::with_capacity(keys.len());
    let mut n = 0;
    for k in 0..keys.len() {
        let apart = |t: usize| ComplexField::abs(moment(t) - moment(k));
        while n + 1 < trusted.len() && apart(trusted[n + 1]) <= apart(trusted[n]) {
            n += 1;
        }
        w.push(trusted.get(n).map_or(UnitQuaternion::identity(), |&t| solved[t].0));
    }
    w
}

/// The rotation R with the largest `tr(RᵀB)`, and how well `B` determines it: the weakest of its curvatures over the largest
/// singular value.
fn wahba(b: &Matrix3<f64>) -> (UnitQuaternion<f64>, f64) {
    if !b.iter().all(|v| v.is_finite()) {
        return (UnitQuaternion::identity(), 0.0);
    }
    let svd = b.svd(true, true);
    let (Some(u), Some(vt)) = (svd.u, svd.v_t) else { return (UnitQuaternion::identity(), 0.0) };
    let sign = if (u * vt).determinant() < 0.0 { -1.0 } else { 1.0 };
    let mut order = [0, 1, 2];
    order.sort_by(|&i: &usize, &j| svd.singular_values[j].total_cmp(&svd.singular_values[i]));
    let mut u = u;
    let weakest = order[2];
    u.column_mut(weakest).scale_mut(sign);
    let s = order.map(|i| svd.singular_values[i]);
    if s[0].is_nan() || s[0] <= 0.0 {
        return (UnitQuaternion::identity(), 0.0);
    }
    (UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * vt)), (s[1] + sign * s[2]) / s[0])
}
