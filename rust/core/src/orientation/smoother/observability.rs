//! Whether the data show the relative orientation at all. The accelerations of the joint centre must point in changing
//! directions (Kok, Eckhoff, Weygers, Seel 2021): where they stay along one, a turn about it moves no residual.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use super::{
    assemble::{Problem, State},
    keys::Key,
    marginals::Marginal,
    residual::joint_acc,
};

/// Noise feigns up to two or so of information a key (in its own units); there must be this much more than nothing...
const LEAST_PER_KEY: f64 = 10.0;
/// ...somewhere over so long, s: over longer the drift of the frames adds up to changing directions of its own.
const STRETCH_S: f64 = 10.0;
/// Variance of an angle of which nothing is known: uniform over the circle, rad².
const UNKNOWN: f64 = core::f64::consts::PI * core::f64::consts::PI / 3.0;

/// Adds what is unknown to the covariances of every unbroken chain of keys that nowhere shows all of its orientation; whether
/// any chain does.
///
/// The curvature of `½‖f_1 − W f_2‖²` is `(g·f_2) I − ½(g f_2ᵀ + f_2 gᵀ)` with `g = Wᵀ f_1`. In it the noises of the two
/// sensors cancel, as they do not know each other; in that of Gauss–Newton they feign information.
pub fn reveal(problem: &Problem, state: &State, covariances: &mut [Marginal]) -> bool {
    let mut any = false;
    for (start, end) in chains(problem.keys) {
        match unknown(problem, state, start, end) {
            Some(more) => covariances.iter_mut().take(end).skip(start).for_each(|m| m.own += more),
            None => any = true,
        }
    }
    any
}

/// The longest of the steps of all chains that show their orientation, rad. Those of a chain that does not lead nowhere: along a
/// valley that only noise makes uneven.
pub fn longest_step(problem: &Problem, state: &State, steps: &[Vector3<f64>]) -> f64 {
    let shown = chains(problem.keys).filter(|(start, end)| unknown(problem, state, *start, *end).is_none());
    let longest = |(start, end): (usize, usize)| steps.iter().take(end).skip(start).map(|s| s.norm()).fold(0.0, f64::max);
    shown.map(longest).fold(0.0, f64::max)
}

/// The unbroken chains of keys: of each the first, and the one after the last.
fn chains(keys: &[Key]) -> impl Iterator<Item = (usize, usize)> + '_ {
    let mut start = 0;
    (1..=keys.len()).filter_map(move |end| {
        let broken = end == keys.len() || keys[end - 1].span_s == 0.0;
        broken.then(|| (core::mem::replace(&mut start, end), end))
    })
}

/// Covariance of what one chain does not show; None where it shows everything.
fn unknown(problem: &Problem, state: &State, start: usize, end: usize) -> Option<Matrix3<f64>> {
    let (mut whole, mut whole_count) = (Matrix3::zeros(), 0.0);
    let (mut part, mut count, mut length_s) = (Matrix3::zeros(), 0.0, 0.0);
    for (k, key) in problem.keys.iter().enumerate().take(end).skip(start) {
        if key.share > 0.0 {
            part += curvature(problem, state, k);
            count += LEAST_PER_KEY * problem.noise.trust;
        }
        length_s += key.span_s;
        if length_s > STRETCH_S || k + 1 == end {
            let finite = part.iter().all(|v| v.is_finite());
            if finite && count > 0.0 && part.symmetric_eigenvalues().min() > count {
                return None;
            }
            whole += part;
            whole_count += count;
            (part, count, length_s) = (Matrix3::zeros(), 0.0, 0.0);
        }
    }
    if whole_count == 0.0 || !whole.iter().all(|v| v.is_finite()) {
        return Some(Matrix3::identity() * UNKNOWN);
    }
    let eigen = SymmetricEigen::new(whole);
    let weakest = eigen.eigenvalues.imin();
    let open = |(k, value): (usize, &f64)| k == weakest || *value < whole_count;
    let directions = eigen.eigenvectors.column_iter();
    let unseen = eigen.eigenvalues.iter().enumerate().zip(directions).filter(|(value, _)| open(*value));
    Some(unseen.map(|(_, d)| d * d.transpose() * UNKNOWN).sum())
}

/// What the link of key k says about the orientation, 1/rad².
fn curvature(problem: &Problem, state: &State, k: usize) -> Matrix3<f64> {
    let (key, w) = (&problem.keys[k], &state.w[k]);
    let [f1, f2] = joint_acc(key, &state.x);
    let g = w.inverse_transform_vector(&f1);
    let outer = g * f2.transpose();
    let bend = Matrix3::identity() * g.dot(&f2) - 0.5 * (outer + outer.transpose());
    bend * problem.noise.link_weight((g - f2).norm_squared(), key.share)
}
