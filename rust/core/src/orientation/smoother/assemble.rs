//! Twice the negative logarithm of the posterior, and its Gauss–Newton system.

use alloc::vec::Vec;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::{
    arrowhead::{Arrowhead, Border, Node},
    keys::Key,
    noise::Noise,
    residual::{CONSTANTS, Constants, Drift, GYR_BIASES, Link, joint_acc, triple},
};

/// The unknowns.
#[derive(Clone, Debug)]
pub struct State {
    /// W at every key.
    pub w: Vec<UnitQuaternion<f64>>,
    /// See [`super::residual`].
    pub x: Constants,
}

impl State {
    /// Moved by a step of every key and one of the constants.
    pub fn moved(&self, steps: &[Vector3<f64>], constants: &Constants) -> Self {
        let turned = |(w, s): (&UnitQuaternion<f64>, &Vector3<f64>)| {
            let mut w = w * UnitQuaternion::from_scaled_axis(*s);
            w.renormalize();
            w
        };
        Self { w: self.w.iter().zip(steps).map(turned).collect(), x: self.x + constants }
    }
}

/// What is known of the constants beforehand: a Gaussian.
#[derive(Clone, Copy, Debug)]
pub struct Prior {
    /// Most probable values.
    pub mean: Constants,
    /// Inverse covariance.
    pub precision: Border,
}

impl Prior {
    /// Independent constants with these standard deviations.
    pub fn independent(mean: Constants, std: &Constants) -> Self {
        Self { mean, precision: Border::from_diagonal(&std.map(|s| 1.0 / (s * s))) }
    }

    /// Replaces what is known of the three constants from place `at`.
    pub fn know(&mut self, at: usize, mean: &Vector3<f64>, std: f64) {
        self.mean.fixed_rows_mut::<3>(at).copy_from(mean);
        self.precision.fixed_rows_mut::<3>(at).fill(0.0);
        self.precision.fixed_columns_mut::<3>(at).fill(0.0);
        (at..at + 3).for_each(|k| self.precision[(k, k)] = 1.0 / (std * std));
    }
}

/// Everything that the posterior is made of, but the unknowns.
pub struct Problem<'a> {
    /// What the sensors say.
    pub keys: &'a [Key],
    /// How much to trust it.
    pub noise: Noise,
    /// Constants beforehand.
    pub prior: &'a Prior,
    /// So much the prior counts against the rest.
    pub prior_weight: f64,
    /// Gyroscope biases with which the drift frames were made.
    pub drift_bias: [Vector3<f64>; 2],
}

/// Precision of a key's orientation beforehand, where a chain begins, 1/rad²: nothing is known, so about a radian and a half.
const OPEN: f64 = 0.4;

