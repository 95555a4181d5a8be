//! From the keys back to every sample.

use alloc::vec::Vec;
use nalgebra::UnitQuaternion;

use super::{
    arrowhead::Border,
    keys::{Key, Samples},
    marginals::Marginal,
    noise::Noise,
    residual::Constants,
    solve::Status,
};

/// A smoothed recording.
#[derive(Clone, Debug)]
pub struct Smoothed {
    /// Sensor 2 to sensor 1 at every sample.
    pub q_12: Vec<[f64; 4]>,
    /// Covariance of the error of `q_12` at every sample, perturbed on the right (in sensor frame 2), rad²: xx, yy, zz, xy,
    /// xz, yz. Infinite where the problem could not be solved.
    pub covariance: Vec<[f64; 6]>,
    /// The same if the constants were known.
    pub covariance_known: Vec<[f64; 6]>,
    /// The constants; see [`super::residual`].
    pub constants: Constants,
    /// Their covariance.
    pub constants_covariance: Border,
    /// What the noise was found to be.
    pub noise: Noise,
    /// Of every link its sample and `‖e‖²/σ²`, which are 3·F(3, ν) distributed where the model holds.
    pub link_squares: Vec<(usize, f64)>,
    /// Why the descent ended.
    pub status: Status,
    /// Gauss–Newton iterations.
    pub iterations: usize,
}

/// `R_12 = Q_1ᵀ W Q_2` at every sample: between keys, W turns evenly from one to the next; the gyroscopes do the rest.
pub fn samples_q_12(
    samples: &Samples,
    turns: &[Vec<UnitQuaternion<f64>>; 2],
    keys: &[Key],
    w: &[UnitQuaternion<f64>],
) -> Vec<[f64; 4]> {
    let mut q_12 = Vec::with_capacity(samples.time_s.len());
    for (n, (k, share)) in places(samples, keys).enumerate() {
        let mut at = w[k];
        if share > 0.0 && k + 1 < w.len() {
            at *= UnitQuaternion::from_scaled_axis((at.inverse() * w[k + 1]).scaled_axis() * share);
        }
        let mut q = turns[0][n].inverse() * at * turns[1][n];
        q.renormalize();
        q_12.push([q.w, q.i, q.j, q.k]);
    }
    q_12
}

/// The covariance of [`Smoothed`] at every sample, between those of the keys.
pub fn samples_covariance(
    samples: &Samples,
    turns2: &[UnitQuaternion<f64>],
    keys: &[Key],
    marginals: &[Marginal],
) -> Vec<[f64; 6]> {
    if marginals.len() < keys.len() {
        return alloc::vec![[f64::INFINITY, f64::INFINITY, f64::INFINITY, 0.0, 0.0, 0.0]; samples.time_s.len()];
    }
    let mut covariance = Vec::with_capacity(samples.time_s.len());
    for (n, (k, share)) in places(samples, keys).enumerate() {
        let mut c = marginals[k].own;
        if let (true, Some(next)) = (share > 0.0, marginals.get(k + 1)) {
            c = c * (1.0 - share) + next.own * share;
        }
        let back = turns2[n].inverse().to_rotation_matrix().into_inner();
        let c = back * c * back.transpose();
        covariance.push([c[(0, 0)], c[(1, 1)], c[(2, 2)], c[(0, 1)], c[(0, 2)], c[(1, 2)]]);
    }
    covariance
}

/// For every sample the key at or before it, and the share of the way to the next that it has gone.
fn places<'a>(samples: &'a Samples, keys: &'a [Key]) -> impl Iterator<Item = (usize, f64)> + 'a {
    let mut k = 0;
    samples.time_s.iter().enumerate().map(move |(n, t)| {
        while k + 1 < keys.len() && keys[k + 1].sample <= n {
            k += 1;
        }
        let key = &keys[k];
        (k, if key.span_s > 0.0 { (t - samples.time_s[key.sample]) / key.span_s } else { 0.0 })
    })
}