impl Problem<'_> {
    /// How far the gyroscope biases are from those of the drift frames.
    pub(super) fn moved(&self, x: &Constants) -> [Vector3<f64>; 2] {
        [0, 1].map(|i| triple(x, GYR_BIASES + 3 * i) - self.drift_bias[i])
    }

    /// The cost: links in Student's t, drifts and prior Gaussian.
    pub fn cost(&self, state: &State) -> f64 {
        let moved = self.moved(&state.x);
        let mut cost = 0.0;
        for (k, (key, w)) in self.keys.iter().zip(&state.w).enumerate() {
            if key.share > 0.0 {
                let [f1, f2] = joint_acc(key, &state.x);
                cost += self.noise.link_cost((f1 - w * f2).norm_squared(), key.share);
            }
            if let (true, Some(next)) = (key.span_s > 0.0, state.w.get(k + 1)) {
                let turn = (w.inverse() * next).scaled_axis();
                let p = turn - w.inverse_transform_vector(&(key.view[0].turned * moved[0])) + key.view[1].turned * moved[1];
                cost += self.noise.drift_precision(key) * p.norm_squared();
            }
        }
        let off = state.x - self.prior.mean;
        cost + self.prior_weight * off.dot(&(self.prior.precision * off))
    }

    /// The Gauss–Newton system at `state`, its diagonal raised by the share `damping`.
    pub fn linearise(&self, state: &State, damping: f64) -> Arrowhead {
        let moved = self.moved(&state.x);
        let mut nodes = alloc::vec![Node::ZERO; self.keys.len()];
        let mut border = self.prior.precision * self.prior_weight;
        let mut gradient = self.prior_weight * self.prior.precision * (state.x - self.prior.mean);
        let mut chained = false;
        for (k, (key, w)) in self.keys.iter().zip(&state.w).enumerate() {
            if !chained {
                nodes[k].diagonal += Matrix3::identity() * OPEN;
            }
            if key.share > 0.0 {
                let link = Link::at(key, w, &state.x);
                let weight = self.noise.link_weight(link.residual.norm_squared(), key.share);
                add_link(&link, weight, &mut nodes[k], &mut border, &mut gradient);
            }
            chained = key.span_s > 0.0 && k + 1 < state.w.len();
            if chained {
                let drift = Drift::between(key, w, &state.w[k + 1], &moved);
                let (before, after) = nodes.split_at_mut(k + 1);
                let precision = self.noise.drift_precision(key);
                add_drift(&drift, precision, &mut before[k], &mut after[0], &mut border, &mut gradient);
            }
        }
        if damping > 0.0 {
            for node in &mut nodes {
                (0..3).for_each(|i| node.diagonal[(i, i)] *= 1.0 + damping);
            }
            (0..CONSTANTS).for_each(|i| border[(i, i)] *= 1.0 + damping);
        }
        Arrowhead { nodes, border, gradient }
    }

    /// Residual of every link there is, in drift frame 1, with the share of its key.
    pub fn links<'a>(&'a self, state: &'a State) -> impl Iterator<Item = (Vector3<f64>, f64)> + 'a {
        self.keys.iter().zip(&state.w).filter(|(key, _)| key.share > 0.0).map(|(key, w)| {
            let [f1, f2] = joint_acc(key, &state.x);
            (f1 - w * f2, key.share)
        })
    }
}

/// Adds `weight·JᵀJ` and `weight·Jᵀe` of one link.
fn add_link(link: &Link, weight: f64, node: &mut Node, border: &mut Border, gradient: &mut Constants) {
    let turn = link.turn * weight;
    node.diagonal += turn.tr_mul(&link.turn);
    node.gradient += turn.tr_mul(&link.residual);
    let side = turn.tr_mul(&link.constants);
    for (r, row) in node.border.iter_mut().enumerate() {
        for (c, v) in row.iter_mut().take(GYR_BIASES).enumerate() {
            *v += side[(r, c)];
        }
    }
    let constants = link.constants * weight;
    let block = constants.tr_mul(&link.constants);
    let mut corner = border.fixed_view_mut::<12, 12>(0, 0);
    corner += block;
    let mut part = gradient.fixed_rows_mut::<12>(0);
    part += constants.tr_mul(&link.residual);
}

/// The same of one drift.
fn add_drift(drift: &Drift, precision: f64, here: &mut Node, next: &mut Node, border: &mut Border, gradient: &mut Constants) {
    let (a, b) = (drift.here * precision, drift.next * precision);
    here.diagonal += a.tr_mul(&drift.here);
    here.next += a.tr_mul(&drift.next);
    here.gradient += a.tr_mul(&drift.residual);
    next.diagonal += b.tr_mul(&drift.next);
    next.gradient += b.tr_mul(&drift.residual);
    for (i, bias) in drift.biases.iter().enumerate() {
        let at = GYR_BIASES + 3 * i;
        for (node, side) in [(&mut *here, a.tr_mul(bias)), (&mut *next, b.tr_mul(bias))] {
            for (r, row) in node.border.iter_mut().enumerate() {
                for c in 0..3 {
                    row[at + c] += side[(r, c)];
                }
            }
        }
        let weighted = bias * precision;
        let mut part = gradient.fixed_rows_mut::<3>(at);
        part += weighted.tr_mul(&drift.residual);
        for (j, other) in drift.biases.iter().enumerate() {
            let mut corner = border.fixed_view_mut::<3, 3>(at, GYR_BIASES + 3 * j);
            corner += weighted.tr_mul(other);
        }
    }
}
